//! A rig whose manager has a stand-by, and loses it: how long until the stand-by shows a whole frame.

use super::chain::Random;
use super::fleet::{HANG, Look, Plan, any, board, compositor, end, host, look, manager, said, send};
use crate::error::CommandError;
use rustix::process::Signal;
use std::net::SocketAddr;
use std::process::Child;
use std::time::{Duration, Instant};

/// How often the statistics are read while something is awaited.
const LOOK_PERIOD: Duration = Duration::from_millis(25);
/// After a change, until the rig is as if nothing had been.
const SETTLE: Duration = Duration::from_secs(1);

/// What a change of leaders took.
pub(super) struct Change {
    /// Until the other led, ms.
    pub(super) led_ms: f64,
    /// Until its first whole frame, ms.
    pub(super) whole_ms: f64,
    /// Meshes and textures that it had sent by then.
    pub(super) resent: u64,
}

/// The processes.
pub(super) struct Pair<'a> {
    plan: Plan<'a>,
    managers: [Child; 2],
    /// Backplane, poses and console of each.
    at: [[SocketAddr; 3]; 2],
    others: Vec<Child>,
}

impl<'a> Pair<'a> {
    /// Starts all, and waits until one leads and the other could.
    pub(super) fn start(plan: Plan<'a>) -> Result<Self, CommandError> {
        let (first, first_at) = manager(&plan, [any(), any(), any()], false, None)?;
        let second = manager(&plan, [any(), any(), any()], false, Some(first_at[0]));
        let (second, second_at) = match second {
            Ok(second) => second,
            Err(error) => {
                let mut first = first;
                end(&mut first);
                return Err(error);
            }
        };
        let mut pair = Self { plan, managers: [first, second], at: [first_at, second_at], others: Vec::new() };
        let both = |k: usize| format!("{},{}", pair.at[0][k], pair.at[1][k]);
        let (backplanes, poses) = (both(0), both(1));
        pair.others.push(compositor(&backplanes, None)?);
        pair.others.push(host(&pair.plan, &poses)?);
        for k in 0..pair.plan.boards {
            pair.others.push(board(&backplanes, &format!("b{k}"))?);
        }
        pair.leader()?;
        Ok(pair)
    }

    /// Waits until one leads all boards, and the other could; returns who leads.
    fn leader(&self) -> Result<usize, CommandError> {
        let boards = |look: &Look| look.value("/memory").and_then(|memory| Some(memory.as_array()?.len()));
        let leads = |look: &Look| look.value("/leads").and_then(serde_json::Value::as_bool);
        let started = Instant::now();
        while started.elapsed() < HANG {
            // While a manager is away its console is.
            if let (Ok(first), Ok(second)) = (look(self.at[0][2]), look(self.at[1][2])) {
                let looks = [&first, &second];
                if let Some(leader) = (0..2).find(|k| leads(looks[*k]) == Some(true)) {
                    let (leading, standing) = (looks[leader], looks[1 - leader]);
                    let is_led = leading.count("/term") > 0 && leading.count("/boards") == self.plan.boards as u64;
                    if is_led && leads(standing) == Some(false) && boards(standing) == Some(self.plan.boards) {
                        return Ok(leader);
                    }
                }
            }
            std::thread::sleep(LOOK_PERIOD);
        }
        Err(said("waited in vain until one manager led all boards and the other stood by"))
    }

    /// Kills the leader or stops it, waits until the other shows all views, and brings the first back.
    pub(super) fn change(&mut self, signal: Signal, random: &mut Random) -> Result<Change, CommandError> {
        std::thread::sleep(SETTLE + Duration::from_micros(random.next() % 50_000));
        let leader = self.leader()?;
        let console = self.at[1 - leader][2];
        let pieces = |look: &Look| look.count("/streaming/pieces");
        let before = pieces(&look(console)?);
        let at = send(&self.managers[leader], signal)?;
        let find = |look: &Look, name: &str| look.events_since(at).into_iter().find(|event| event.event == name);
        let started = Instant::now();
        let change = loop {
            if let Ok(look) = look(console)
                && let (Some(led), Some(whole)) = (find(&look, "leads"), find(&look, "whole"))
            {
                let ms = |to: Instant| to.saturating_duration_since(at).as_secs_f64() * 1e3;
                let resent = pieces(&look).saturating_sub(before);
                break Change { led_ms: ms(led.at), whole_ms: ms(whole.at), resent };
            }
            if started.elapsed() > HANG {
                return Err(said("waited in vain until the stand-by led"));
            }
            std::thread::sleep(LOOK_PERIOD);
        };
        if signal == Signal::STOP {
            send(&self.managers[leader], Signal::CONT)?;
        } else {
            end(&mut self.managers[leader]);
            let stands_by_for = (leader == 1).then_some(self.at[0][0]);
            (self.managers[leader], _) = manager(&self.plan, self.at[leader], false, stands_by_for)?;
        }
        Ok(change)
    }
}

impl Drop for Pair<'_> {
    fn drop(&mut self) {
        self.others.iter_mut().for_each(end);
        self.managers.iter_mut().for_each(end);
    }
}
