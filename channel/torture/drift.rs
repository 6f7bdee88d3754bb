//! A million small rotations in a row: hosts turn by multiplying, frame after frame for hours.

use super::{Comparison, as_f64, random_vector, report};
use crate::geometry::camera::Camera;
use crate::oracle::*;
use crate::picture_tests::distribution::{everything_moved, offset_view};
use glam::{DQuat, DVec3};
use proto::view::Pose;

const STEPS: u32 = 1_000_000;

#[test]
fn a_million_small_rotations_come_back() {
    // A hundred whole turns about a slanted axis, so the last orientation is the first.
    let step = DQuat::from_axis_angle(DVec3::new(0.48, 0.6, -0.64), std::f64::consts::TAU * 100.0 / f64::from(STEPS));
    let view = offset_view();
    let (store, state) = everything_moved(DVec3::ZERO, 0.0);
    let standard = draw(&store, &state, &view);
    for renormalised in [false, true] {
        // Either the host multiplies and we get what has become of it, or each product came to us and went back.
        let last = (0..STEPS).fold(state.eye.orientation, |orientation, _| {
            let next = orientation * step;
            if renormalised { Pose::checked(state.eye.position, next).unwrap().orientation } else { next }
        });
        let mut turned = state;
        turned.eye = Pose::checked(state.eye.position, last).unwrap();
        let [a, b] = [&state, &turned].map(|state| Camera::new(state, &view));
        let mut random = Random(0xD81F7);
        let mut displaced = 0.0f64;
        for _ in 0..10_000 {
            let place = random_vector(&mut random) * 5.0 - DVec3::Z * 5.0;
            let [p, q] = [&a, &b].map(|camera| camera.view_point(place));
            if p.w > 0.1 {
                let [p, q] = [a.project(p), b.project(q)];
                displaced = displaced.max((p[0] - q[0]).abs()).max((p[1] - q[1]).abs());
            }
        }
        let comparison = Comparison::of(&draw(&store, &turned, &view), &as_f64(&standard));
        let how = if renormalised { "each product made a unit" } else { "the last product made a unit" };
        let measured = format!("{displaced:.1e} pixel; {comparison}");
        report(&format!("1e6 small rotations in a row, {how}"), "within 1/256 pixel", &measured);
        assert!(displaced < 1.0 / 256.0, "{how}: {measured}");
        // Where a vertex rounds to the other side, one sample of 16 may flip.
        assert!(comparison.unlike * 20 < comparison.pixels, "{how}: {measured}");
    }
}
