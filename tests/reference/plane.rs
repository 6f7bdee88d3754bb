//! Which faces lie in one plane: picture.md, "Coplanar layers".
//!
//! "Planes coincide when every vertex of the one lies within 1e-6 of the other's plane, relative to the larger of the
//! faces' extent and their coordinates in the mesh (not the world)."
//!
//! Choices: it suffices that one of the two faces lies in the other's plane (the corners of a whole runway needn't
//! lie in the plane that one small marking spans); faces of different objects are compared where they are, each
//! object's lengths scaled as its transformation does; of several faces that are seen together, those that a chain of
//! coincidences connects lie in one plane.

use glam::DVec3;

/// A face's plane, relative to the eye, and how far from it still counts as in it.
#[derive(Clone, Copy, Debug)]
pub struct FacePlane {
    points: [DVec3; 3],
    /// Unit; zero for a face without an area.
    normal: DVec3,
    /// The larger of extent and coordinates, m.
    reach: f64,
}

/// picture.md, "Coplanar layers".
const TOLERANCE: f64 = 1e-6;

impl FacePlane {
    /// The plane of a face with these corners, the largest of its coordinates in the mesh being `coordinate`.
    pub fn new(points: [DVec3; 3], coordinate: f64) -> Self {
        let [a, b, c] = points;
        let extent = a.distance(b).max(b.distance(c)).max(c.distance(a));
        Self { points, normal: (b - a).cross(c - a).normalize_or_zero(), reach: extent.max(coordinate) }
    }

    /// Whether the two planes coincide.
    pub fn coincides(&self, other: &Self) -> bool {
        let within = TOLERANCE * self.reach.max(other.reach);
        let lies_in = |a: &Self, b: &Self| {
            b.normal != DVec3::ZERO && a.points.iter().all(|p| (*p - b.points[0]).dot(b.normal).abs() <= within)
        };
        lies_in(self, other) || lies_in(other, self)
    }
}

/// For each plane the index of the first one that it coincides with, directly or through others; its own if there is
/// none.
pub fn groups(planes: &[&FacePlane]) -> Vec<usize> {
    let mut first: Vec<usize> = (0..planes.len()).collect();
    for b in 1..planes.len() {
        for a in 0..b {
            if first[a] != first[b] && planes[a].coincides(planes[b]) {
                let (low, high) = (first[a].min(first[b]), first[a].max(first[b]));
                first[..=b].iter_mut().filter(|group| **group == high).for_each(|group| *group = low);
            }
        }
    }
    first
}
