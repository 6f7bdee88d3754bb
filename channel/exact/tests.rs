//! The exact pixel against dense points, closed forms, and its own ways against each other.

use super::cells::Cells;
use super::polygon::SQUARE;
use super::prepare::Faces;
use super::regions::{Regions, Sum};
use super::sheet::Sheets;
use super::{Counts, ExactFace, Integrator, Part};
use crate::oracle::Random;
use crate::translucency::models::Member;
use proptest::prelude::*;

const BLACK: [f64; 3] = [0.0; 3];

/// Of these corners, turned the right way round, with inverse distances at them.
fn face(corners: [[f64; 2]; 3], q: [f64; 3], order: u64, alpha: f64, rgb: [f64; 3]) -> ExactFace<'static> {
    let area = |[a, b, c]: [[f64; 2]; 3]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let [a, b, c] = corners;
    let (corners, q) = if area(corners) < 0.0 { ([a, c, b], [q[0], q[2], q[1]]) } else { (corners, q) };
    let [a, b, c] = corners;
    let (q1, q2, twice) = (q[1] - q[0], q[2] - q[0], area(corners));
    let (x1, y1, x2, y2) = (b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]);
    let (qx, qy) = if twice > 0.0 { ((q1 * y2 - q2 * y1) / twice, (q2 * x1 - q1 * x2) / twice) } else { (0.0, 0.0) };
    let q0 = q[0] - (a[0] * qx + a[1] * qy);
    ExactFace { x: corners.map(|c| c[0]), y: corners.map(|c| c[1]), q0, qx, qy, order, alpha, rgb, part: None }
}

/// A level face, at one distance.
fn level(corners: [[f64; 2]; 3], q: f64, alpha: f64, rgb: [f64; 3]) -> ExactFace<'static> {
    ExactFace { q0: q, qx: 0.0, qy: 0.0, ..face(corners, [q; 3], 0, alpha, rgb) }
}

/// A level face that covers the pixel.
fn cover(q: f64, alpha: f64, rgb: [f64; 3]) -> ExactFace<'static> {
    level([[-9.0, -9.0], [19.0, -9.0], [-9.0, 19.0]], q, alpha, rgb)
}

fn grey(v: f64) -> [f64; 3] {
    [v; 3]
}

/// The mean over n × n points, in the plainest way.
fn by_points(faces: &[ExactFace<'_>], background: [f64; 3], n: usize) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for i in 0..n * n {
        let (x, y) = (((i % n) as f64 + 0.5) / n as f64, ((i / n) as f64 + 0.5) / n as f64);
        let is_inside = |f: &&ExactFace<'_>| {
            (0..3).all(|k| {
                let (j, ax, ay) = ((k + 1) % 3, f.x[k], f.y[k]);
                (f.x[j] - ax) * (y - ay) - (f.y[j] - ay) * (x - ax) > 0.0
            })
        };
        let mut hits: Vec<&ExactFace<'_>> = faces.iter().filter(is_inside).collect();
        let q = |f: &ExactFace<'_>| f.q0 + f.qx * x + f.qy * y;
        hits.sort_by(|a, b| q(b).total_cmp(&q(a)).then(b.order.cmp(&a.order)));
        let mut through = 1.0;
        for hit in hits {
            for (sum, c) in sum.iter_mut().zip(hit.rgb) {
                *sum += c * hit.alpha * through;
            }
            through *= 1.0 - hit.alpha;
        }
        for (sum, c) in sum.iter_mut().zip(background) {
            *sum += c * through;
        }
    }
    sum.map(|s| s / (n * n) as f64)
}

/// A way, alone: the pixel's colour and how many faces it met.
fn by_regions(faces: &[ExactFace<'_>], background: [f64; 3]) -> [f64; 3] {
    let (mut order, mut sheets, mut cells) = (Faces::default(), Sheets::default(), Cells::default());
    order.set(faces);
    if order.len() == 0 {
        return background;
    }
    sheets.colour(faces, &order, background);
    cells.clear();
    Regions::default().colour(faces, &order, &sheets, &mut cells, background).unwrap()
}

fn by_cells(faces: &[ExactFace<'_>], background: [f64; 3]) -> [f64; 3] {
    let (mut order, mut cells, mut sum) = (Faces::default(), Cells::default(), Sum::default());
    order.set(faces);
    cells.clear();
    cells.add(faces, &order, 0, &SQUARE, 1.0, background, &mut sum).unwrap();
    sum.0
}

fn integrate(faces: &[ExactFace<'_>], background: [f64; 3]) -> [f64; 3] {
    Integrator::default().integrate(faces, background)
}

fn difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[track_caller]
fn assert_near(a: [f64; 3], b: [f64; 3], bound: f64) {
    assert!(difference(a, b) <= bound, "{a:?} is not {b:?} within {bound:e}");
}

fn shuffle<T>(random: &mut Random, items: &mut [T]) {
    for i in (1..items.len()).rev() {
        items.swap(i, random.below(i as u64 + 1) as usize);
    }
}

/// Triangles round a point in the pixel, out to a far ring of `n` points, on a grid of 1/65536.
fn fan(random: &mut Random, n: usize, radius: f64) -> Vec<ExactFace<'static>> {
    let grid = |v: f64| (v * 65536.0).round() / 65536.0;
    let centre = [grid(0.2 + 0.6 * random.unit()), grid(0.2 + 0.6 * random.unit())];
    let turn = random.unit();
    let ring: Vec<[f64; 2]> = (0..n)
        .map(|k| {
            let angle = std::f64::consts::TAU * (k as f64 + turn + 0.5 * random.unit()) / n as f64;
            [grid(centre[0] + radius * libm::cos(angle)), grid(centre[1] + radius * libm::sin(angle))]
        })
        .collect();
    let q: Vec<f64> = (0..n).map(|_| 1.0 + 0.1 * random.signed()).collect();
    (0..n)
        .map(|k| {
            let j = (k + 1) % n;
            let rgb = std::array::from_fn(|_| random.unit());
            face([centre, ring[k], ring[j]], [1.05, q[k], q[j]], k as u64, 1.0, rgb)
        })
        .collect()
}

/// Anything: faces of all sizes, slopes, saturations.
fn any_faces(random: &mut Random, count: usize, is_opaque: bool) -> Vec<ExactFace<'static>> {
    (0..count as u64)
        .map(|order| {
            let size = [0.3, 1.0, 3.0, 30.0][random.below(4) as usize];
            let corners = std::array::from_fn(|_| std::array::from_fn(|_| 0.5 + size * random.signed()));
            let tilt = [0.0, 0.2][random.below(2) as usize];
            let base = 1.0 + random.below(4) as f64 * 0.05;
            let q = std::array::from_fn(|_| base + tilt * random.signed());
            let alpha = if is_opaque || random.below(2) == 0 { 1.0 } else { random.unit() };
            face(corners, q, order, alpha, std::array::from_fn(|_| random.unit()))
        })
        .collect()
}

/// A mesh over the pixel and beyond: a grid of squares with its corners moved, each cut in two. On a grid of 1/65536.
fn mesh(random: &mut Random, squares: usize) -> Vec<ExactFace<'static>> {
    let side = 2.0 / squares as f64;
    let grid = |v: f64| (v * 65536.0).round() / 65536.0;
    let corners: Vec<([f64; 2], f64)> = (0..(squares + 1) * (squares + 1))
        .map(|i| {
            let at =
                [i % (squares + 1), i / (squares + 1)].map(|k| grid(side * (k as f64 + 0.2 * random.signed()) - 0.5));
            (at, 1.0 + 0.1 * random.signed())
        })
        .collect();
    let mut faces = Vec::new();
    for i in 0..squares * squares {
        let a = i / squares * (squares + 1) + i % squares;
        let (b, c, d) = (a + 1, a + squares + 2, a + squares + 1);
        for corner in [[a, b, c], [a, c, d]] {
            let at = corner.map(|k| corners[k]);
            let rgb = std::array::from_fn(|_| random.unit());
            faces.push(face(at.map(|c| c.0), at.map(|c| c.1), faces.len() as u64, 1.0, rgb));
        }
    }
    faces
}

#[test]
fn half_planes_have_their_area() {
    let mut random = Random(0x4A1F);
    for round in 0..2000 {
        // Through the upper and the lower side, or cutting the upper left corner off; ends and third corner at any distance.
        let (s, t) = (random.unit(), random.unit());
        let (from, to, area) =
            if round % 2 == 0 { ([s, 0.0], [t, 1.0], (s + t) / 2.0) } else { ([s, 0.0], [0.0, t], s * t / 2.0) };
        let far = [1.0, 10.0, 1e3, 1e7][round / 2 % 4];
        let along = [to[0] - from[0], to[1] - from[1]];
        let (length, past) = ((along[0] * along[0] + along[1] * along[1]).sqrt(), far * (2.0 + random.unit()));
        let end = |at: [f64; 2], by: f64| [at[0] + along[0] / length * by, at[1] + along[1] / length * by];
        let (a, b) = (end(from, -past), end(to, past));
        let third = [-along[1] / length * far * 9.0, along[0] / length * far * 9.0];
        let third = [0.5 + third[0], 0.5 + third[1]];
        let faces = [level([a, b, third], 1.0, 1.0, grey(1.0))];
        for colour in [integrate(&faces, BLACK), by_cells(&faces, BLACK)] {
            // The corners' own rounding moves the edge.
            assert_near(colour, grey(area), 1e-14 + 2e-15 * far);
        }
    }
}

#[test]
fn faces_that_share_an_edge_leave_no_gap() {
    let mut random = Random(0x6A9);
    for round in 0..2000 {
        let far = [1.0, 30.0, 1e4, 1e7][round % 4];
        let [a, b] =
            [-1.0, 1.0].map(|side| [0.5 + side * far * (1.0 + random.unit()), 0.5 + far * random.signed() * 3.0]);
        let (c, d) = ([0.5, 0.5 - 9.0 * far], [0.5, 0.5 + 9.0 * far]);
        let pair =
            [face([a, b, c], [1.0, 1.2, 0.9], 0, 1.0, grey(1.0)), face([b, a, d], [1.2, 1.0, 2.0], 1, 1.0, grey(1.0))];
        let reaches = |f: &ExactFace<'_>| integrate(&[*f], BLACK)[0];
        let areas = pair.map(|f| reaches(&f));
        assert!((areas[0] + areas[1] - 1.0).abs() < 1e-12, "{areas:?}");
        assert_near(integrate(&pair, grey(9.0)), grey(1.0), 1e-12);
        assert_near(by_regions(&pair, grey(9.0)), grey(1.0), 1e-12);
    }
}

#[test]
fn areas_of_a_triangulation_sum_to_one() {
    let mut random = Random(0x7121);
    for round in 0..300 {
        let mut faces =
            if round % 2 == 0 { mesh(&mut random, 1 + round / 20) } else { fan(&mut random, 4 + round / 12, 3.0) };
        for face in &mut faces {
            face.rgb = grey(1.0);
        }
        let sum: f64 = faces.iter().map(|f| integrate(&[*f], BLACK)[0]).sum();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        for background in [0.0, 1.0] {
            assert_near(integrate(&faces, grey(background)), grey(1.0), 1e-12);
        }
    }
}

#[test]
fn the_ways_agree_on_meshes() {
    let mut random = Random(0x3A75);
    let mut integrator = Integrator::default();
    for round in 0..300 {
        let mut faces =
            if round % 3 == 0 { fan(&mut random, 4 + round / 30, 3.0) } else { mesh(&mut random, 3 + round / 60) };
        if round % 3 == 2 {
            // Another mesh behind.
            let behind = mesh(&mut random, 3);
            faces.extend(behind.into_iter().map(|f| ExactFace { q0: f.q0 - 0.5, order: f.order + 1000, ..f }));
        }
        shuffle(&mut random, &mut faces);
        let colour = integrator.integrate(&faces, BLACK);
        assert_near(colour, by_regions(&faces, BLACK), 1e-11);
        assert_near(colour, by_cells(&faces, BLACK), 1e-11);
    }
    let counts = integrator.counts();
    assert!(counts.sheets > 50 && counts.cells == 0 && counts.sampled == 0, "{counts:?}");
}

#[test]
fn the_ways_agree_on_sheets_behind_each_other() {
    let mut random = Random(0x57AC);
    let mut integrator = Integrator::default();
    for round in 0..300 {
        let mut faces = Vec::new();
        for k in 0..2 + round % 4 {
            // One saturation each, the last one maybe opaque; now and then so near to each other that they cross.
            let alpha = if k == 0 && round % 2 == 0 { 1.0 } else { 0.1 + 0.8 * random.unit() };
            let apart = if round % 10 == 9 { 0.1 } else { 2.0 };
            let sheet = if random.below(2) == 0 { mesh(&mut random, 3) } else { fan(&mut random, 5, 3.0) };
            let number = k as u64 * 1000;
            faces.extend(sheet.into_iter().map(|f| ExactFace {
                q0: f.q0 + apart * k as f64,
                order: f.order + number,
                alpha,
                ..f
            }));
        }
        shuffle(&mut random, &mut faces);
        let colour = integrator.integrate(&faces, grey(0.3));
        assert_near(colour, by_cells(&faces, grey(0.3)), 1e-11);
        shuffle(&mut random, &mut faces);
        assert_eq!(integrator.integrate(&faces, grey(0.3)), colour);
    }
    let counts = integrator.counts();
    assert!(counts.sheets > 400 && counts.sampled == 0 && counts.quarters == 0, "{counts:?}");
}

#[test]
fn the_ways_agree_on_outlines() {
    let mut random = Random(0x0071);
    let mut integrator = Integrator::default();
    for round in 0..400 {
        // Part of a fan, side by side, before a mesh, a fan, one face, or the background.
        let mut faces = fan(&mut random, 6, [0.4, 0.9, 3.0][round % 3]);
        faces.truncate(1 + round / 4 % 5);
        for face in &mut faces {
            face.q0 += 1.0;
            face.alpha = if random.below(3) == 0 { random.unit() } else { 1.0 };
        }
        let behind = match round % 4 {
            0 => mesh(&mut random, 2),
            1 => fan(&mut random, 5, 3.0),
            2 => vec![cover(1.0, 1.0, grey(0.4))],
            _ => vec![],
        };
        faces.extend(behind);
        shuffle(&mut random, &mut faces);
        let colour = integrator.integrate(&faces, grey(0.8));
        assert_near(colour, by_regions(&faces, grey(0.8)), 1e-11);
        assert_near(colour, by_cells(&faces, grey(0.8)), 1e-11);
    }
    let counts = integrator.counts();
    assert!(counts.mosaics > 300 && counts.cells == 0 && counts.sampled == 0, "{counts:?}");
}

#[test]
fn far_corners_cost_little() {
    let mut random = Random(0xFA7);
    for round in 0..400 {
        let far = [1e3, 1e5, 1e7][round % 3];
        let mut faces = any_faces(&mut random, 3, round % 2 == 0);
        for order in 10..13 {
            let corners = std::array::from_fn(|_| std::array::from_fn(|_| 0.5 + far * random.signed()));
            let q = std::array::from_fn(|_| 1.0 + 0.5 * random.signed());
            faces.push(face(corners, q, order, [1.0, 0.5][round / 2 % 2], std::array::from_fn(|_| random.unit())));
        }
        let colour = integrate(&faces, grey(0.8));
        assert_near(colour, by_cells(&faces, grey(0.8)), 1e-8);
        if round < 60 {
            assert_near(colour, by_points(&faces, grey(0.8), 256), 4e-3);
        }
    }
}

#[test]
fn anything_is_as_dense_points_see_it() {
    let mut random = Random(0xD0_75);
    let mut integrator = Integrator::default();
    for round in 0..240 {
        let faces = any_faces(&mut random, 1 + round % 12, round % 3 == 0);
        let background = std::array::from_fn(|_| random.unit());
        let colour = integrator.integrate(&faces, background);
        // An edge misjudges up to 2 · 256 of the 256² points by up to half of the cell each; in sum far less, for signs alternate.
        assert_near(colour, by_points(&faces, background, 256), 4e-3);
        assert_near(colour, by_cells(&faces, background), 1e-9);
    }
    let counts = integrator.counts();
    assert!(counts.cells > 10 && counts.regions > 10 && counts.sampled == 0, "{counts:?}");
}

/// Corners on the pixel's border, edges on edges, needles, equal and level planes.
#[test]
fn the_unlucky_agree_too() {
    let mut random = Random(0x6E1D);
    let mut integrator = Integrator::default();
    for round in 0..6000 {
        let steps = [2.0, 4.0, 8.0, 65536.0][random.below(4) as usize];
        let spread = [1.0, 2.0, 6.0][random.below(3) as usize];
        let is_opaque = random.below(2) == 0;
        let faces: Vec<_> = (0..1 + random.below(9))
            .map(|order| {
                let corners = std::array::from_fn(|_| {
                    std::array::from_fn(|_| ((0.5 + spread * random.signed()) * steps).round() / steps)
                });
                let q = match random.below(3) {
                    0 => [1.0; 3],
                    1 => std::array::from_fn(|_| 1.0 + (random.signed() * 2.0).round() / 8.0),
                    _ => std::array::from_fn(|_| 1.0 + 0.2 * random.signed()),
                };
                let alpha = if is_opaque { 1.0 } else { [1.0, 0.5][random.below(2) as usize] };
                let made = face(corners, q, order, alpha, std::array::from_fn(|_| random.unit()));
                if q == [1.0; 3] { ExactFace { q0: 1.0, qx: 0.0, qy: 0.0, ..made } } else { made }
            })
            .collect();
        let colour = integrator.integrate(&faces, grey(0.8));
        let cells = by_cells(&faces, grey(0.8));
        assert!(difference(colour, cells) < 1e-9, "round {round}: {colour:?} {cells:?} {faces:#?}");
        if round % 16 == 0 {
            assert_near(colour, by_points(&faces, grey(0.8), 64), 4e-2);
        }
    }
    assert_eq!(integrator.counts().sampled, 0);
}

#[test]
fn the_order_of_the_list_has_no_say() {
    let mut random = Random(0x0DE5);
    let mut integrator = Integrator::default();
    for round in 0..400 {
        let mut faces = match round % 4 {
            0 => fan(&mut random, 4 + round / 40, 3.0),
            1 => mesh(&mut random, 3),
            2 => any_faces(&mut random, 8, true),
            _ => any_faces(&mut random, 8, false),
        };
        // Coplanar layers, and pieces of one face.
        faces.push(ExactFace { order: 77, rgb: grey(0.3), ..faces[0] });
        let colour = integrator.integrate(&faces, grey(0.25)).map(f64::to_bits);
        for _ in 0..4 {
            shuffle(&mut random, &mut faces);
            assert_eq!(integrator.integrate(&faces, grey(0.25)).map(f64::to_bits), colour);
        }
    }
}

#[test]
fn of_coplanar_faces_the_later_is_seen() {
    let paint = |order, alpha, rgb| ExactFace { order, qx: 0.1, qy: -0.2, ..cover(1.0, alpha, rgb) };
    let faces = [paint(3, 1.0, grey(0.1)), paint(7, 1.0, grey(0.9)), paint(5, 1.0, grey(0.5))];
    assert_near(integrate(&faces, BLACK), grey(0.9), 1e-15);
    let faces = [paint(3, 1.0, grey(0.1)), paint(7, 0.5, grey(0.9)), paint(5, 1.0, grey(0.5))];
    assert_near(integrate(&faces, BLACK), grey(0.7), 1e-15);
}

/// A sheet's faces may lie about another coplanar face in the order.
#[test]
fn of_a_level_sheet_and_a_face_in_its_plane_each_part_shows_the_later() {
    let half = |order, rgb, third| ExactFace { order, ..level([[-9.0, -9.0], [10.0, 10.0], third], 1.0, 1.0, rgb) };
    let (upper, lower) = (half(3, grey(0.1), [20.0, -19.0]), half(1, grey(0.3), [-19.0, 20.0]));
    let between = ExactFace { order: 2, ..cover(1.0, 1.0, grey(0.9)) };
    assert_near(integrate(&[lower, between, upper], BLACK), grey(0.5), 1e-13);
}

#[test]
fn interpenetrating_planes_part_where_they_meet() {
    let mut random = Random(0x1417);
    for _ in 0..1000 {
        // Equally near on the line from (s, 0) to (t, 1); left of it the first is nearer.
        let (s, t, steep) = (random.unit(), random.unit(), 1e-3 + random.unit());
        let slope = |f: ExactFace<'static>| ExactFace { q0: f.q0 + steep * s, qx: -steep, qy: steep * (t - s), ..f };
        let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        let left = (s + t) / 2.0;
        let opaque = [slope(cover(1.0, 1.0, red)), cover(1.0, 1.0, blue)];
        assert_near(integrate(&opaque, BLACK), [left, 0.0, 1.0 - left], 1e-11);
        let panes = [slope(cover(1.0, 0.5, red)), cover(1.0, 0.25, blue)];
        let in_front = |near: f64, far: f64| near * far;
        let red = left * 0.5 + (1.0 - left) * in_front(0.75, 0.5);
        let blue = (1.0 - left) * 0.25 + left * in_front(0.5, 0.25);
        assert_near(integrate(&panes, BLACK), [red, 0.0, blue], 1e-11);
    }
}

#[test]
fn three_faces_that_overlap_in_a_circle() {
    let mut random = Random(0xC1C);
    let mut integrator = Integrator::default();
    for _ in 0..30 {
        // Each a long blade along one side of a triangle, near at one end and far at the other.
        let turn = random.unit();
        let at = |angle: f64, r: f64| {
            let angle = std::f64::consts::TAU * (angle + turn);
            [0.5 + r * libm::cos(angle), 0.5 + r * libm::sin(angle)]
        };
        let blade = |k: f64| {
            let rgb = std::array::from_fn(|c| if c as f64 == k { 1.0 } else { 0.1 });
            let (from, to) = (at(k / 3.0 - 0.08, 0.9), at(k / 3.0 + 0.42, 0.9));
            face([from, to, at(k / 3.0 + 0.52, 0.9)], [1.5, 0.5, 0.5], k as u64, 1.0, rgb)
        };
        let mut faces: Vec<_> = [0.0, 1.0, 2.0].into_iter().map(blade).collect();
        let colour = integrator.integrate(&faces, grey(0.3));
        assert_near(colour, by_points(&faces, grey(0.3), 512), 2e-3);
        assert_near(colour, by_cells(&faces, grey(0.3)), 1e-11);
        faces.reverse();
        assert_eq!(integrator.integrate(&faces, grey(0.3)), colour);
    }
}

#[test]
fn translucent_layers_are_laid_over_each_other_whatever_their_order() {
    let mut random = Random(0x1A7E);
    for count in 1..40 {
        let mut faces: Vec<_> =
            (0..count).map(|k| cover(2.0 - f64::from(k) * 0.01, random.unit(), grey(random.unit()))).collect();
        let (mut expected, mut through) = (0.0, 1.0);
        for face in &faces {
            expected += face.rgb[0] * face.alpha * through;
            through *= 1.0 - face.alpha;
        }
        shuffle(&mut random, &mut faces);
        assert_near(integrate(&faces, grey(0.4)), grey(expected + 0.4 * through), 1e-14);
    }
}

fn of_model<'a>(face: ExactFace<'a>, model: u32, version: usize, weights: &'a [f64], merged: bool) -> ExactFace<'a> {
    let is_translucent = face.alpha < 1.0;
    ExactFace { part: Some(Part { member: Member { model, version, weights, merged }, is_translucent }), ..face }
}

#[test]
fn a_merged_model_counts_its_nearest_layer_only() {
    let weights = [1.0];
    let left = |q, alpha, rgb| level([[0.5, -50.0], [0.5, 50.0], [-60.0, 0.5]], q, alpha, rgb);
    let puff = |face| of_model(face, 4, 0, &weights, true);
    let faces = [puff(cover(1.0, 0.5, grey(0.2))), puff(left(2.0, 0.25, grey(0.8))), cover(0.5, 1.0, grey(0.6))];
    let left = 0.25 * 0.8 + 0.75 * 0.6;
    let right = 0.5 * 0.2 + 0.5 * 0.6;
    assert_near(integrate(&faces, BLACK), grey((left + right) / 2.0), 1e-13);
}

#[test]
fn a_model_in_transition_is_the_weighted_mean_of_its_versions() {
    let mut random = Random(0x7A5);
    for round in 0..100 {
        let w = random.unit();
        let weights = [w, 1.0 - w];
        let faces = any_faces(&mut random, 8, round % 2 == 0);
        let version = |k: usize| if k % 3 == 2 { None } else { Some(k % 3) };
        let shown = |v: usize| -> Vec<ExactFace<'static>> {
            (0..8).filter(|k| version(*k).is_none_or(|own| own == v)).map(|k| faces[k]).collect()
        };
        let [first, second] = [0, 1].map(|v| integrate(&shown(v), grey(0.5)));
        let mean = std::array::from_fn(|c| first[c] * w + second[c] * (1.0 - w));
        let own = |k: usize| version(k).map_or(faces[k], |v| of_model(faces[k], 9, v, &weights, false));
        let mut mixed: Vec<_> = (0..8).map(own).collect();
        let colour = integrate(&mixed, grey(0.5));
        assert_near(colour, mean, 1e-9);
        // The rule itself, for each cell.
        assert_near(colour, by_cells(&mixed, grey(0.5)), 1e-9);
        shuffle(&mut random, &mut mixed);
        assert_eq!(integrate(&mixed, grey(0.5)), colour);
    }
}

/// Needles from side to side through a square of that side about the pixel's centre, where they cross each other.
fn needles(random: &mut Random, side: f64) -> Vec<ExactFace<'static>> {
    let needle = |k: u64| {
        let mut end = |at: f64| [0.5 + (random.unit() - 0.5) * side, at];
        let (a, b) = (end(-1.0), end(2.0));
        let (a, b) = if k.is_multiple_of(2) { (a, b) } else { ([a[1], a[0]], [b[1], b[0]]) };
        let q = 1.0 + random.unit();
        face([a, b, [b[0] + 0.01, b[1] + 0.01]], [q; 3], k, 0.5, grey(random.unit()))
    };
    (0..150).map(needle).collect()
}

#[test]
fn too_much_for_a_pixel_is_done_in_quarters() {
    let mut random = Random(0x2B16);
    // Their arrangement has some ten thousand cells.
    let mut faces = needles(&mut random, 1.0);
    let mut integrator = Integrator::default();
    let colour = integrator.integrate(&faces, grey(0.5));
    assert_eq!(integrator.counts(), Counts { quarters: 1, ..Counts::default() });
    assert_near(colour, by_points(&faces, grey(0.5), 1024), 5e-4);
    shuffle(&mut random, &mut faces);
    assert_eq!(integrator.integrate(&faces, grey(0.5)), colour);
    // Every quarter by itself, as a pixel of faces that are twice as large.
    let mut mean = [0.0; 3];
    for (left, top) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let enlarged = |face: &ExactFace<'static>| {
            let q0 = face.q0 + 0.5 * (left * face.qx + top * face.qy);
            let (x, y) = (face.x.map(|x| 2.0 * x - left), face.y.map(|y| 2.0 * y - top));
            ExactFace { x, y, q0, qx: 0.5 * face.qx, qy: 0.5 * face.qy, ..*face }
        };
        let own: Vec<_> = faces.iter().map(enlarged).collect();
        let part = integrate(&own, grey(0.5));
        mean = std::array::from_fn(|c| mean[c] + 0.25 * part[c]);
    }
    assert_near(colour, mean, 1e-12);
}

#[test]
fn too_much_for_the_smallest_square_is_sampled_and_counted() {
    let faces = needles(&mut Random(0x2B16), 0.01);
    let mut integrator = Integrator::default();
    let colour = integrator.integrate(&faces, grey(0.5));
    assert_eq!(integrator.counts(), Counts { sampled: 1, ..Counts::default() });
    assert_near(colour, by_points(&faces, grey(0.5), 1024), 1e-3);
}

#[test]
fn what_is_no_face_or_hardly_one_changes_nothing() {
    let good = [cover(1.0, 1.0, grey(0.25)), level([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], 2.0, 1.0, grey(0.75))];
    let nan = f64::NAN;
    let infinite = f64::INFINITY;
    let tiny = 5e-324;
    let bad: [(&str, [[f64; 2]; 3]); 10] = [
        ("a point", [[0.5, 0.5]; 3]),
        ("a line", [[0.0, 0.0], [0.5, 0.5], [1.0, 1.0]]),
        ("a line that is one to rounding", [[0.1, 0.1], [0.2, 0.2], [0.3, 0.3 + 1e-16]]),
        ("a needle", [[0.1, 0.1], [0.9, 0.9], [0.9, 0.9 + 1e-14]]),
        ("a denormal", [[0.0, 0.0], [tiny, 0.0], [tiny, tiny]]),
        ("a flat denormal", [[0.0, 0.0], [1.0, 0.0], [1.0, tiny]]),
        ("a far needle", [[-1e7, 0.5], [1e7, 0.5], [1e7, 0.5 + 1e-9]]),
        ("beside the pixel", [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0]]),
        ("not a number", [[nan, 0.0], [1.0, 0.0], [1.0, 1.0]]),
        ("infinite", [[0.0, 0.0], [infinite, 0.0], [infinite, infinite]]),
    ];
    for (name, corners) in bad {
        for alpha in [1.0, 0.5] {
            let mut faces = good.to_vec();
            faces.push(level(corners, 3.0, alpha, grey(1.0)));
            let colour = integrate(&faces, BLACK);
            assert!(difference(colour, grey(0.5)) < 1e-6, "{name}: {colour:?}");
        }
    }
    let absent = [good[0], good[1], cover(3.0, 0.0, grey(1.0))];
    assert_near(integrate(&absent, BLACK), grey(0.5), 1e-14);
    let mut reversed = cover(3.0, 1.0, grey(1.0));
    reversed.x.swap(0, 1);
    reversed.y.swap(0, 1);
    assert_near(integrate(&[good[0], good[1], reversed], BLACK), grey(0.5), 1e-14);
}

proptest! {
    /// Coordinates of every magnitude, on the grid and off it, repeated and collinear.
    #[test]
    fn nothing_breaks_it(
        seed in 1u64..u64::MAX,
        count in 0usize..14,
        exponents in proptest::collection::vec(-30i32..24, 6),
    ) {
        let mut random = Random(seed);
        let value = |random: &mut Random| {
            let scale = libm::exp2(f64::from(exponents[random.below(6) as usize]));
            match random.below(6) {
                0 => 0.0,
                1 => 1.0,
                2 => 0.5,
                3 => (random.signed() * 4.0).round() / 4.0,
                _ => 0.5 + scale * random.signed(),
            }
        };
        let faces: Vec<_> = (0..count as u64)
            .map(|order| {
                let corners = std::array::from_fn(|_| std::array::from_fn(|_| value(&mut random)));
                let q = std::array::from_fn(|_| 1.0 + value(&mut random).abs());
                let alpha = [1.0, 1.0, 0.5][random.below(3) as usize];
                face(corners, q, order, alpha, grey(1.0))
            })
            .collect();
        let white = integrate(&faces, grey(1.0));
        prop_assert!(difference(white, grey(1.0)) < 1e-6, "{white:?}");
        let colour = integrate(&faces, BLACK);
        prop_assert!(colour[0] >= -1e-6 && colour[0] <= 1.0 + 1e-6, "{colour:?}");
        let mut again = faces.clone();
        shuffle(&mut random, &mut again);
        prop_assert_eq!(integrate(&again, BLACK).map(f64::to_bits), colour.map(f64::to_bits));
    }
}

#[test]
#[ignore = "a measurement: run it with --release --ignored --nocapture on a quiet machine"]
fn nanoseconds_per_pixel() {
    let mut random = Random(0xBE7C4);
    let two = |random: &mut Random| {
        let (x, lean) = (0.2 + 0.6 * random.unit(), 5.0 * random.signed());
        let (a, b) = ([x - lean, -5.5], [x + lean, 6.5]);
        vec![
            face([a, b, [-28.0, 0.0]], [1.0, 1.1, 1.2], 0, 1.0, grey(0.2)),
            face([b, a, [29.0, 1.0]], [1.1, 1.0, 0.9], 1, 1.0, grey(0.7)),
        ]
    };
    let outline = |random: &mut Random| {
        let mut faces = two(random);
        for face in &mut faces {
            face.q0 += 1.0;
        }
        faces.remove(1);
        let behind = two(random);
        faces.extend(behind);
        faces
    };
    let fan_before_fan = |random: &mut Random| {
        let mut faces = fan(random, 6, 3.0);
        faces.truncate(3);
        for face in &mut faces {
            face.q0 += 1.0;
        }
        faces.extend(fan(random, 5, 3.0));
        faces
    };
    let layers = |random: &mut Random| {
        (0..12)
            .map(|k| {
                let mut faces = two(random);
                let mut face = faces.swap_remove(k % 2);
                (face.q0, face.qx, face.qy) = (2.0 + k as f64, 0.0, 0.0);
                face.alpha = 0.3;
                face
            })
            .collect()
    };
    let whole_layers = |random: &mut Random| (0..12).map(|_| cover(1.0 + random.unit(), 0.3, grey(0.5))).collect();
    let two_before_three = |random: &mut Random| {
        let mut faces = fan(random, 6, 3.0);
        faces.truncate(2);
        for face in &mut faces {
            face.q0 += 1.0;
        }
        // A fan whose centre is beside the pixel, of which three faces or so reach it.
        let behind = fan(random, 8, 6.0);
        faces.extend(behind.into_iter().map(|f| ExactFace { x: f.x.map(|x| x - 0.9), ..f }));
        faces
    };
    let crossing = |random: &mut Random| {
        let mut faces = two(random);
        let mut others = two(random);
        for face in &mut others {
            let centre = face.q0 + 0.5 * (face.qx + face.qy);
            (face.q0, face.qx, face.qy) = (centre, 0.0, 0.0);
        }
        faces.append(&mut others);
        faces
    };
    let weights = [0.3, 0.7];
    let transition = |random: &mut Random| {
        let (first, second) = (fan(random, 4, 3.0), fan(random, 4, 9.0));
        let first = first.into_iter().map(|f| of_model(f, 1, 0, &weights, false));
        first.chain(second.into_iter().map(|f| of_model(f, 1, 1, &weights, false))).collect()
    };
    type Make<'a> = &'a dyn Fn(&mut Random) -> Vec<ExactFace<'a>>;
    let cases: [(&str, Make<'_>); 14] = [
        ("1 face, no edge", &|_| vec![cover(1.0, 1.0, grey(0.5))]),
        ("2 faces, 1 edge", &two),
        ("outline: 1 face before 2", &outline),
        ("outline: 2 faces before 3", &two_before_three),
        ("outline: 3 of a fan before a fan of 5", &fan_before_fan),
        ("fan of 6", &|random| fan(random, 6, 3.0)),
        ("fan of 6, and all round it", &|random| fan(random, 6, 0.9)),
        ("a mesh, some 30 faces in the pixel", &|random| mesh(random, 6)),
        ("a mesh, some 140 faces in the pixel", &|random| mesh(random, 15)),
        ("such a mesh without one face", &|random| {
            let mut faces = mesh(random, 15);
            faces.remove(15 * 15);
            faces
        }),
        ("2 faces through 2 others", &crossing),
        ("a fan of 4 in transition to another", &transition),
        ("12 whole translucent layers", &whole_layers),
        ("12 translucent layers with edges", &layers),
    ];
    for (name, make) in cases {
        let pixels: Vec<Vec<ExactFace<'_>>> = (0..256)
            .map(|_| {
                let mut faces = make(&mut random);
                shuffle(&mut random, &mut faces);
                faces
            })
            .collect();
        let mut integrator = Integrator::default();
        let mut times = Vec::new();
        let mut sum = 0.0;
        for _ in 0..41 {
            let start = std::time::Instant::now();
            for faces in &pixels {
                sum += integrator.integrate(std::hint::black_box(faces), grey(0.1))[0];
            }
            times.push(start.elapsed().as_nanos() as f64 / pixels.len() as f64);
        }
        times.sort_by(f64::total_cmp);
        let counts = integrator.counts();
        assert!(sum.is_finite(), "{name}: {sum}");
        println!("{name}: {:.0} ns (least {:.0}); {counts:?}", times[20], times[0]);
    }
}
