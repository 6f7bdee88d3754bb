//! The checkers. They see only what is sent, drawn and shown, know nothing of the chain's inside, and compute what is right by
//! themselves: tiles are counted as bits.

use crate::net::Node;
use crate::plan::{Plan, STALL_HARMLESS};
use proto::ids::{BoardKey, Epoch, FrameNumber, Term};
use proto::message::Swap;
use std::collections::BTreeMap;
use std::rc::Rc;

/// How long after a fault its consequences may last: a frame may be late, a board may be put out, ns.
const AFTERMATH: u64 = 1_000_000_000;
/// Shortest time between two stalls that count as two, ns.
const STALL_APART: u64 = 150_000_000;
/// Frames that are remembered.
const FRAMES: usize = 256;
/// What a display may lag behind a swap, ns.
const LAG: u64 = 60_000_000;
/// Tiles of a view, as bits.
pub const VIEW_TILES: u64 = (1 << 15) - 1;
/// The upper bits of a board's key count its manager's lives.
pub(crate) const LIFE_SHIFT: u32 = 16;
/// Violations that are kept of one run.
const VIOLATIONS_MAX: usize = 8;

/// What a run has been like.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames swapped.
    pub frames: u64,
    /// Of these, frames in which some view repeated.
    pub late: u64,
    /// Frames that a leader didn't show for want of a majority.
    pub held: u64,
    /// Boards put out.
    pub put_out: u64,
    /// Times that a backplane began to lead after another.
    pub takeovers: u64,
    /// Of these, from a leader that had shown nothing by its first term.
    pub early: u64,
    /// From the first fault to the moment when the backplane knew that a board was gone, ns.
    pub noticed: Option<u64>,
    /// From the first fault to the first whole frame that was opened after it was noticed, ns.
    pub repaired: Option<u64>,
}

/// See the module's head.
#[derive(Debug, Default)]
pub struct Checks {
    violations: Vec<String>,
    /// What has been counted.
    pub counts: Counts,
    opened: BTreeMap<(u8, FrameNumber), Epoch>,
    drawn: BTreeMap<(u64, FrameNumber, Epoch), (u64, Vec<u64>)>,
    swapped: BTreeMap<FrameNumber, Swap>,
    /// When the newest frames were swapped.
    swap_times: Vec<(u64, FrameNumber)>,
    shown: BTreeMap<u8, Swap>,
    /// Until when a late frame has a cause.
    disturbed: u64,
    /// Until when each board's being put out has one.
    excused: [u64; 16],
    stalled: [u64; 16],
    first_fault: Option<u64>,
    last_late: u64,
    /// Something was shown by some term.
    has_term: bool,
    /// The highest term that each board has drawn by.
    terms: [Term; 16],
}

/// In which of its lives the manager was that gave a board this key.
fn life(key: BoardKey) -> u64 {
    key.0 >> LIFE_SHIFT
}

/// Whether two swaps are of different lives of a manager that leads without a term, and numbers everything anew in each.
fn is_anew(a: &Swap, b: &Swap) -> bool {
    let of = |swap: &Swap| swap.boards.first().map(|key| life(*key)).filter(|_| swap.epoch.term() == Term(0));
    of(a).zip(of(b)).is_some_and(|(a, b)| a != b)
}

fn trim<K: Ord, V>(map: &mut BTreeMap<K, V>) {
    while map.len() > FRAMES {
        map.pop_first();
    }
}

impl Checks {
    /// What was wrong.
    pub fn violations(&self) -> &[String] {
        &self.violations
    }

    /// Notes that something is wrong.
    pub fn violate(&mut self, now: u64, what: String) {
        if self.violations.len() < VIOLATIONS_MAX {
            self.violations.push(format!("at {}.{:06} ms: {what}", now / 1_000_000, now % 1_000_000));
        }
    }

    /// The run begins; until then frames may be late, for the rig fills.
    pub fn begin(&mut self, until: u64) {
        self.disturbed = until;
    }

    /// A display's process ends; the next one has shown nothing.
    pub fn on_display_lost(&mut self, display: u8) {
        self.shown.remove(&display);
    }

    /// A board's process ends; the next one remembers no term.
    pub fn on_board_lost(&mut self, board: u8) {
        self.terms[usize::from(board)] = Term(0);
    }

    /// Something goes wrong from now to `until` that may make frames late.
    pub fn disturb(&mut self, now: u64, until: u64) {
        self.first_fault.get_or_insert(now);
        self.disturbed = self.disturbed.max(until + AFTERMATH);
    }

    /// It may also have this node, or, if it is a backplane, all boards put out.
    pub fn excuse(&mut self, node: Node, until: u64) {
        match node {
            Node::Board(i) => {
                let excused = &mut self.excused[usize::from(i)];
                *excused = (*excused).max(until + AFTERMATH);
            }
            Node::Manager(_) => self.excused.iter_mut().for_each(|e| *e = (*e).max(until + AFTERMATH)),
            Node::Display(_) => {}
        }
    }

    /// A process stalls. Two stalls without a pause between them are one.
    pub fn on_stall(&mut self, now: u64, node: Node, until: u64) {
        self.disturb(now, until);
        if let Node::Board(i) = node {
            let stalled = &mut self.stalled[usize::from(i)];
            let is_long = until - now > STALL_HARMLESS || now < *stalled + STALL_APART;
            *stalled = (*stalled).max(until);
            if is_long {
                self.excuse(node, until);
            }
        }
    }

    /// A backplane begins with frames of its own numbering.
    pub fn on_restart(&mut self) {
        self.opened.clear();
        self.drawn.clear();
        self.swapped.clear();
        self.swap_times.clear();
        self.shown.clear();
    }

    /// A backplane opens a frame.
    pub fn on_opened(&mut self, now: u64, rank: u8, frame: FrameNumber, epoch: Epoch) {
        if let Some(before) = self.opened.insert((rank, frame), epoch)
            && before != epoch
        {
            self.violate(now, format!("{frame:?} was opened under {before:?} and under {epoch:?}"));
        }
        trim(&mut self.opened);
    }

    /// A board, which its manager knows by `key`, has drawn.
    pub fn on_drawn(
        &mut self,
        now: u64,
        (board, key): (u8, BoardKey),
        frame: FrameNumber,
        epoch: Epoch,
        tiles: &[u64],
    ) {
        let highest = &mut self.terms[usize::from(board)];
        let before = std::mem::replace(highest, epoch.term().max(*highest));
        if epoch.term() < before {
            self.violate(now, format!("board {board} draws {frame:?} by a lower term, {epoch:?}, than {before:?}"));
        }
        let (boards, drawn) = self.drawn.entry((life(key), frame, epoch)).or_insert_with(|| (0, vec![0; tiles.len()]));
        let twice = *boards >> board & 1 == 1 && tiles.iter().any(|tiles| *tiles != 0);
        *boards |= 1 << board;
        let overlap = drawn.iter().zip(tiles).any(|(drawn, tiles)| drawn & tiles != 0);
        for (drawn, tiles) in drawn.iter_mut().zip(tiles) {
            *drawn |= tiles;
        }
        if twice || overlap {
            self.violate(now, format!("a tile of {frame:?}, {epoch:?}, has a second owner, board {board}"));
        }
        trim(&mut self.drawn);
    }

    /// A backplane says swap. `opened` is when the frame was.
    pub fn on_swap(&mut self, now: u64, swap: &Swap, opened: u64, late: bool) {
        if self.swapped.insert(swap.frame, swap.clone()).is_some() {
            self.violate(now, format!("{:?} is swapped a second time, under {:?}", swap.frame, swap.epoch));
        }
        trim(&mut self.swapped);
        self.has_term |= swap.epoch.term() > Term(0);
        self.swap_times.push((now, swap.frame));
        if self.swap_times.len() > FRAMES {
            self.swap_times.drain(..FRAMES / 2);
        }
        self.counts.frames += 1;
        self.counts.late += u64::from(late);
        if late {
            self.last_late = now;
            if now > self.disturbed {
                self.violate(now, format!("{:?} is late without a cause", swap.frame));
            }
        } else if let (Some(first), Some(noticed)) = (self.first_fault, self.counts.noticed)
            && opened >= first + noticed
        {
            self.counts.repaired.get_or_insert(now - first);
        }
    }

    /// A backplane begins to lead after another.
    pub fn on_takeover(&mut self, now: u64) {
        self.counts.takeovers += 1;
        self.counts.early += u64::from(!self.has_term);
        self.on_lost(now);
    }

    /// The backplane knows that a board is gone.
    pub fn on_lost(&mut self, now: u64) {
        if let Some(first) = self.first_fault {
            self.counts.noticed.get_or_insert(now - first);
        }
    }

    /// A board is put out.
    pub fn on_put_out(&mut self, now: u64, node: Node, why: &str) {
        self.counts.put_out += 1;
        self.on_lost(now);
        if let Node::Board(i) = node
            && now > self.excused[usize::from(i)]
        {
            self.violate(now, format!("board {i} is put out without a cause: {why}"));
        }
    }

    /// A display shows a frame; `tiles` are what each of the swap's boards drew.
    pub fn on_shown(&mut self, now: u64, display: u8, swap: &Swap, views: &[u32], tiles: &[Rc<[u64]>]) {
        let frame = swap.frame;
        let before = self.shown.insert(display, swap.clone());
        if let Some(before) = before.filter(|before| before.frame >= frame && !is_anew(before, swap)) {
            self.violate(now, format!("display {display} shows {frame:?} after {:?}", before.frame));
        }
        let is_other = |of: &Swap| (of.epoch, &of.complete) != (swap.epoch, &swap.complete) && !is_anew(of, swap);
        if self.swapped.get(&frame).is_some_and(is_other) {
            self.violate(now, format!("display {display} shows another {frame:?} than others"));
        }
        for view in views.iter().filter(|view| swap.complete[**view as usize]) {
            let of_view = || tiles.iter().map(|tiles| tiles[*view as usize]);
            let owners: u32 = of_view().map(u64::count_ones).sum();
            let drawn = of_view().fold(0, |all, tiles| all | tiles);
            if drawn != VIEW_TILES || owners != VIEW_TILES.count_ones() {
                let (frame, epoch) = (swap.frame, swap.epoch);
                self.violate(
                    now,
                    format!("view {view} of {frame:?}, {epoch:?} is whole, but tiles are {drawn:015b}, {owners} owned"),
                );
            }
        }
    }

    /// Looks whether a display that isn't disturbed shows what was swapped.
    pub fn look(&mut self, now: u64, display: u8, shown: Option<FrameNumber>) {
        // Where little moves the next frame, with which a display catches up, may be a while away.
        if now <= self.disturbed + AFTERMATH {
            return;
        }
        // Nor does one that is the last for a long time bring it what it has missed.
        let over = self.disturbed.saturating_sub(AFTERMATH);
        let due = self.swap_times.iter().rev().find(|(at, _)| at + LAG < now && *at > over).map(|(_, frame)| *frame);
        if due.is_some_and(|due| shown.is_none_or(|shown| shown < due)) {
            self.violate(now, format!("display {display} shows {shown:?}, {due:?} was swapped long ago"));
        }
    }

    /// The end: faults were over long before, so everything is whole again. `members` are the boards of the wiring in
    /// effect, `expected` those that run.
    pub fn on_end(&mut self, now: u64, plan: &Plan, members: Option<usize>, expected: usize) {
        if expected == 0 || plan.may_lose_majority() {
            return;
        }
        if members != Some(expected) {
            self.violate(now, format!("{members:?} of {expected} boards are in the row long after the last fault"));
        }
        let recent = self.swap_times.last().is_some_and(|(at, _)| now - at < AFTERMATH);
        if !recent && !plan.rests {
            self.violate(now, "no frame is shown long after the last fault".into());
        }
        let calm = plan.faults.iter().map(|fault| fault.until).max().unwrap_or(0);
        if self.last_late > calm.max(1_000_000_000) + 2 * AFTERMATH {
            self.violate(now, "frames are late long after the last fault".into());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Faults;

    const LONG_AFTER: u64 = 10_000_000_000;

    fn swap(frame: u64, complete: bool) -> Swap {
        let boards = vec![BoardKey(1), BoardKey(2)];
        Swap {
            frame: FrameNumber(frame),
            epoch: Epoch(1),
            complete: vec![complete],
            boards,
            preview: false,
            moment: None,
        }
    }

    /// What is said of what happens.
    fn said(happen: impl Fn(&mut Checks)) -> String {
        let mut checks = Checks::default();
        happen(&mut checks);
        checks.violations().join("; ")
    }

    #[test]
    fn a_right_run_is_right() {
        let tiles: [Rc<[u64]>; 2] = [vec![VIEW_TILES >> 1].into(), vec![VIEW_TILES & !(VIEW_TILES >> 1)].into()];
        let happen = |checks: &mut Checks| {
            checks.on_opened(1, 0, FrameNumber(1), Epoch(1));
            checks.on_drawn(2, (0, BoardKey(1)), FrameNumber(1), Epoch(1), &tiles[0]);
            checks.on_drawn(2, (1, BoardKey(2)), FrameNumber(1), Epoch(1), &tiles[1]);
            checks.on_swap(3, &swap(1, true), 1, false);
            checks.on_shown(4, 0, &swap(1, true), &[0], &tiles);
            checks.look(LONG_AFTER, 0, Some(FrameNumber(1)));
        };
        assert_eq!(said(happen), "");
    }

    #[test]
    fn every_checker_fires() {
        let half: Rc<[u64]> = vec![VIEW_TILES >> 1].into();
        let draw =
            |checks: &mut Checks, board| checks.on_drawn(1, (board, BoardKey(1)), FrameNumber(1), Epoch(1), &half);
        assert!(said(|c| [1, 2].into_iter().for_each(|board| draw(c, board))).contains("second owner"));
        let draw_by =
            |c: &mut Checks, term: u64| c.on_drawn(1, (3, BoardKey(1)), FrameNumber(term), Epoch(term << 32), &half);
        assert!(said(|c| [2, 1].into_iter().for_each(|term| draw_by(c, term))).contains("by a lower term"));
        let anew = |c: &mut Checks| {
            draw_by(c, 2);
            c.on_board_lost(3);
            draw_by(c, 1);
        };
        assert_eq!(said(anew), "");
        assert!(said(|c| c.on_shown(1, 0, &swap(1, true), &[0], std::slice::from_ref(&half))).contains("tiles are"));
        let open = |c: &mut Checks, epoch| c.on_opened(1, 0, FrameNumber(1), Epoch(epoch));
        assert!(said(|c| [1, 2].into_iter().for_each(|epoch| open(c, epoch))).contains("was opened under"));
        let swap_one = |c: &mut Checks| c.on_swap(1, &swap(1, true), 1, false);
        assert!(said(|c| (0..2).for_each(|_| swap_one(c))).contains("a second time"));
        assert!(said(|c| c.on_swap(LONG_AFTER, &swap(1, false), 1, true)).contains("late without a cause"));
        assert!(said(|c| c.on_put_out(LONG_AFTER, Node::Board(1), "")).contains("put out without a cause"));
        let shows = |c: &mut Checks, frame| c.on_shown(1, 0, &swap(frame, false), &[0], &[]);
        assert!(said(|c| [2, 1].into_iter().for_each(|frame| shows(c, frame))).contains("after"));
        let other = |c: &mut Checks| {
            swap_one(c);
            shows(c, 1);
        };
        assert!(said(other).contains("than others"));
        let lag = |c: &mut Checks| {
            swap_one(c);
            c.look(LONG_AFTER, 0, None);
        };
        assert!(said(lag).contains("swapped long ago"));
        let plan = Plan { managers: 1, rests: false, ..Plan::draw(1, Faults::None) };
        assert!(said(|c| c.on_end(LONG_AFTER, &plan, Some(1), 2)).contains("in the row"));
        assert!(said(|c| c.on_end(LONG_AFTER, &plan, Some(2), 2)).contains("no frame is shown"));
        let late = |c: &mut Checks| {
            c.begin(LONG_AFTER);
            c.on_swap(LONG_AFTER - 1, &swap(1, false), 1, true);
            c.on_end(LONG_AFTER, &plan, Some(2), 2);
        };
        assert!(said(late).contains("long after the last fault"));
    }
}
