//! Coverage, area and order of flat faces.

use super::*;
use crate::coverage::{hits, side};
use crate::{Grid, Options, Vertices, integrate, points, sample};

const WHITE: [f32; 3] = [1.0; 3];
const BLACK: [f32; 3] = [0.0; 3];

fn integral(world: &World<'_>, state: &FrameState) -> crate::Picture {
    let picture = integrate(world, state, &view(), Vertices::Exact, 0.125).unwrap();
    assert_eq!(picture.sampled_instead, 0);
    picture
}

#[test]
fn a_half_plane_counts_with_its_area() {
    let meshes = [mesh(&rectangle(-8.0, -8.0, 2.25, 16.0, 3.0), paint(WHITE))];
    let picture = integral(&world(&meshes), &state(BLACK));
    for y in 0..SIDE {
        for (x, want) in [1.0, 1.0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0].into_iter().enumerate() {
            assert_close(picture.at(x as u32, y), [want; 3], 1e-12);
        }
    }
    let sampled = sample(&world(&meshes), &state(BLACK), &view(), &Options::truth(64, 64));
    assert_close(sampled.at(2, 3), [0.25; 3], 1e-12);
    let edges: Vec<bool> = (0..SIDE).map(|x| sampled.kinds[x as usize].is_edge).collect();
    assert_eq!(edges, [false, false, true, false, false, false, false, false]);
}

#[test]
fn the_ring_makes_a_pixel_beside_an_edge_an_edge_pixel() {
    let meshes = [mesh(&rectangle(-8.0, -8.0, 1.9, 16.0, 3.0), paint(WHITE))];
    for (spacing, want) in [(0.25, true), (0.0625, false)] {
        let options = Options { spacing: Some(spacing), ..Options::truth(64, 64) };
        let picture = sample(&world(&meshes), &state(BLACK), &view(), &options);
        assert_eq!(picture.kinds[2].is_edge, want, "0.1 pixel beside the edge, spacing {spacing}");
    }
}

#[test]
fn triangles_have_their_area() {
    let mut random = Random(1);
    for _ in 0..50 {
        let corners: [[f64; 2]; 3] = std::array::from_fn(|_| [random.between(0.5, 7.5), random.between(0.5, 7.5)]);
        let depths: [f64; 3] = std::array::from_fn(|_| random.between(1.0, 50.0));
        let points: [DVec3; 3] = std::array::from_fn(|k| on_screen(corners[k][0], corners[k][1], depths[k]));
        let material = Material { double_sided: true, ..paint(WHITE) };
        let meshes = [mesh(&points, material)];
        let sum: f64 = integral(&world(&meshes), &state(BLACK)).linear.iter().map(|c| c[0]).sum();
        let want = side(corners[0], corners[1], corners[2]).abs() / 2.0;
        // Positions are f32: each corner is wrong by up to 1e-6 pixel.
        assert!((sum - want).abs() < 2e-5, "{sum} instead of {want}");
    }
}

#[test]
fn the_integral_of_what_fills_the_pixel_is_its_colour() {
    let mut random = Random(2);
    let mut points = Vec::new();
    // A fan of triangles round a point, all over the screen: shared edges everywhere.
    let turn = |k: usize| {
        let (sin, cos) = (k as f64 / 17.0 * std::f64::consts::TAU).sin_cos();
        on_screen(3.3 - 30.0 * cos, 4.1 - 30.0 * sin, 20.0)
    };
    for k in 0..17 {
        points.extend([on_screen(3.3, 4.1, 10.0), turn(k + 1), turn(k)]);
    }
    let meshes = [mesh(&points, glass(WHITE, 0.25))];
    for picture in [
        integral(&world(&meshes), &state(BLACK)),
        sample(&world(&meshes), &state(BLACK), &view(), &Options::truth(256, 64)),
        sample(
            &world(&meshes),
            &state(BLACK),
            &view(),
            &Options::like(Vertices::Rounded(Grid::PIPELINE), &[[random.next(), random.next()], [0.5, 0.5]]),
        ),
    ] {
        for color in &picture.linear {
            assert_close(*color, [0.25; 3], 1e-12);
        }
    }
}

#[test]
fn a_point_on_a_shared_edge_or_corner_is_hit_once() {
    // A grid of squares, each cut into two triangles either way; all points on a four times finer grid.
    for flip in [false, true] {
        let mut triangles = Vec::new();
        for x in 0..4 {
            for y in 0..4 {
                let [a, b, c, d] = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(|p| p.map(f64::from));
                triangles.extend(if flip { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] });
            }
        }
        for i in 0..16 {
            for j in 0..16 {
                let point = [f64::from(i) / 4.0, f64::from(j) / 4.0];
                assert_eq!(triangles.iter().filter(|t| hits(t, point)).count(), 1, "{point:?}");
            }
        }
    }
}

#[test]
fn two_panes_mix_by_the_formula() {
    let meshes = [
        mesh(&wall(4.0), glass([0.0, 1.0, 0.0], 0.25)),
        mesh(&wall(3.0), glass([1.0, 0.0, 0.0], 0.5)),
        mesh(&wall(9.0), paint([0.0, 0.0, 1.0])),
    ];
    for picture in [
        integral(&world(&meshes), &state(WHITE)),
        sample(&world(&meshes), &state(WHITE), &view(), &Options::truth(4, 4)),
    ] {
        assert_close(picture.at(3, 3), [0.5, 0.125, 0.375], 1e-12);
        assert!(picture.kinds.iter().all(|kind| !kind.is_edge), "the two halves of a quad lie in one plane");
    }
}

#[test]
fn interpenetrating_faces_part_where_their_depths_are_equal() {
    // 1/w of the slanted one falls from 1/2 at x = 0 to 1/8 at x = 8; it meets 1/4 at x = 16/3.
    let slanted =
        quad([on_screen(0.0, 8.0, 2.0), on_screen(8.0, 8.0, 8.0), on_screen(8.0, 0.0, 8.0), on_screen(0.0, 0.0, 2.0)]);
    let meshes = [mesh(&wall(4.0), paint(BLACK)), mesh(&slanted, paint(WHITE))];
    let picture = integral(&world(&meshes), &state([0.5; 3]));
    for (x, want) in [1.0, 1.0, 1.0, 1.0, 1.0, 1.0 / 3.0, 0.0, 0.0].into_iter().enumerate() {
        assert_close(picture.at(x as u32, 5), [want; 3], 1e-12);
    }
}

#[test]
fn three_faces_that_overlap_in_a_circle_are_all_in_front_of_one_another() {
    // Bars along the sides of a triangle, each in front of the next at one end and behind the one before at its other.
    let corners = [[1.0, 1.0], [7.0, 1.5], [3.5, 7.0]];
    let colors = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let bar = |k: usize| {
        let ([ax, ay], [bx, by]) = (corners[k], corners[(k + 1) % 3]);
        let (dx, dy) = ((bx - ax) * 0.2, (by - ay) * 0.2);
        let (nx, ny) = (-dy * 0.6, dx * 0.6);
        let near = |s: f64| on_screen(ax - dx + s * nx, ay - dy + s * ny, 4.0);
        let far = |s: f64| on_screen(bx + dx + s * nx, by + dy + s * ny, 6.0);
        mesh(&quad([near(-1.0), near(1.0), far(1.0), far(-1.0)]), Material { double_sided: true, ..paint(colors[k]) })
    };
    let pictures: Vec<_> =
        [[0, 1, 2], [2, 1, 0], [1, 2, 0]].map(|order| integral(&world(&order.map(bar)), &state(BLACK))).into();
    let meshes = [bar(0), bar(1), bar(2)];
    let sampled = sample(&world(&meshes), &state(BLACK), &view(), &Options::truth(16_384, 64));
    for (i, color) in pictures[0].linear.iter().enumerate() {
        assert_close(pictures[1].linear[i], *color, 1e-9);
        assert_close(pictures[2].linear[i], *color, 1e-9);
        assert_close(sampled.linear[i], *color, 1e-3);
    }
    // At each corner the bar that begins there lies over the one that ends there.
    for (k, [x, y]) in corners.into_iter().enumerate() {
        let at = pictures[0].at(x as u32, y as u32);
        let (begins, ends) = (at[k], at[(k + 2) % 3]);
        assert!(begins > ends, "corner {k}: {at:?}");
    }
}

#[test]
fn integral_and_many_samples_agree_on_random_heaps() {
    let mut random = Random(7);
    for translucent in [false, true] {
        let meshes: Vec<Mesh> = (0..30)
            .map(|_| {
                let points: [DVec3; 3] = std::array::from_fn(|_| {
                    on_screen(random.between(-2.0, 10.0), random.between(-2.0, 10.0), random.between(1.0, 20.0))
                });
                let color: [f32; 3] = std::array::from_fn(|_| random.next() as f32);
                let material = if translucent { glass(color, random.next() as f32) } else { paint(color) };
                mesh(&points, Material { double_sided: true, ..material })
            })
            .collect();
        let truth = integral(&world(&meshes), &state(BLACK));
        let sampled = sample(&world(&meshes), &state(BLACK), &view(), &Options::truth(4096, 64));
        let worst = truth.linear.iter().flatten().zip(sampled.linear.iter().flatten());
        let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        println!("30 triangles, translucent: {translucent}: 4096 points are within {worst:.1e} of the integral");
        assert!(worst < 5e-3, "{worst}");
    }
}

#[test]
fn what_reaches_behind_the_near_plane_is_cut_there() {
    // The ground, 1 m below the eye and right through under it: its horizon is at y = 4.
    let ground = quad([
        DVec3::new(-1e6, -1.0, 1e6),
        DVec3::new(1e6, -1.0, 1e6),
        DVec3::new(1e6, -1.0, -1e6),
        DVec3::new(-1e6, -1.0, -1e6),
    ]);
    let meshes = [mesh(&ground, paint(WHITE))];
    for grid in [None, Grid::PIPELINE.limit_pixels] {
        let vertices = Vertices::Rounded(Grid { limit_pixels: grid, ..Grid::PIPELINE });
        let rounded = sample(&world(&meshes), &state(BLACK), &view(), &Options::like(vertices, &points::spread(16)));
        let exact = integral(&world(&meshes), &state(BLACK));
        for y in 0..SIDE {
            let want = if y < 4 { 0.0 } else { 1.0 };
            assert_close(rounded.at(5, y), [want; 3], 1e-12);
            assert_close(exact.at(5, y), [want; 3], 1e-5);
        }
    }
    let behind = [mesh(&wall(0.05), paint(WHITE)), mesh(&wall(-3.0), paint(WHITE))];
    assert_close(integral(&world(&behind), &state(BLACK)).at(3, 3), [0.0; 3], 0.0);
}

#[test]
fn rounded_vertices_lie_on_the_grid() {
    // An edge at 2.25 + 0.4/256 is rounded to 2.25, one at 2.25 + 0.6/256 to the next.
    for (part, point, want) in [(0.4, 0.25 + 0.2 / 256.0, 0.0), (0.6, 0.25 + 0.8 / 256.0, 1.0)] {
        let meshes = [mesh(&rectangle(-8.0, -8.0, 2.25 + part / 256.0, 16.0, 4.0), paint(WHITE))];
        let options = Options::like(Vertices::Rounded(Grid::PIPELINE), &[[point, 0.5]]);
        assert_close(sample(&world(&meshes), &state(BLACK), &view(), &options).at(2, 2), [want; 3], 0.0);
    }
}

#[test]
fn nonsense_makes_no_nan_and_no_panic() {
    let mut random = Random(5);
    let mut points = Vec::new();
    for k in 0..60 {
        let scale = 10f64.powi(k % 20 - 8);
        for _ in 0..3 {
            points.push(
                DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0)) * scale,
            );
        }
    }
    points.extend([DVec3::ZERO; 3]);
    points.extend([DVec3::new(1.0, 1.0, -1.0), DVec3::new(1.0, 1.0, -1.0), DVec3::new(2.0, 1.0, -3.0)]);
    let material = Material { double_sided: true, ..Material::default() };
    let meshes = [mesh(&points, material), mesh(&points, Material { alpha: Alpha::Blend, ..material })];
    let sky = FrameState { environment: Environment::default(), ..state(BLACK) };
    let options = Options::like(Vertices::Rounded(Grid::PIPELINE), &points::spread(4));
    for picture in [sample(&world(&meshes), &sky, &view(), &options), integral(&world(&meshes), &sky)] {
        assert!(picture.linear.iter().flatten().all(|c| c.is_finite() && *c >= 0.0));
    }
}
