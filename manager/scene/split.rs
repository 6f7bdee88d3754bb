//! Cuts a primitive of the file into pieces that are the unit of work of the boards.
//!
//! A list drops, reorders and hands out whole pieces, and culling can only leave out whole pieces, so they are small
//! and compact: at most [`TRIANGLES_PER_PIECE`] triangles, found by cutting the set of triangles in two along the longest
//! axis of their centroids, again and again. The counts are shared out so that all pieces are of nearly equal size and
//! there are no more than needed. Ties go by face number: the same primitive always gives the same pieces.
//!
//! Each piece gets its own vertices, its own local origin and tight bounds. *Origin*: where it can be done without
//! changing a single coordinate, vertices are stored relative to a point near the middle of the piece, which leaves
//! later f32 arithmetic more bits for what matters. The point lies on a grid as coarse as the piece is large (a power of
//! two), so that nearly always `coordinate − origin` is an f32 exactly; where it isn't for some vertex, that axis keeps
//! the file's own origin.

use super::{bounds, bvh};
use glam::DVec3;
use proto::limits;
use proto::scene::{Box3, Material, Mesh};
use rayon::prelude::*;
use std::ops::Range;

/// Most triangles of a piece.
pub const TRIANGLES_PER_PIECE: usize = 1024;
const _: () = assert!(
    TRIANGLES_PER_PIECE <= limits::TRIANGLES_PER_SUBOBJECT_MAX,
    "boards refuse a subobject of more triangles than the limit"
);

/// A mesh primitive as the file has it. Every attribute is empty or has as many elements as there are positions, every
/// index is less than that, and every position is finite.
#[derive(Clone, Debug, Default)]
pub struct Primitive {
    /// Vertices, m.
    pub positions: Vec<[f32; 3]>,
    /// Unit or zero vectors.
    pub normals: Vec<[f32; 3]>,
    /// Linear RGBA.
    pub colors: Vec<[f32; 4]>,
    /// At most two sets.
    pub texcoords: Vec<Vec<[f32; 2]>>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// The surface of all of them.
    pub material: Material,
}

/// The pieces of a primitive; none if it has no triangles.
pub fn split(primitive: &Primitive) -> Vec<Mesh> {
    let faces = primitive.triangles.len();
    if faces == 0 {
        return Vec::new();
    }
    let centroids: Vec<DVec3> = primitive
        .triangles
        .iter()
        .map(|corners| corners.iter().map(|&v| vertex(&primitive.positions, v)).sum::<DVec3>() / 3.0)
        .collect();
    let mut order: Vec<u32> = (0..faces as u32).collect();
    let mut ranges = Vec::new();
    cut(&mut order, 0..faces, faces.div_ceil(TRIANGLES_PER_PIECE), &centroids, &mut ranges);
    ranges
        .into_par_iter()
        .map(|range| {
            let mut own = order[range].to_vec();
            own.sort_unstable(); // the order of the file: it decides between coinciding faces
            piece(primitive, own)
        })
        .collect()
}

fn vertex(positions: &[[f32; 3]], index: u32) -> DVec3 {
    let [x, y, z] = positions[index as usize];
    DVec3::new(f64::from(x), f64::from(y), f64::from(z))
}

// Depth: log₂ of the number of pieces.
fn cut(order: &mut [u32], range: Range<usize>, pieces: usize, centroids: &[DVec3], out: &mut Vec<Range<usize>>) {
    if pieces <= 1 {
        out.push(range);
        return;
    }
    let left_pieces = pieces / 2;
    // No half gets more than its pieces can hold: ⌊n·l/p⌋ ≤ l·max and n − ⌊n·l/p⌋ ≤ (p − l)·max, because n ≤ p·max.
    let left = range.len() * left_pieces / pieces;
    let axis = bvh::longest_axis(order[range.clone()].iter().map(|&i| centroids[i as usize]));
    order[range.clone()].select_nth_unstable_by(left, |&a, &b| {
        centroids[a as usize][axis].total_cmp(&centroids[b as usize][axis]).then(a.cmp(&b))
    });
    let middle = range.start + left;
    cut(order, range.start..middle, left_pieces, centroids, out);
    cut(order, middle..range.end, pieces - left_pieces, centroids, out);
}

fn piece(primitive: &Primitive, face_numbers: Vec<u32>) -> Mesh {
    let faces: Vec<[u32; 3]> = face_numbers.iter().map(|&face| primitive.triangles[face as usize]).collect();
    let mut used: Vec<u32> = faces.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let triangles = faces
        .iter()
        .map(|corners| corners.map(|corner| used.partition_point(|&vertex| vertex < corner) as u32))
        .collect();

    let points: Vec<DVec3> = used.iter().map(|&v| vertex(&primitive.positions, v)).collect();
    let around = bounds::box_of_points(&points).unwrap_or(Box3 { min: DVec3::ZERO, max: DVec3::ZERO });
    let origin = local_origin(&points, around);
    Mesh {
        origin,
        positions: points.iter().map(|&point| (point - origin).as_vec3().to_array()).collect(),
        normals: pick(&primitive.normals, &used),
        colors: pick(&primitive.colors, &used),
        texcoords: primitive.texcoords.iter().map(|set| pick(set, &used)).collect(),
        triangles,
        face_numbers,
        material: primitive.material,
        sphere: bounds::ball_of_points(&points),
        bounds: around,
    }
}

fn pick<T: Copy>(all: &[T], used: &[u32]) -> Vec<T> {
    if all.is_empty() { Vec::new() } else { used.iter().map(|&i| all[i as usize]).collect() }
}

/// A point near the middle of the box from which every one of `points` is an f32 away, exactly; axis by axis, zero
/// where there is none.
fn local_origin(points: &[DVec3], around: Box3) -> DVec3 {
    let extent = (around.max - around.min).max_element();
    if !extent.is_finite() || extent <= 0.0 {
        return DVec3::ZERO;
    }
    let grid = power_of_two_below(extent);
    let mut origin = DVec3::ZERO;
    for axis in 0..3 {
        let middle = around.min[axis] + (around.max[axis] - around.min[axis]) * 0.5;
        let candidate = (middle / grid).round() * grid;
        let exact = |point: &DVec3| {
            let local = (point[axis] - candidate) as f32;
            candidate + f64::from(local) == point[axis]
        };
        if candidate.is_finite() && points.iter().all(exact) {
            origin[axis] = candidate;
        }
    }
    origin
}

/// The largest power of two that is not above `x`, a positive normal number: its exponent with an empty fraction.
fn power_of_two_below(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & 0x7ff0_0000_0000_0000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A square sheet of `side`² cells, two triangles each, at `corner`.
    pub(super) fn sheet(side: u32, corner: [f32; 3], cell: f32) -> Primitive {
        let mut primitive = Primitive::default();
        for j in 0..=side {
            for i in 0..=side {
                primitive.positions.push([corner[0] + i as f32 * cell, corner[1], corner[2] + j as f32 * cell]);
            }
        }
        for j in 0..side {
            for i in 0..side {
                let a = j * (side + 1) + i;
                primitive.triangles.push([a, a + side + 1, a + 1]);
                primitive.triangles.push([a + 1, a + side + 1, a + side + 2]);
            }
        }
        primitive
    }

    fn corners_of(primitive: &Primitive, pieces: &[Mesh]) -> Vec<Option<[DVec3; 3]>> {
        let mut found = vec![None; primitive.triangles.len()];
        for mesh in pieces {
            assert_eq!(mesh.triangles.len(), mesh.face_numbers.len());
            for (corners, &face) in mesh.triangles.iter().zip(&mesh.face_numbers) {
                let place = &mut found[face as usize];
                assert!(place.is_none(), "face {face} is in two pieces");
                *place = Some(corners.map(|corner| mesh.position(corner as usize)));
            }
        }
        found
    }

    fn check(primitive: &Primitive) -> Vec<Mesh> {
        let pieces = split(primitive);
        for (face, corners) in corners_of(primitive, &pieces).into_iter().enumerate() {
            let expected = primitive.triangles[face].map(|v| vertex(&primitive.positions, v));
            assert_eq!(corners, Some(expected), "face {face} must keep its very coordinates");
        }
        for mesh in &pieces {
            assert!(mesh.triangles.len() <= TRIANGLES_PER_PIECE);
            assert!(mesh.face_numbers.is_sorted(), "triangles keep the order of the file");
            for i in 0..mesh.positions.len() {
                let p = mesh.position(i);
                assert!(p.distance(mesh.sphere.centre) <= mesh.sphere.radius);
                assert!(p.cmpge(mesh.bounds.min).all() && p.cmple(mesh.bounds.max).all());
            }
        }
        pieces
    }

    #[test]
    fn pieces_are_as_few_as_possible_and_nearly_equal() {
        let pieces = check(&sheet(40, [0.0; 3], 1.0)); // 3200 triangles
        assert_eq!(pieces.len(), 4);
        assert!(pieces.iter().all(|mesh| mesh.triangles.len() == 800));
        assert_eq!(split(&sheet(22, [0.0; 3], 1.0)).len(), 1, "968 triangles need no cut");
        assert_eq!(split(&Primitive::default()), Vec::new());
    }

    #[test]
    fn pieces_are_compact() {
        for mesh in check(&sheet(64, [0.0; 3], 1.0)) {
            assert!(mesh.sphere.radius < 24.0, "a quarter of 64 × 64 is 32 × 16: {}", mesh.sphere.radius);
        }
    }

    #[test]
    fn a_piece_far_from_the_origin_gets_a_local_one() {
        let far = sheet(10, [4_000_000.0, 100.0, -2_000_000.0], 0.5);
        let pieces = check(&far);
        let mesh = &pieces[0];
        assert!(mesh.origin.x > 3_999_990.0 && mesh.origin.z < -1_999_990.0, "{}", mesh.origin);
        assert!(mesh.positions.iter().flatten().all(|c| c.abs() < 8.0), "local coordinates stay small");
    }

    #[test]
    fn an_origin_that_would_change_a_coordinate_is_not_taken() {
        let mut primitive = sheet(4, [64.0, 0.0, 64.0], 1.0);
        primitive.positions[3][0] = 1.0e-30; // 1e-30 − 66 is no f32
        let pieces = check(&primitive);
        assert_eq!(pieces[0].origin.x, 0.0);
        assert_ne!(pieces[0].origin.z, 0.0);
    }

    #[test]
    fn a_million_triangles_in_one_point_are_split_all_the_same() {
        let primitive =
            Primitive { positions: vec![[1.0, 2.0, 3.0]], triangles: vec![[0; 3]; 10_000], ..Primitive::default() };
        assert_eq!(check(&primitive).len(), 10);
    }

    proptest! {
        #[test]
        fn no_coordinate_ever_changes(
            positions in prop::collection::vec(prop::array::uniform3(prop::num::f32::NORMAL | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO), 3..40),
            picks in prop::collection::vec((0usize..1000, 0usize..1000, 0usize..1000), 1..60),
        ) {
            let n = positions.len();
            let triangles = picks.iter().map(|&(a, b, c)| [(a % n) as u32, (b % n) as u32, (c % n) as u32]).collect();
            check(&Primitive { positions, triangles, ..Primitive::default() });
        }
    }
}
