//! Coverage of faces that are cut, sample by sample in integers.
//!
//! What a cut face covers is the polygon of its rounded corners. The pipeline draws it as a fan of triangles by their edge functions;
//! here it is asked how often the polygon's outline runs round a sample, by counting the edges that cross the line from
//! the sample to the left: another method, which needs no fan and knows no convexity, so a fan that left a gap, counted a sample
//! twice or filled a dent would show. An edge counts from its upper end, included, to its lower, excluded, and a sample on it has it on
//! its left: that is the top-left rule, said once for any outline.
//!
//! Where the corners are is shown apart, by rational arithmetic.
//!
//! Rounding may make the outline of a sliver cross itself. No fan of triangles is such a figure, and there is no right
//! answer: where it lies turned over, its neighbours overlap already. These are counted, about one in 7000; of every four, one has
//! a sample that is drawn otherwise than the outline says.

use super::{mesh_of_face, random_vector, report, snapped};
use crate::geometry::camera::Camera;
use crate::geometry::clip::{ClippedFace, outside};
use crate::geometry::setup::area_twice;
use crate::oracle::*;
use crate::picture_tests::ALL_SAMPLES;
use crate::samples::Pattern;
use glam::{DAffine3, DVec3};
use proptest::prelude::*;
use proto::scene::Mesh;
use proto::view::{Samples, View};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// Screen position, sub.
type Sub = [i32; 2];

/// The rounded corners of what is left of a face given in the eye's frame; none if nothing is.
fn rounded(camera: &Camera, corners: [DVec3; 3]) -> Vec<Sub> {
    ClippedFace::new(camera, corners.map(|corner| camera.view_point(corner)))
        .map(|clipped| clipped.corners().iter().map(|corner| camera.project_sub(corner.point)).collect())
        .unwrap_or_default()
}

fn is_cut(camera: &Camera, corners: &[DVec3; 3]) -> bool {
    corners.iter().any(|corner| outside(camera, camera.view_point(*corner)) != 0)
}

fn edges(polygon: &[Sub]) -> impl Iterator<Item = (Sub, Sub)> {
    (0..polygon.len()).map(|k| (polygon[k], polygon[(k + 1) % polygon.len()]))
}

/// How often edges run round a sample clockwise as seen, less how often the other way.
fn turns(edges: impl IntoIterator<Item = (Sub, Sub)>, [x, y]: Sub) -> i32 {
    let mut turns = 0;
    for (from, to) in edges {
        if (from[1] <= y) != (to[1] <= y) {
            let [dx, dy] = [0, 1].map(|axis| i128::from(to[axis]) - i128::from(from[axis]));
            let side = (i128::from(x) - i128::from(from[0])) * dy - (i128::from(y) - i128::from(from[1])) * dx;
            let runs_down = dy > 0;
            if if runs_down { side >= 0 } else { side <= 0 } {
                turns += if runs_down { -1 } else { 1 };
            }
        }
    }
    turns
}

/// The sample positions of each pixel of a view, row by row.
fn samples(view: &View) -> Vec<Vec<Sub>> {
    let pattern = Pattern::of(view.samples);
    let pixels = (0..view.height as i32).flat_map(|y| (0..view.width as i32).map(move |x| [x * 256, y * 256]));
    pixels.map(|[x, y]| pattern.points[..pattern.count].iter().map(|[dx, dy]| [x + dx, y + dy]).collect()).collect()
}

/// Whether a corner sees all others in order: then the polygon is the sum of its fan.
fn has_fan_at(polygon: &[Sub], apex: usize) -> bool {
    let n = polygon.len();
    let area = |k: usize| area_twice(polygon[apex], polygon[(apex + k) % n], polygon[(apex + k + 1) % n]).signum();
    (1..n - 1).all(|k| area(k) >= 0) || (1..n - 1).all(|k| area(k) <= 0)
}

/// Whether some corner has one. Only a polygon that crosses itself, or is dented twice, has none.
fn has_a_fan(polygon: &[Sub]) -> bool {
    (0..polygon.len()).any(|apex| has_fan_at(polygon, apex))
}

/// What a test counted.
#[derive(Debug, Default)]
struct Tally {
    faces: u64,
    crossed: u64,
    crossed_wrong: u64,
    samples: u64,
    covered: u64,
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// Sizes and distances from 1e-9 to 1e9 m, near planes among them: cut at the near plane, at the guard band, at both.
    #[test]
    fn random_cut_triangles_of_every_magnitude(
        seed in 1u64..,
        distance_log in -9.0f64..9.0,
        size_log in -9.0f64..9.0,
        near_log in -1.5f64..1.0,
        pattern in 0usize..5,
    ) {
        thread_local! { static TALLY: RefCell<Tally> = RefCell::default(); }
        let mut random = Random(seed);
        let power = |log: f64| libm::exp2(log * std::f64::consts::LOG2_10);
        let (distance, size) = (power(distance_log), power(size_log));
        let view = View { near: distance * power(near_log), ..view(24, 18, ALL_SAMPLES[pattern]) };
        let camera = Camera::new(&state(), &view);
        // Mostly of a size that the near plane can cut.
        let size = if seed % 4 > 0 { distance * [1.0, 3.0, 100.0][(seed % 4 - 1) as usize] } else { size };
        let corners = (0..100)
            .map(|_| {
                let centre = DVec3::new(random.signed() * distance, random.signed() * distance, -distance);
                std::array::from_fn(|_| snapped(centre + random_vector(&mut random) * size))
            })
            .find(|corners| is_cut(&camera, corners) && !rounded(&camera, *corners).is_empty());
        let mut tally = TALLY.take();
        if let Some(corners) = corners {
            let face = OracleFace { corners, color: [1.0; 4] };
            let picture = draw(&store_of(vec![(mesh_of_face(&face), DAffine3::IDENTITY)]), &state(), &view);
            let polygon = rounded(&camera, corners);
            tally.faces += 1;
            let is_crossed = !has_a_fan(&polygon);
            tally.crossed += u64::from(is_crossed);
            let area: i64 = (1..polygon.len() - 1).map(|k| area_twice(polygon[0], polygon[k], polygon[k + 1])).sum();
            for (pixel, samples) in samples(&view).iter().enumerate() {
                let mut expected = 0;
                for sample in samples {
                    let turns = turns(edges(&polygon), *sample);
                    let is_one_way = turns == 0 || i64::from(turns) == area.signum();
                    prop_assert!(is_one_way || is_crossed, "{turns} turns: {polygon:?}");
                    expected += turns.unsigned_abs();
                }
                let drawn = picture.linear[pixel][0] * samples.len() as f32;
                let off = (drawn - expected as f32).abs();
                if is_crossed {
                    tally.crossed_wrong += off.round() as u64;
                } else {
                    prop_assert!(off < 1e-4, "pixel {pixel}: {drawn} for {expected}, {polygon:?} of {corners:?}");
                }
                tally.samples += samples.len() as u64;
                tally.covered += u64::from(expected);
            }
            if tally.faces == 1000 {
                let Tally { faces, crossed, crossed_wrong, samples, covered } = tally;
                report(
                    "random triangles that are cut, 1e-9 to 1e9 m",
                    "exact to the sample, in integers",
                    &format!(
                        "{faces} cut, {samples} samples ({covered} covered): 0 wrong; {crossed} slivers cross \
                         themselves, {crossed_wrong} samples on them"
                    ),
                );
                prop_assert!(crossed * 50 < faces && crossed_wrong <= 8, "{crossed} crossed, {crossed_wrong} samples");
                prop_assert!(covered > 100_000, "{covered}");
            }
        }
        TALLY.set(tally);
    }
}

#[test]
fn outlines_that_rounding_has_dented_are_drawn_as_they_are() {
    let mut random = Random(0xDE27);
    let (mut faces, mut dented, mut covered) = (0, 0, 0);
    while dented < 400 {
        let view = View { near: 0.25 + random.unit(), ..view(24, 18, Samples::SixtyFour) };
        let camera = Camera::new(&state(), &view);
        let size = [1.0, 3.0, 100.0][random.below(3) as usize];
        let centre = DVec3::new(random.signed(), random.signed(), -1.0);
        let corners = std::array::from_fn(|_| snapped(centre + random_vector(&mut random) * size));
        let polygon = if is_cut(&camera, &corners) { rounded(&camera, corners) } else { Vec::new() };
        faces += u64::from(!polygon.is_empty());
        if (0..polygon.len()).all(|apex| has_fan_at(&polygon, apex)) || !has_a_fan(&polygon) {
            continue;
        }
        dented += 1;
        let face = OracleFace { corners, color: [1.0; 4] };
        let picture = draw(&store_of(vec![(mesh_of_face(&face), DAffine3::IDENTITY)]), &state(), &view);
        for (pixel, samples) in samples(&view).iter().enumerate() {
            let expected = samples.iter().filter(|sample| turns(edges(&polygon), **sample) != 0).count();
            assert_eq!(picture.linear[pixel][0] * 64.0, expected as f32, "pixel {pixel}: {polygon:?}");
            covered += expected;
        }
    }
    report(
        "cut triangles dented by rounding",
        "exact to the sample, in integers",
        &format!("{dented} of {faces} cut, {covered} samples covered: 0 wrong"),
    );
    assert!(covered > 1000, "{covered}");
}

/// A net in a plane, its inner vertices pushed about: triangles that share edges, in a random order, each beginning at a random corner.
struct Net {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Net {
    fn random(random: &mut Random, n: u32, size: f64) -> Self {
        let centre = DVec3::new(0.0, 0.0, -0.3) + random_vector(random) * 0.3;
        let u = random_vector(random).normalize() * size;
        let v = u.cross(random_vector(random)).normalize() * size;
        let mut vertices = Vec::new();
        for j in 0..=n {
            for i in 0..=n {
                let is_inner = i % n != 0 && j % n != 0;
                let mut push = || if is_inner { random.signed() * 0.2 } else { 0.0 };
                let place = [f64::from(i) + push(), f64::from(j) + push()].map(|c| c / f64::from(n) * 2.0 - 1.0);
                vertices.push(snapped(centre + u * place[0] + v * place[1]));
            }
        }
        let mut triangles = Vec::new();
        for j in 0..n {
            for a in (0..n).map(|i| j * (n + 1) + i) {
                let (b, c, d) = (a + 1, a + n + 2, a + n + 1);
                triangles.extend(if random.below(2) == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
            }
        }
        for k in (1..triangles.len()).rev() {
            triangles.swap(k, random.below(k as u64 + 1) as usize);
        }
        triangles.iter_mut().for_each(|corners| corners.rotate_left(random.below(3) as usize));
        Self { vertices, triangles }
    }

    fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|vertex| self.vertices[vertex as usize])
    }

    /// The different corners, to the bit, that the near plane makes.
    fn made_at(&self, camera: &Camera) -> BTreeSet<[u64; 3]> {
        let faces = (0..self.triangles.len()).map(|k| self.corners(k).map(|corner| camera.view_point(corner)));
        let cut = faces.filter_map(|corners| ClippedFace::new(camera, corners));
        let made =
            cut.flat_map(|face| face.corners().to_vec()).filter(|corner| corner.weights.iter().all(|w| *w < 1.0));
        made.map(|corner| [corner.point.x, corner.point.y, corner.point.w].map(f64::to_bits)).collect()
    }

    /// The number of edges that have one end before the near plane.
    fn crossings(&self, camera: &Camera) -> usize {
        let is_before = |vertex: u32| camera.view_point(self.vertices[vertex as usize]).w >= camera.near;
        let edges = self.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let crossing = edges.filter(|&(a, b)| is_before(a) != is_before(b)).map(|(a, b)| (a.min(b), a.max(b)));
        crossing.collect::<BTreeSet<_>>().len()
    }

    /// One mesh with shared vertices.
    fn mesh(&self) -> Mesh {
        let all: Vec<[DVec3; 3]> = (0..self.triangles.len()).map(|triangle| self.corners(triangle)).collect();
        let mut mesh = mesh_of(&all, [1.0, 1.0, 1.0, 0.375]);
        mesh.positions = self.vertices.iter().map(|p| p.as_vec3().to_array()).collect();
        mesh.triangles = self.triangles.clone();
        mesh.material.double_sided = true;
        mesh
    }
}

/// The edges of all polygons without those that another runs the other way: their common outline.
fn outline(polygons: &[Vec<Sub>]) -> Vec<(Sub, Sub)> {
    let mut sum: BTreeMap<(Sub, Sub), i32> = BTreeMap::new();
    for (from, to) in polygons.iter().flat_map(|polygon| edges(polygon)).filter(|(from, to)| from != to) {
        *sum.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
    }
    let directed =
        |((a, b), n): ((Sub, Sub), i32)| vec![if n > 0 { (a, b) } else { (b, a) }; n.unsigned_abs() as usize];
    sum.into_iter().flat_map(directed).collect()
}

#[test]
fn faces_that_share_cut_edges_leave_no_gap_and_hit_no_sample_twice() {
    let mut random = Random(0xC07);
    let (mut nets, mut cut, mut samples_in_all, mut covered) = (0, 0, 0u64, 0u64);
    for round in 0..600 {
        let view = View { near: 0.25, ..view(24, 18, ALL_SAMPLES[round % 5]) };
        let camera = Camera::new(&state(), &view);
        // Up to a net whose outline lies beyond the guard band, so that faces are cut there as well.
        let size = [0.5, 1.0, 30.0, 1e5][round % 4];
        let net = Net::random(&mut random, 1 + round as u32 % 4, size);
        let faces: Vec<[DVec3; 3]> = (0..net.triangles.len()).map(|triangle| net.corners(triangle)).collect();
        let polygons: Vec<Vec<Sub>> = faces.iter().map(|corners| rounded(&camera, *corners)).collect();
        // Near its horizon a plane's faces are less than a sub-pixel wide, and rounding turns some over: those then lie on their
        // neighbours by the very definition of rounded vertices.
        let areas = polygons.iter().filter(|polygon| !polygon.is_empty()).map(|polygon| {
            (1..polygon.len() - 1).map(|k| area_twice(polygon[0], polygon[k], polygon[k + 1])).sum::<i64>().signum()
        });
        let areas: Vec<i64> = areas.filter(|area| *area != 0).collect();
        if areas.windows(2).any(|pair| pair[0] != pair[1]) {
            continue;
        }
        // Both neighbours make the same corner where the near plane cuts their edge: the same to the bit, before it is rounded.
        if size < 2.0 {
            assert_eq!(net.made_at(&camera).len(), net.crossings(&camera), "round {round}: corners and edges cut");
        }
        let outline = outline(&polygons);
        let store = store_of(vec![(net.mesh(), DAffine3::IDENTITY)]);
        let picture = draw(&store, &state(), &view);
        for (pixel, samples) in samples(&view).iter().enumerate() {
            let mut hit = 0;
            for sample in samples {
                let around = turns(outline.iter().copied(), *sample).unsigned_abs();
                let by_face = polygons.iter().map(|polygon| turns(edges(polygon), *sample).unsigned_abs()).sum::<u32>();
                assert!(around <= 1 && by_face == around, "round {round}: {by_face} faces hit {sample:?}, of {around}");
                hit += around;
            }
            // A second face at a sample would add 0.375 · 0.625.
            let expected = 0.375 * hit as f32 / samples.len() as f32;
            let drawn = picture.linear[pixel][0];
            assert!((drawn - expected).abs() < 1e-6, "round {round}, pixel {pixel}: {drawn} instead of {expected}");
            samples_in_all += samples.len() as u64;
            covered += u64::from(hit);
        }
        nets += 1;
        cut += faces.iter().zip(&polygons).filter(|(face, left)| is_cut(&camera, face) && !left.is_empty()).count();
    }
    report(
        "nets of triangles cut by the near plane and the guard band",
        "each sample within the outline hit exactly once, in integers",
        &format!("{nets} nets, {cut} faces cut, {samples_in_all} samples ({covered} covered): 0 wrong"),
    );
    assert!(nets > 300 && cut > 1000 && covered > 100_000, "{nets} nets, {cut} faces, {covered} samples");
}

/// floor(a / b + 1/2)
fn nearest(a: i128, b: i128) -> i128 {
    let (a, b) = if b < 0 { (-a, -b) } else { (a, b) };
    (2 * a + b).div_euclid(2 * b)
}

#[test]
fn corners_at_the_near_plane_are_where_rational_arithmetic_has_them() {
    // Coordinates and near plane are whole numbers of 1/64 m, the view 256 × 256 pixels of 1/128 each: everything is a
    // quotient of small integers.
    let view = View { near: 0.25, ..view(256, 256, Samples::One) };
    let (camera, near) = (Camera::new(&state(), &view), 16i128);
    let mut random = Random(0x2A7);
    let mut compared = 0;
    for round in 0..40_000 {
        let reach = [40, 400, 40_000][round % 3];
        let mut whole = |reach: i64| random.below(2 * reach as u64 + 1) as i128 - i128::from(reach);
        let corners: [[i128; 3]; 3] = std::array::from_fn(|_| [whole(reach), whole(reach), whole(reach) + 20]);
        // Where the outline meets the near plane, and corners before it: in order, as the face runs.
        let mut expected = Vec::new();
        for k in 0..3 {
            let (here, next) = (corners[k], corners[(k + 1) % 3]);
            if here[2] >= near {
                expected.push((here[0], here[1], here[2]));
            }
            if (here[2] >= near) != (next[2] >= near) {
                // Numerators over (w₀ − w₁), at w = near: x = (x₀ (w₀ − w₁) + (x₁ − x₀)(w₀ − near)) / (w₀ − w₁).
                let across = here[2] - next[2];
                let at = |axis: usize| here[axis] * across + (next[axis] - here[axis]) * (here[2] - near);
                expected.push((at(0), at(1), near * across));
            }
        }
        let points = corners.map(|c| DVec3::new(c[0] as f64, c[1] as f64, -c[2] as f64) / 64.0);
        if expected.len() < 3
            || expected.len() > 4
            || expected.iter().any(|(x, y, w)| 500 * w.abs() < x.abs().max(y.abs()))
        {
            // Nothing left, or also cut at the guard band.
            continue;
        }
        let found = rounded(&camera, points);
        assert_eq!(found.len(), expected.len(), "round {round}: {corners:?}");
        for (found, (x, y, w)) in found.iter().zip(expected) {
            // (x/w + 1) · 128 pixels, (1 − y/w) · 128 pixels, times 256.
            for (found, over) in found.iter().zip([w + x, w - y]) {
                let wanted = nearest(over * 128 * 256, w);
                assert_eq!(i128::from(*found), wanted, "round {round}: {corners:?}");
                compared += 1;
            }
        }
    }
    report(
        "corners made by the near plane",
        "where rational arithmetic rounds them to",
        &format!("{compared} coordinates: 0 wrong"),
    );
    assert!(compared > 100_000, "{compared}");
}
