//! Two faces: do their planes coincide, and do they overlap or touch?
//!
//! *Coincide* (picture.md): every vertex of the one lies within 1e-6 of the other's plane, relative to the larger of the
//! faces' extent and their coordinates in the mesh. *Overlap*: the faces, seen along the normal, have more than a border in
//! common. Neighbours that share an edge do not overlap, but their rounded vertices may, by as much as that same
//! tolerance; so what counts is an overlap wider than it, in every direction. Two triangles are apart if and only if an edge
//! of one of them has them on different sides (the theorem of separating axes), which is six intervals to compare.
//!
//! *Touch*: they are beside each other, no more than the tolerance apart, and somewhere along the border have vertices that
//! are not the same numbers. On the screen each vertex is rounded by itself, so there the faces may overlap by a sliver.
//! Where both ends of the border are corners of both they can't: the two round the edge alike, and the top-left rule gives
//! it to one of them. Nearly all neighbours in a mesh are of that kind.

use glam::{DAffine3, DVec2, DVec3};
use proto::scene::Box3;

/// What "coincide" allows, relative.
pub(super) const TOLERANCE: f64 = 1e-6;

/// How far two corners that are the same may be from each other, in tolerances: f64's rounding.
const SAME_CORNER: f64 = 1e-7;

/// What two faces have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Contact {
    /// Never a point of the screen: they are apart, or in two planes, or neighbours corner to corner.
    Nothing,
    /// Part of a border: on the screen, up to a sliver.
    Border,
    /// An area.
    Area,
}

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

    /// What the two have in common, if their planes coincide.
    pub(super) fn contact(&self, other: &Self) -> Contact {
        // Back to back, each seen from its front only: never both in one picture.
        if !self.double_sided && !other.double_sided && self.normal.dot(other.normal) < 0.0 {
            return Contact::Nothing;
        }
        let tolerance = self.tolerance.max(other.tolerance);
        if self.in_plane(&other.corners, tolerance) || other.in_plane(&self.corners, tolerance) {
            self.contact_in_plane(other, tolerance)
        } else {
            Contact::Nothing
        }
    }

    /// The same seen along the larger one's normal: less than `width` in some direction is no area.
    fn contact_in_plane(&self, other: &Self, width: f64) -> Contact {
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
        // The length of their common border, as far as the edges tell so far that have the two on different sides.
        let mut border: Option<f64> = None;
        for (from, to) in [0, 1, 2].into_iter().flat_map(|i| [(a[i], a[(i + 1) % 3]), (b[i], b[(i + 1) % 3])]) {
            let Some(along) = (to - from).try_normalize() else { continue };
            let across = along.perp();
            let heights = |corners: &[DVec2; 3]| corners.map(|corner| across.dot(corner - from));
            let (of_a, of_b) = (heights(&a), heights(&b));
            let ((a0, a1), (b0, b1)) = (interval(of_a), interval(of_b));
            let (low, high) = (a0.max(b0), a1.min(b1));
            if high - low > width {
                continue;
            }
            if low - high > width {
                return Contact::Nothing;
            }
            // The edge is a border of both: from where to where has each a corner at it?
            let reach = |corners: &[DVec2; 3], heights: [f64; 3]| {
                let mut reach = (f64::INFINITY, f64::NEG_INFINITY);
                for (corner, height) in corners.iter().zip(heights) {
                    if height >= low.min(high) - width && height <= low.max(high) + width {
                        let place = along.dot(corner - from);
                        reach = (reach.0.min(place), reach.1.max(place));
                    }
                }
                reach
            };
            let ((c0, c1), (d0, d1)) = (reach(&a, of_a), reach(&b, of_b));
            let length = c1.min(d1) - c0.max(d0);
            if length < -width {
                return Contact::Nothing;
            }
            border = Some(border.map_or(length, |least| least.min(length)));
        }
        let Some(length) = border else { return Contact::Area };
        // Corners that meet after different transformations differ by roundings of f64: rounded to a screen's grid they are the
        // same but in one case of a million million.
        let is_same = |a: &DVec3, b: &DVec3| a.distance_squared(*b) <= (width * SAME_CORNER).powi(2);
        let same = self.corners.iter().filter(|a| other.corners.iter().any(|b| is_same(a, b))).count();
        let is_edge = length > width;
        if same > usize::from(is_edge) { Contact::Nothing } else { Contact::Border }
    }
}

fn interval([x, y, z]: [f64; 3]) -> (f64, f64) {
    (x.min(y).min(z), x.max(y).max(z))
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
        use Contact::{Area, Border, Nothing};
        let floor = face(FLOOR);
        for (name, corners, expected) in [
            ("the same face", FLOOR, Area),
            ("one inside it", [[1.0, 0.0, 1.0], [1.0, 0.0, 2.0], [2.0, 0.0, 1.0]], Area),
            ("one that crosses a corner", [[-1.0, 0.0, -1.0], [-1.0, 0.0, 2.0], [2.0, 0.0, -1.0]], Area),
            ("neighbour across an edge", [[0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]], Nothing),
            ("neighbour across half of an edge", [[2.0, 0.0, 2.0], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]], Border),
            ("neighbour across a part of an edge", [[1.0, 0.0, 3.0], [4.0, 0.0, 4.0], [3.0, 0.0, 1.0]], Border),
            ("neighbour whose edge is longer", [[-1.0, 0.0, 5.0], [4.0, 0.0, 4.0], [5.0, 0.0, -1.0]], Border),
            ("neighbour at a corner", [[4.0, 0.0, 0.0], [4.0, 0.0, 4.0], [8.0, 0.0, 0.0]], Nothing),
            ("along the same line from a corner", [[4.0, 0.0, 0.0], [6.0, 0.0, 1.0], [8.0, 0.0, 0.0]], Nothing),
            ("a corner in the middle of an edge", [[2.0, 0.0, 2.0], [3.0, 0.0, 4.0], [4.0, 0.0, 3.0]], Border),
            ("a corner beside an edge", [[2.1, 0.0, 2.0], [3.0, 0.0, 4.0], [4.0, 0.0, 3.0]], Nothing),
            ("along the edge's line, beyond it", [[5.0, 0.0, -1.0], [9.0, 0.0, -1.0], [8.0, 0.0, -4.0]], Nothing),
            ("a hair within the edge", [[2.0, 0.0, 1.999_999], [2.0, 0.0, 5.0], [5.0, 0.0, 1.0]], Border),
            ("a hair beside an edge", [[0.0, 0.0, 4.000_001], [4.0, 0.0, 4.0], [4.0, 0.0, 0.0]], Border),
            ("far away in the plane", [[9.0, 0.0, 9.0], [9.0, 0.0, 12.0], [12.0, 0.0, 9.0]], Nothing),
            ("a micrometre above", [[1.0, 1e-6, 1.0], [1.0, 1e-6, 2.0], [2.0, 1e-6, 1.0]], Area),
            ("a millimetre above", [[1.0, 1e-3, 1.0], [1.0, 1e-3, 2.0], [2.0, 1e-3, 1.0]], Nothing),
            ("folded over a shared edge", [[0.0, 0.0, 0.0], [0.0, 0.0, 4.0], [3.0, 0.0, 1.0]], Area),
            ("a wall standing on it", [[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 1.0, 1.0]], Nothing),
            ("back to back", [[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 2.0]], Nothing),
        ] {
            let other = face(corners);
            assert_eq!(floor.contact(&other), expected, "{name}");
            assert_eq!(other.contact(&floor), expected, "{name}, the other way round");
        }
        let both_sides = Face { double_sided: true, ..face([[1.0, 0.0, 1.0], [2.0, 0.0, 1.0], [1.0, 0.0, 2.0]]) };
        assert_eq!(floor.contact(&both_sides), Area, "back to back, one seen from behind");
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
