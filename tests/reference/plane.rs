//! Which faces lie in one plane: picture.md, "Coplanar layers".
//!
//! "Planes coincide when every vertex of the one lies within 1e-6 of the other's plane, relative to the larger of the
//! faces' extent and their coordinates in the mesh (not the world)."
//!
//! So it is decided which of two is in front where they meet. How deep they lie the scene says: for faces that lie over
//! each other its tables have the one plane from which all of them take their depth ([`ScenePlane`]). It is data, as
//! vertices are; that a face lies in it by the rule above is checked ([`crate::World::of_scene`]).
//!
//! Choices: it suffices that one of the two faces lies in the other's plane (the corners of a whole runway needn't
//! lie in the plane that one small marking spans); faces of different objects are compared where they are, each
//! object's lengths scaled as its transformation does; of several faces that are seen together, those that a chain of
//! coincidences connects lie in one plane.

use glam::{DAffine3, DVec3};

/// A plane from which faces take their depth: n · p = offset in the mesh space of an object.
#[derive(Clone, Copy, Debug)]
pub struct ScenePlane {
    /// That mesh space → world.
    pub transform: DAffine3,
    /// n, a unit vector.
    pub normal: DVec3,
    /// Distance of the plane from the mesh's origin along n, m.
    pub offset: f64,
}

impl ScenePlane {
    /// How far from it a point of a mesh in its place is, m.
    pub fn distance(&self, transform: &DAffine3, point: DVec3) -> f64 {
        let linear = self.transform.matrix3;
        let (u, v) = self.normal.any_orthonormal_pair();
        let normal = (linear * u).cross(linear * v).normalize_or_zero();
        // Relative to the plane's object, so that it is the same far from the world's origin.
        let place = transform.matrix3 * point + (transform.translation - self.transform.translation);
        normal.dot(place - linear * (self.normal * self.offset)).abs()
    }
}

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

/// How far a face may be from the plane that it takes its depth from, relative to the largest that does: more than one
/// tolerance, for a chain of coincidences may have led from that face to this one.
pub const LIES_IN: f64 = 10.0 * TOLERANCE;

impl FacePlane {
    /// The plane of a face with these corners; `reach` as [`crate::Instance::reach`] has it.
    pub fn new(points: [DVec3; 3], reach: f64) -> Self {
        let [a, b, c] = points;
        Self { points, normal: (b - a).cross(c - a).normalize_or_zero(), reach }
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
