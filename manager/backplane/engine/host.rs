//! What the host says, and the answer that its pose is on the screen.

use super::{Engine, Source};
use crate::host::native::Freshness;
use proto::pose::{Answer, PosePacket};
use proto::time::Time;
use std::net::SocketAddr;

/// Poses that may wait in lock-step. A host that sends more without an answer loses the oldest.
const POSES_WAITING_MAX: usize = 64;

impl Engine {
    pub(super) fn on_pose(&mut self, packet: PosePacket, from: SocketAddr, received: Time, freshness: Freshness) {
        match freshness {
            Freshness::Stale => self.statistics.dropped.stale_poses += 1,
            Freshness::Repeated => {
                if let Some((to, answer)) = self.answered.filter(|(to, a)| *to == from && a.sequence == packet.sequence)
                {
                    self.send_answer(to, answer);
                }
            }
            Freshness::New => {
                let source = Source { from, sequence: packet.sequence, answer: packet.answer, received };
                if self.is_lock_step() {
                    // A frame may still have to be drawn again, with its own pose.
                    if self.poses_waiting.len() >= POSES_WAITING_MAX {
                        self.poses_waiting.pop_front();
                        self.statistics.dropped.stale_poses += 1;
                    }
                    self.poses_waiting.push_back((packet, source));
                    return;
                }
                let now = if self.ahead.is_made() { self.ahead.hold((packet, source)) } else { Some((packet, source)) };
                if let Some((packet, source)) = now {
                    self.take_pose(&packet, source);
                }
            }
        }
    }

    /// Lock-step: the next pose is taken when the frame of the one before has been shown.
    pub(super) fn take_waiting_pose(&mut self) {
        if self.clock.is_idle()
            && !self.clock.is_redraw()
            && self.fresh.is_none()
            && let Some((packet, source)) = self.poses_waiting.pop_front()
        {
            self.take_pose(&packet, source);
        }
    }

    pub(super) fn take_pose(&mut self, packet: &PosePacket, source: Source) {
        self.statistics.dropped.unknown_entities += self.director.on_pose(packet);
        self.fresh = Some(source);
    }

    /// Tells the host, if it wants to know, that its pose is on the screen. In lock-step that is once the compositor
    /// has shown it.
    pub(super) fn answer(&mut self) {
        let (Some(source), Some(swap)) = (self.shown, &self.last_swap) else { return };
        let lock_step = self.is_lock_step();
        if !source.answer || (lock_step && (!self.clock.is_idle() || self.clock.is_redraw())) {
            return;
        }
        let answer = Answer { lock_step, sequence: source.sequence, frame: swap.frame.0 as u32 };
        if self.answered != Some((source.from, answer)) {
            self.answered = Some((source.from, answer));
            self.send_answer(source.from, answer);
        }
    }

    fn send_answer(&self, to: SocketAddr, answer: Answer) {
        // A full socket buffer or a host that is gone: it will ask again.
        if let Err(error) = (self.answers)(&answer.encode(), to) {
            tracing::debug!(%to, %error, "answer not sent");
        }
    }
}
