//! Two faces: do their planes coincide, and do they overlap?
//!
//! *Coincide* (picture.md): every vertex of the one lies within 1e-6 of the other's plane, relative to the larger of the
//! faces' extent and their coordinates in the mesh. *Overlap*: the faces, seen along the normal, have more than a border in
//! common. Neighbours that share an edge do not overlap, but their rounded vertices may, by as much as that same
//! tolerance; so what counts is an overlap wider than it, in every direction. Two triangles are apart if and only if an edge
//! of one of them has them on different sides (the theorem of separating axes), which is six intervals to compare.

use glam::{DAffine3, DVec2, DVec3};
use proto::scene::Box3;

/// What "coincide" allows, relative.
pub(super) const TOLERANCE: f64 = 1e-6;

/// A triangle with an area, in whichever space it is to be compared in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Face {
    pub(super) corners: [DVec3; 3],
    /// Perpendicular to the face, towards its front; as long as twice its area.
    pub(super) normal: DVec3,
    /// That length.
    pub(super) length: f64,
    /// How far a coinciding face may be off, in this space.
    pub(super) tolerance: f64,
    /// Round the face and its tolerance.
    pub(super) bounds: Box3,
    pub(super) double_sided: bool,
}

impl Face {
    /// A face of a mesh, in the mesh's own space; `None` if it has no area.
    pub(super) fn new(corners: [DVec3; 3], double_sided: bool) -> Option<Self> {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let length = normal.length();
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let scale = min.abs().max(max.abs()).max(max - min).max_element();
        // Not only zero: of a face this thin, the direction of the normal is rounding.
        if length.is_nan() || length <= scale * scale * 1e-14 {
            return None;
        }
        let tolerance = scale * TOLERANCE;
        Some(Self { corners, normal, length, tolerance, bounds: grown(min, max, tolerance), double_sided })
    }

    /// The same face moved by `map`, which makes nothing more than `stretch` times as long.
    pub(super) fn moved(&self, map: &DAffine3, stretch: f64) -> Self {
        let corners = self.corners.map(|corner| map.transform_point3(corner));
        let [a, b, c] = corners;
        let (min, max) = (a.min(b).min(c), a.max(b).max(c));
        let tolerance = self.tolerance * stretch;
        // A mirror turns the winding over, but what is the front stays the front.
        let normal = (b - a).cross(c - a) * map.matrix3.determinant().signum();
        Self { corners, normal, length: normal.length(), tolerance, bounds: grown(min, max, tolerance), ..*self }
    }

    /// Whether all of `points` are within `tolerance` of the face's plane.
    pub(super) fn in_plane(&self, points: &[DVec3; 3], tolerance: f64) -> bool {
        let limit = tolerance * self.length;
        points.iter().all(|&point| self.normal.dot(point - self.corners[0]).abs() <= limit)
    }

    /// Whether the two must share a plane for their order to be right.
    pub(super) fn lies_over(&self, other: &Self) -> bool {
        // Back to back, each seen from its front only: never both in one picture.
        if !self.double_sided && !other.double_sided && self.normal.dot(other.normal) < 0.0 {
            return false;
        }
        let tolerance = self.tolerance.max(other.tolerance);
        (self.in_plane(&other.corners, tolerance) || other.in_plane(&self.corners, tolerance))
            && self.overlaps(other, tolerance)
    }

    /// Whether the two, seen along the larger one's normal, overlap by more than `width` in every direction.
    fn overlaps(&self, other: &Self, width: f64) -> bool {
        let normal = if self.length >= other.length { self.normal } else { other.normal }.abs();
        let flat = |face: &Self| {
            face.corners.map(|p| {
                if normal.x >= normal.y && normal.x >= normal.z {
                    DVec2::new(p.y, p.z)
                } else if normal.y >= normal.z {
                    DVec2::new(p.z, p.x)
                } else {
                    DVec2::new(p.x, p.y)
                }
            })
        };
        let (a, b) = (flat(self), flat(other));
        let apart = |from: DVec2, to: DVec2| {
            let Some(axis) = (to - from).perp().try_normalize() else { return false };
            let interval = |corners: &[DVec2; 3]| {
                let [x, y, z] = corners.map(|corner| axis.dot(corner - from));
                (x.min(y).min(z), x.max(y).max(z))
            };
            let ((a0, a1), (b0, b1)) = (interval(&a), interval(&b));
            a1.min(b1) - a0.max(b0) <= width
        };
        (0..3).all(|i| !apart(a[i], a[(i + 1) % 3]) && !apart(b[i], b[(i + 1) % 3]))
    }
}

fn grown(min: DVec3, max: DVec3, by: f64) -> Box3 {
    Box3 { min: min - by, max: max + by }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    fn face(corners: [[f64; 3]; 3]) -> Face {
        Face::new(corners.map(DVec3::from_array), false).unwrap()
    }

    const FLOOR: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [4.0, 0.0, 0.0]];

    #[test]
    fn cases() {
        let floor = face(FLOOR);
        for (name, corners, expected) in [
            ("the same face", FLOOR, true),
            ("one inside it", [[1.0, 0.0, 1.0], [1.0, 0.0, 2.0], [2.0, 0.0, 1.0]], true),
            ("one that crosses a corner", [[-1.0, 0.0, -1.0], [-1.0, 0.0, 2.0], [2.0, 0.0, -1.0]], true),
            ("neighbour across an edge", [[0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]], false),
            ("neighbour at a corner", [[4.0, 0.0, 0.0], [4.0, 0.0, 4.0], [8.0, 0.0, 0.0]], false),
            ("a hair within the edge", [[2.0, 0.0, 1.999_999], [2.0, 0.0, 5.0], [5.0, 0.0, 1.0]], false),
            ("far away in the plane", [[9.0, 0.0, 9.0], [9.0, 0.0, 12.0], [12.0, 0.0, 9.0]], false),
            ("a micrometre above", [[1.0, 1e-6, 1.0], [1.0, 1e-6, 2.0], [2.0, 1e-6, 1.0]], true),
            ("a millimetre above", [[1.0, 1e-3, 1.0], [1.0, 1e-3, 2.0], [2.0, 1e-3, 1.0]], false),
            ("folded over a shared edge", [[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [3.0, 0.0, 1.0]], true),
            ("a wall standing on it", [[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 1.0, 1.0]], false),
            ("back to back", [[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 2.0]], false),
        ] {
            let other = face(corners);
            assert_eq!(floor.lies_over(&other), expected, "{name}");
            assert_eq!(other.lies_over(&floor), expected, "{name}, the other way round");
        }
        let both_sides = Face { double_sided: true, ..face([[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 2.0]]) };
        assert!(floor.lies_over(&both_sides), "back to back, one seen from behind");
    }

    #[test]
    fn a_mirrored_face_keeps_its_front() {
        let floor = face(FLOOR);
        let mirror = DAffine3::from_scale(dvec3(-1.0, 1.0, 1.0));
        let moved = floor.moved(&mirror, 1.0);
        assert!(moved.normal.y > 0.0, "{}", moved.normal);
    }

    #[test]
    fn faces_without_area_are_no_faces() {
        let p = dvec3(3.0, 4.0, 5.0);
        assert!(Face::new([p; 3], false).is_none());
        assert!(Face::new([p, p + 1.0, p + 2.0], false).is_none());
    }
}
