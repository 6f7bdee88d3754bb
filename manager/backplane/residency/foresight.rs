//! Where the eye will be: its velocity and turn rate, carried on for some seconds.

use glam::{DQuat, DVec3};
use proto::time::Time;
use proto::view::{Pose, Tangents, View};
use std::collections::VecDeque;
use std::time::Duration;

/// How far ahead is looked, s: soon enough to matter, far enough to send something meanwhile.
pub(crate) const AHEAD_S: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// Over how long the motion is measured: a host's jitter is evened out, a turn is still a turn.
const MEMORY: Duration = Duration::from_millis(400);
/// Poses kept at most.
const POSES_MAX: usize = 64;
/// What moves faster has been put elsewhere, m/s.
const SPEED_MAX: f64 = 10_000.0;
/// A turn is carried on for this much at most, rad: beyond, all directions are as likely.
const TURN_MAX: f64 = std::f64::consts::PI;
/// By how much of its width and height a view is widened to every side.
const MARGIN: f64 = 0.25;

/// The newest poses.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motion {
    past: VecDeque<(Time, Pose)>,
}

impl Motion {
    /// The eye was there then.
    pub(crate) fn on_pose(&mut self, at: Time, pose: Pose) {
        if let Some((before, last)) = self.past.back().copied() {
            let seconds = at.since(before).as_secs_f64();
            let is_jump = last.position.distance(pose.position) > SPEED_MAX * seconds;
            if is_jump {
                self.past.clear();
            } else if seconds == 0.0 {
                self.past.pop_back();
            }
        }
        self.past.push_back((at, pose));
        // One that is older stays, to measure from.
        while self.past.len() > POSES_MAX || (self.past.len() > 2 && at.since(self.past[1].0) >= MEMORY) {
            self.past.pop_front();
        }
    }

    /// Where the eye will be in so many seconds if it goes on as it does; `None` without any pose.
    pub(crate) fn ahead(&self, seconds: f64) -> Option<Pose> {
        let (until, last) = *self.past.back()?;
        let (from, first) = *self.past.front()?;
        let measured = until.since(from).as_secs_f64();
        if measured <= 0.0 {
            return Some(last);
        }
        let times = seconds / measured;
        let turn = last.orientation * first.orientation.inverse();
        // The shorter way round.
        let turn = if turn.w < 0.0 { -turn } else { turn };
        let (axis, angle) = turn.to_axis_angle();
        let turn = DQuat::from_axis_angle(axis, (angle * times).clamp(-TURN_MAX, TURN_MAX));
        let position: DVec3 = last.position + (last.position - first.position) * times;
        let ahead = Pose { position, orientation: (turn * last.orientation).normalize() };
        Some(if position.is_finite() && ahead.orientation.is_finite() { ahead } else { last })
    }
}

/// The view, looking a little beyond its borders.
pub(crate) fn widened(view: &View) -> View {
    let Tangents { left, right, bottom, top } = view.tangents;
    let (x, y) = ((right - left) * MARGIN, (top - bottom) * MARGIN);
    View { tangents: Tangents { left: left - x, right: right + x, bottom: bottom - y, top: top + y }, ..*view }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(ms: u64) -> Time {
        Time(ms * 1_000_000)
    }

    #[test]
    fn a_steady_climbing_turn_is_carried_on() {
        let mut motion = Motion::default();
        assert_eq!(motion.ahead(1.0), None);
        let pose = |ms: u64| {
            let t = ms as f64 / 1e3;
            Pose { position: DVec3::new(50.0 * t, 3.0 * t, 1.0), orientation: DQuat::from_rotation_y(0.3 * t) }
        };
        motion.on_pose(at(0), pose(0));
        assert_eq!(motion.ahead(1.0), Some(pose(0)), "one pose is no motion");
        for k in 1..100 {
            motion.on_pose(at(k * 16), pose(k * 16));
        }
        let (ahead, truth) = (motion.ahead(2.0).unwrap(), pose(99 * 16 + 2000));
        assert!(ahead.position.distance(truth.position) < 1e-9);
        assert!(ahead.orientation.dot(truth.orientation).abs() > 1.0 - 1e-12);
    }

    #[test]
    fn an_eye_that_was_put_elsewhere_is_not_flying_there() {
        let mut motion = Motion::default();
        let pose = |x: f64| Pose { position: DVec3::X * x, orientation: DQuat::IDENTITY };
        motion.on_pose(at(0), pose(0.0));
        motion.on_pose(at(16), pose(1.0));
        motion.on_pose(at(32), pose(1e6));
        assert_eq!(motion.ahead(4.0), Some(pose(1e6)));
        motion.on_pose(at(48), pose(1e6 + 1.6));
        assert!((motion.ahead(1.0).unwrap().position.x - (1e6 + 1.6 + 100.0)).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn whatever_the_host_says_what_lies_ahead_is_a_pose(
            steps in prop::collection::vec((0u64..40, any::<[f64; 3]>(), any::<[f64; 4]>()), 1..20), seconds in 0.0..10.0,
        ) {
            let mut motion = Motion::default();
            let mut ms = 0;
            for (step, position, orientation) in steps {
                ms += step;
                if let Ok(pose) = Pose::checked(DVec3::from_array(position), DQuat::from_array(orientation)) {
                    motion.on_pose(at(ms), pose);
                    let ahead = motion.ahead(seconds).unwrap();
                    prop_assert!(Pose::checked(ahead.position, ahead.orientation).is_ok());
                }
                prop_assert!(motion.past.len() <= POSES_MAX);
            }
        }
    }
}
