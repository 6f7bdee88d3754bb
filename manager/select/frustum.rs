//! What a view can see: four planes through the eye, the near plane, and the visibility range.
//!
//! Everything is tested relative to the *apex*, the point that the view looks from: the difference of two large
//! positions is taken first, in f64, and what follows works with small numbers. The tests are conservative: what
//! they call outside has no point that could colour a sample, what they call inside is inside as a whole, and whatever
//! lies across a plane, or so close to one that rounding decides, is neither.

use glam::{DAffine3, DVec3};
use proto::scene::{Box3, Sphere};
use proto::view::{Pose, View};

/// By how much of a pixel the side planes are moved outwards. Screen vertices are rounded to a grid of 1/256 pixel, so a
/// face just outside the window may come to lie just inside it.
const MARGIN_PIXELS: f64 = 1.0 / 64.0;

/// Error of a signed distance, relative to the numbers it is made of: a dot product of three terms, of a difference.
const ROUNDING: f64 = 16.0 * f64::EPSILON;

/// Where something is with respect to what is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Where {
    /// Nothing of it can be seen.
    Outside,
    /// Perhaps part of it can.
    Across,
    /// All of it is within the frustum and the range.
    Inside,
}

/// The space that a view shows.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    apex: DVec3,
    /// The eyepoint, from which visibility counts; elsewhere than the apex in a view with a displacement.
    eye: DVec3,
    /// Unit normals, inwards, world; and the distance of the plane from the apex. The side planes' is 0.
    planes: [(DVec3, f64); 5],
    /// Visibility range, m.
    range: Option<f64>,
}

impl Frustum {
    /// The frustum of `view` for an eye at `eye`.
    pub fn new(eye: Pose, view: &View, visibility_m: Option<f64>) -> Self {
        let pose = view.world_pose(eye);
        let t = view.tangents;
        let margin_x = (t.right - t.left) / f64::from(view.width) * MARGIN_PIXELS;
        let margin_y = (t.top - t.bottom) / f64::from(view.height) * MARGIN_PIXELS;
        // A point is right of the left border when X / −Z ≥ left, that is X + left · Z ≥ 0; and so on.
        let sides = [
            DVec3::new(1.0, 0.0, t.left - margin_x),
            DVec3::new(-1.0, 0.0, -(t.right + margin_x)),
            DVec3::new(0.0, 1.0, t.bottom - margin_y),
            DVec3::new(0.0, -1.0, -(t.top + margin_y)),
        ];
        let [a, b, c, d] = sides.map(|normal| (pose.orientation * normal.normalize(), 0.0));
        let near = (pose.orientation * DVec3::NEG_Z, view.near);
        Self { apex: pose.position, eye: eye.position, planes: [near, a, b, c, d], range: visibility_m }
    }

    /// The point that the view looks from, world.
    pub fn apex(&self) -> DVec3 {
        self.apex
    }

    /// Where a ball is.
    pub fn ball(&self, ball: Sphere) -> Where {
        let centre = ball.centre - self.apex;
        let slack = Self::slack(centre.to_array(), ball.radius);
        let mut found = Where::Inside;
        for (normal, distance) in self.planes {
            let inside_by = normal.dot(centre) - distance;
            if inside_by < -(ball.radius + slack) {
                return Where::Outside;
            }
            if inside_by < ball.radius + slack {
                found = Where::Across;
            }
        }
        match self.within_range_of(centre, centre.length_squared(), ball.radius, slack) {
            Where::Inside => found,
            other => other,
        }
    }

    /// Where a ball, given by its centre from the apex and the square of its distance, is with respect to the visibility range. The fading of
    /// picture.md counts from the eye; of a view that looks from elsewhere, what is in range of either point is kept.
    pub(super) fn within_range_of(&self, centre: DVec3, squared: f64, radius: f64, slack: f64) -> Where {
        let Some(range) = self.range else { return Where::Inside };
        let from_apex = squared.sqrt();
        let from_eye = if self.eye == self.apex { from_apex } else { (centre + (self.apex - self.eye)).length() };
        if from_apex.min(from_eye) - radius - slack > range {
            Where::Outside
        } else if from_apex.max(from_eye) + radius + slack > range {
            Where::Across
        } else {
            Where::Inside
        }
    }

    /// What rounding may have done to a plane's distance from a ball whose centre is there, seen from the apex.
    #[inline(always)]
    pub(super) fn slack([x, y, z]: [f64; 3], radius: f64) -> f64 {
        ROUNDING * ((x.abs() + y.abs() + z.abs()) + radius)
    }

    /// Unit normals, inwards, world; and the distance of the plane from the apex.
    pub(super) fn planes(&self) -> [(DVec3, f64); 5] {
        self.planes
    }

    /// Whether there is a visibility range.
    pub(super) fn has_range(&self) -> bool {
        self.range.is_some()
    }

    /// Whether a box that `map` takes to the world has nothing to show. The planes are taken to the box, which costs less
    /// than taking eight corners to the planes.
    pub fn misses_box(&self, map: &DAffine3, bounds: Box3) -> bool {
        let half = (bounds.max - bounds.min) * 0.5;
        let centre = map.transform_point3(bounds.min + half) - self.apex;
        let m = map.matrix3;
        let axes = [m.x_axis * half.x, m.y_axis * half.y, m.z_axis * half.z];
        let reach: DVec3 = axes.iter().map(|axis| axis.abs()).sum();
        let far = map.translation.abs().element_sum();
        let slack = ROUNDING * (centre.abs().element_sum() + reach.element_sum() + far);
        self.planes.iter().any(|&(normal, distance)| {
            let radius: f64 = axes.iter().map(|axis| normal.dot(*axis).abs()).sum();
            normal.dot(centre) - distance < -(radius + slack)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};
    use proptest::prelude::*;
    use proto::view::{Samples, Tangents};

    fn view(left: f64, right: f64, bottom: f64, top: f64, offset: Pose) -> View {
        let tangents = Tangents { left, right, bottom, top };
        View { offset, tangents, width: 640, height: 360, near: 0.1, samples: Samples::One }
    }

    /// Straight from picture.md: whether a world point lands in the picture.
    fn sees(eye: Pose, view: &View, range: Option<f64>, point: DVec3) -> bool {
        let pose = view.world_pose(eye);
        let p = pose.orientation.conjugate() * (point - pose.position);
        let t = view.tangents;
        let (x, y) = (p.x / -p.z, p.y / -p.z);
        -p.z >= view.near
            && (t.left..=t.right).contains(&x)
            && (t.bottom..=t.top).contains(&y)
            && range.is_none_or(|range| point.distance(eye.position) <= range)
    }

    #[test]
    fn the_five_sides_are_where_they_should_be() {
        let frustum = Frustum::new(Pose::IDENTITY, &view(-0.5, 1.0, -0.25, 0.75, Pose::IDENTITY), None);
        let at = |x: f64, y: f64, z: f64| frustum.ball(Sphere { centre: DVec3::new(x, y, z), radius: 0.5 });
        assert_eq!(at(0.0, 0.0, -10.0), Where::Inside);
        assert_eq!(at(-7.0, 0.0, -10.0), Where::Outside);
        assert_eq!(at(7.0, 0.0, -10.0), Where::Inside);
        assert_eq!(at(11.0, 0.0, -10.0), Where::Outside);
        assert_eq!(at(0.0, -4.0, -10.0), Where::Outside);
        assert_eq!(at(0.0, 7.5, -10.0), Where::Across);
        assert_eq!(at(0.0, 0.0, 0.3), Where::Across);
        assert_eq!(at(0.0, 0.0, 0.5), Where::Outside);
    }

    #[test]
    fn what_is_wholly_beyond_the_visibility_is_outside() {
        let frustum = Frustum::new(Pose::IDENTITY, &view(-1.0, 1.0, -1.0, 1.0, Pose::IDENTITY), Some(100.0));
        let at = |z: f64| frustum.ball(Sphere { centre: DVec3::new(0.0, 0.0, -z), radius: 1.0 });
        assert_eq!((at(98.5), at(100.0), at(101.5)), (Where::Inside, Where::Across, Where::Outside));
    }

    fn vector(range: f64) -> impl Strategy<Value = DVec3> {
        (-range..range, -range..range, -range..range).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    fn rotation() -> impl Strategy<Value = DQuat> {
        (vector(1.0), 0.01..1.0f64).prop_map(|(v, w)| DQuat::from_xyzw(v.x, v.y, v.z, w).normalize())
    }

    proptest! {
        #[test]
        fn nothing_that_can_be_seen_is_called_outside(
            far in prop_oneof![Just(0.0), Just(6.4e6), Just(1e9)],
            position in vector(10.0), orientation in rotation(), shift in vector(1.0), turn in rotation(),
            left in -2.0..1.9f64, wide in 0.01..2.0f64, bottom in -2.0..1.9f64, high in 0.01..2.0f64,
            range in prop_oneof![Just(None), (1.0..50.0f64).prop_map(Some)],
            x in vector(3.0), y in vector(3.0), z in vector(3.0), at in vector(20.0),
            corner in vector(2.0), size in vector(2.0),
            inside in prop::collection::vec((0.0..=1.0f64, 0.0..=1.0f64, 0.0..=1.0f64), 30),
        ) {
            let origin = DVec3::splat(far);
            let eye = Pose { position: origin + position, orientation };
            let view = view(left, left + wide, bottom, bottom + high, Pose { position: shift, orientation: turn });
            let map = DAffine3 { matrix3: DMat3::from_cols(x, y, z), translation: origin + at };
            let bounds = Box3 { min: corner, max: corner + size.abs() };
            let centre = (bounds.min + bounds.max) * 0.5;
            let local = Sphere { centre, radius: bounds.max.distance(centre) };
            let ball = crate::scene::bounds::ball_moved(&map, local);
            let frustum = Frustum::new(eye, &view, range);
            let (ball, missed) = (frustum.ball(ball), frustum.misses_box(&map, bounds));
            for (a, b, c) in inside {
                let point = map.transform_point3(bounds.min + (bounds.max - bounds.min) * DVec3::new(a, b, c));
                let seen = sees(eye, &view, range, point);
                prop_assert!(!(seen && (missed || ball == Where::Outside)), "{point} is seen");
                prop_assert!(seen || ball != Where::Inside, "{point} is not seen");
            }
        }
    }
}
