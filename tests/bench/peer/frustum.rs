//! Which batches are in view, and in which order they are drawn.

use crate::geometry::Batch;
use glam::{DMat4, DVec3, DVec4};
use proto::view::{Pose, Tangents};
use std::ops::Range;

/// What a view sees: its near plane and four sides. There is no far plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frustum {
    eye: DVec3,
    /// Unit normals that point inwards, world; each plane goes through the eye.
    sides: [DVec3; 4],
    /// The line of sight, world.
    forward: DVec3,
    near: f64,
}

impl Frustum {
    pub(crate) fn new(pose: Pose, tangents: &Tangents, near: f64) -> Self {
        let Tangents { left, right, bottom, top } = *tangents;
        // A point (x, y, z) of the eye's frame is right of the left side if x ≥ left · −z.
        let sides = [
            DVec3::new(1.0, 0.0, left),
            DVec3::new(-1.0, 0.0, -right),
            DVec3::new(0.0, 1.0, bottom),
            DVec3::new(0.0, -1.0, -top),
        ];
        let sides = sides.map(|normal| pose.orientation * normal.normalize());
        Self { eye: pose.position, sides, forward: pose.orientation * DVec3::NEG_Z, near }
    }

    fn touches(&self, batch: &Batch) -> bool {
        let to = batch.centre - self.eye;
        self.forward.dot(to) + batch.radius >= self.near && self.sides.iter().all(|side| side.dot(to) >= -batch.radius)
    }

    /// The batches in view from near to far, by the distances of their centres.
    pub(crate) fn nearest_first(&self, batches: &[Batch], order: &mut Vec<(f64, usize)>) {
        order.clear();
        let seen = batches.iter().enumerate().filter(|(_, batch)| self.touches(batch));
        order.extend(seen.map(|(k, batch)| (batch.centre.distance_squared(self.eye), k)));
        order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
}

/// Runs of batches that lie one behind another in the buffer as well as in `order`, as one range of indices each: a call
/// costs llvmpipe more than a comparison costs us.
pub(crate) fn runs<'a>(batches: &'a [Batch], order: &'a [(f64, usize)]) -> impl Iterator<Item = Range<u32>> + 'a {
    let mut rest = order;
    std::iter::from_fn(move || {
        let ((_, first), mut after) = rest.split_first()?;
        let mut range = batches[*first].indices.clone();
        while let Some(((_, next), beyond)) = after.split_first()
            && batches[*next].indices.start == range.end
        {
            range.end = batches[*next].indices.end;
            after = beyond;
        }
        rest = after;
        Some(range)
    })
}

/// World → clip space: reversed depth, `near` at 1, infinity at 0.
pub(crate) fn view_projection(pose: Pose, tangents: &Tangents, near: f64) -> DMat4 {
    let Tangents { left, right, bottom, top } = *tangents;
    let (width, height) = (right - left, top - bottom);
    let projection = DMat4::from_cols(
        DVec4::new(2.0 / width, 0.0, 0.0, 0.0),
        DVec4::new(0.0, 2.0 / height, 0.0, 0.0),
        DVec4::new((right + left) / width, (top + bottom) / height, 0.0, -1.0),
        DVec4::new(0.0, 0.0, near, 0.0),
    );
    projection * DMat4::from(pose.to_affine().inverse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gl::State;

    const LENS: Tangents = Tangents { left: -0.5, right: 1.0, bottom: -0.25, top: 0.75 };
    const STATE: State = State { double_sided: false, layer: 0, blend: false };

    fn ball(x: f64, y: f64, z: f64, radius: f64, indices: Range<u32>) -> Batch {
        Batch { indices, centre: DVec3::new(x, y, z), radius, state: STATE }
    }

    fn pose() -> Pose {
        Pose::looking_at(DVec3::new(5.0, 2.0, 1.0), DVec3::new(1.0, 3.0, -9.0), DVec3::Y).unwrap()
    }

    #[test]
    fn the_windows_corners_are_the_corners_of_clip_space() {
        let (pose, near) = (pose(), 0.5);
        let matrix = view_projection(pose, &LENS, near);
        for (x, y, corner) in [(LENS.left, LENS.bottom, [-1.0, -1.0]), (LENS.right, LENS.top, [1.0, 1.0])] {
            for (distance, depth) in [(near, 1.0), (1e6, near / 1e6)] {
                let point = pose.to_affine().transform_point3(DVec3::new(x, y, -1.0) * distance);
                let clip = matrix * point.extend(1.0);
                let shown = clip / clip.w;
                let error = (shown.x - corner[0]).abs() + (shown.y - corner[1]).abs() + (shown.z - depth).abs();
                assert!(error < 1e-9, "{shown} at {distance} m");
            }
        }
    }

    #[test]
    fn balls_are_dropped_beyond_each_side_and_kept_when_they_touch_it() {
        let frustum = Frustum::new(Pose::IDENTITY, &LENS, 0.5);
        let mut order = Vec::new();
        for (out, touching) in [
            (ball(-8.0, 0.0, -10.0, 1.0, 0..3), ball(-5.8, 0.0, -10.0, 1.0, 0..3)),
            (ball(12.0, 0.0, -10.0, 1.0, 0..3), ball(11.0, 0.0, -10.0, 1.0, 0..3)),
            (ball(0.0, -4.0, -10.0, 1.0, 0..3), ball(0.0, -3.4, -10.0, 1.0, 0..3)),
            (ball(0.0, 9.0, -10.0, 1.0, 0..3), ball(0.0, 8.5, -10.0, 1.0, 0..3)),
            (ball(0.0, 0.0, 1.0, 1.0, 0..3), ball(0.0, 0.0, 0.4, 1.0, 0..3)),
        ] {
            frustum.nearest_first(std::slice::from_ref(&out), &mut order);
            assert_eq!(order, [], "{out:?}");
            frustum.nearest_first(std::slice::from_ref(&touching), &mut order);
            assert_eq!(order.len(), 1, "{touching:?}");
        }
    }

    #[test]
    fn neighbours_in_order_and_buffer_are_one_call() {
        let at = |k: u32| 3 * k..3 * k + 3;
        let batches: Vec<Batch> =
            [-10.0, -20.0, -5.0, -30.0].iter().zip(0..).map(|(z, k)| ball(0.0, 0.0, *z, 1.0, at(k))).collect();
        let mut order = Vec::new();
        Frustum::new(Pose::IDENTITY, &LENS, 0.5).nearest_first(&batches, &mut order);
        assert_eq!(order.iter().map(|(_, k)| *k).collect::<Vec<_>>(), [2, 0, 1, 3]);
        assert_eq!(runs(&batches, &order).collect::<Vec<_>>(), [6..9, 0..6, 9..12]);
        assert_eq!(runs(&batches, &[]).count(), 0);
    }
}
