//! Residency: what each board holds of the scene, what it is sent and gives up next, and what frames can therefore show.
//!
//! Pure: no sockets, no clocks. The engine reports what is wanted, sent and confirmed; [`Residency::plan`] says what a
//! board is to be sent and to give up, [`Residency::available`] what all boards of a view can draw. The manager alone decides,
//! so it knows to the byte what each board holds, and a board never holds more than its limit, not even between two messages.
//!
//! | module | what |
//! |---|---|
//! | `catalogue` | the pieces by number |
//! | `holdings` | one board: held, coming, memory |
//! | `target` | what a board should hold |
//! | `substitute` | what is shown of what isn't everywhere |
//! | `foresight` | where the eye will be |
//!
//! A piece is given up only for one that is needed now or soon, the longest unused first, and never one that the frame names which the
//! board is drawing: the rule is that the last frame *sent* doesn't name it, or has been answered. What has room beyond
//! need and foresight is filled with the rest of the scene, for which nothing is given up.

mod bits;
mod catalogue;
pub(crate) mod foresight;
mod holdings;
pub(crate) mod substitute;
mod target;
#[cfg(test)]
mod tests;

pub(crate) use catalogue::Catalogue;
pub(crate) use holdings::Violation;
pub(crate) use substitute::Available;

use bits::Bits;
use holdings::Holdings;
use proto::ids::{BoardKey, ContentId, FrameNumber, SubobjectId, ViewId};
use proto::piece::PIECE_OVERHEAD;
use std::collections::BTreeMap;
use target::{Need, Target, target};

/// Pieces of the rest that are looked at in one plan: a scene has many, and most are there.
const REST_STEP: usize = 4096;
/// When something must be given up, room is made for this part of the limit too, so that it isn't sought anew for each piece.
const SLACK: u64 = 64;

/// What a board is to do next.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Plan {
    /// Give these up, before anything new comes.
    pub evict: Vec<ContentId>,
    /// It is sent these.
    pub send: Vec<u32>,
}

/// How a frame treats what isn't there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Patience {
    /// It shows what there is.
    None,
    /// It waits for all that boards have room for, and shows no more than that, so that it doesn't depend on what was before.
    Whole,
}

#[derive(Debug)]
struct Resident {
    holdings: Holdings,
    /// What the board itself said it has room for.
    claimed: u64,
    /// Names that it has said it holds, and whether it has said all.
    named: u64,
    is_known: bool,
    /// The views that it is to be ready for; `None`: all, for it isn't known yet which it will draw.
    serves: Option<Vec<ViewId>>,
    target: Target,
    /// The wishes that the target was made of.
    target_of: u64,
    /// Of the target's order: all before are held or coming.
    sent: usize,
    /// Of the target's order: all before are held.
    there: usize,
    /// There is no room for the next piece, and nothing has happened since that could make some.
    is_blocked: bool,
    /// Likewise of the catalogue's rest; at its end there is nothing more to send.
    rest: usize,
    /// The lists that the last frame sent names, until it is answered.
    drawing: Option<(FrameNumber, Vec<(ViewId, u64)>)>,
}

/// What is known of a view.
#[derive(Debug, Default)]
struct ViewUse {
    now: Need,
    /// By how far ahead.
    soon: Vec<Need>,
    /// By piece: the last revision of the list that names it. Empty as long as nothing can ever be given up.
    stamps: Vec<u64>,
    /// The revision that was stamped last.
    stamped: u64,
}

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Residency {
    catalogue: Catalogue,
    boards: BTreeMap<BoardKey, Resident>,
    views: Vec<ViewUse>,
    /// By piece: when a list named it last. What left one view often comes into the next, so all views count.
    used: Vec<u64>,
    clock: u64,
    /// Grows when what is wished for changes.
    wishes: u64,
    /// Grows when what is held changes.
    generation: u64,
    marks: Bits,
}

impl Residency {
    pub(crate) fn new(catalogue: Catalogue) -> Self {
        let marks = Bits::new(catalogue.len());
        Self {
            catalogue,
            boards: BTreeMap::new(),
            views: Vec::new(),
            used: Vec::new(),
            clock: 0,
            wishes: 1,
            generation: 1,
            marks,
        }
    }

    pub(crate) fn catalogue(&self) -> &Catalogue {
        &self.catalogue
    }

    /// Whether every board holds everything: then there is nothing to plan.
    pub(crate) fn is_whole(&self) -> bool {
        self.boards.values().all(|board| board.holdings.is_whole())
    }

    /// Another number whenever what boards hold, or should, has changed.
    pub(crate) fn generation(&self) -> u64 {
        self.generation
    }

    /// What a board has room for, what is held or coming, and the most that was; bytes.
    pub(crate) fn memory(&self, key: BoardKey) -> Option<[u64; 3]> {
        let holdings = &self.boards.get(&key)?.holdings;
        Some([holdings.limit(), holdings.bytes(), holdings.peak()])
    }

    /// A board is there that says it has room for `claimed` bytes; the rig may allow it less.
    pub(crate) fn on_board(&mut self, key: BoardKey, claimed: u64, allowed: u64) {
        let resident = Resident {
            holdings: Holdings::new(self.catalogue.len(), claimed.min(allowed)),
            claimed,
            named: 0,
            is_known: false,
            serves: None,
            target: Target::default(),
            target_of: 0,
            sent: 0,
            there: 0,
            is_blocked: false,
            rest: 0,
            drawing: None,
        };
        self.boards.insert(key, resident);
        self.generation += 1;
    }

    pub(crate) fn on_lost(&mut self, key: BoardKey) {
        self.boards.remove(&key);
        self.generation += 1;
    }

    /// A board says what it has kept; `more`: not all yet. Returns what the scene doesn't have, which it must give up.
    pub(crate) fn on_holding(
        &mut self,
        key: BoardKey,
        ids: &[ContentId],
        more: bool,
    ) -> Result<Vec<ContentId>, Violation> {
        let Some(board) = self.boards.get_mut(&key) else { return Ok(Vec::new()) };
        if board.is_known {
            return Err(Violation::Unasked);
        }
        board.named += ids.len() as u64;
        let mut foreign = Vec::new();
        for id in ids {
            match self.catalogue.find(id) {
                Some(piece) if board.holdings.on_kept(piece, self.catalogue.memory(piece)) => {}
                Some(_) => return Err(Violation::Unasked),
                None => foreign.push(*id),
            }
        }
        // What the scene doesn't have takes memory too, at least that of its name.
        let least = board.named.saturating_mul(PIECE_OVERHEAD);
        if board.holdings.bytes().max(least) > board.claimed {
            return Err(Violation::OverLimit);
        }
        board.is_known = !more;
        self.generation += 1;
        Ok(foreign)
    }

    /// A board confirms pieces.
    pub(crate) fn on_stored(&mut self, key: BoardKey, ids: &[ContentId]) -> Result<(), Violation> {
        let Some(board) = self.boards.get_mut(&key) else { return Ok(()) };
        for id in ids {
            let piece = self.catalogue.find(id).ok_or(Violation::Unknown)?;
            board.holdings.on_stored(piece, self.catalogue.memory(piece))?;
            // One that was wanted when it was sent may be one to give up by now.
            board.is_blocked &= board.target.set.len() > 0 && board.target.set.has(piece);
        }
        self.generation += 1;
        Ok(())
    }

    /// What a view's list would be if every board held everything.
    pub(crate) fn set_wanted(&mut self, view: usize, list: &[SubobjectId]) {
        let need = self.need(list);
        let entry = self.view(view);
        if entry.now != need {
            entry.now = need;
            self.wishes += 1;
        }
    }

    /// What it would be at the `ahead`-th moment that is foreseen.
    pub(crate) fn set_soon(&mut self, view: usize, ahead: usize, list: &[SubobjectId]) {
        let need = self.need(list);
        let soon = &mut self.view(view).soon;
        soon.resize(soon.len().max(ahead + 1), Need::default());
        if soon[ahead] != need {
            soon[ahead] = need;
            self.wishes += 1;
        }
    }

    /// How many views there are from now on.
    pub(crate) fn set_views(&mut self, views: usize) {
        if self.views.len() != views {
            self.views.resize_with(views, ViewUse::default);
            self.wishes += 1;
        }
    }

    /// The views that a board draws; `None`: not known yet.
    pub(crate) fn set_serves(&mut self, key: BoardKey, serves: Option<Vec<ViewId>>) {
        if let Some(board) = self.boards.get_mut(&key)
            && board.serves != serves
        {
            board.serves = serves;
            board.target_of = 0;
        }
    }

    fn view(&mut self, view: usize) -> &mut ViewUse {
        if self.views.len() <= view {
            self.set_views(view + 1);
        }
        &mut self.views[view]
    }

    /// The meshes of a list, each once, in its order. Of models that have several versions whole versions: they are shown whole or not at all.
    fn need(&mut self, list: &[SubobjectId]) -> Need {
        let mut need = Need::default();
        self.marks.empty();
        let mut models = std::collections::BTreeSet::new();
        for subobject in list {
            let Some(mesh) = self.catalogue.mesh_of(*subobject) else { continue };
            match self.catalogue.part(*subobject) {
                None => need.meshes.extend(self.marks.add(mesh).then_some(mesh)),
                Some(part) => {
                    if models.insert((part.model, part.version)) {
                        let version = &self.catalogue.versions(part.model.0)[part.version as usize];
                        need.meshes.extend(version.iter().filter(|mesh| self.marks.add(**mesh)));
                        if need.models.last() != Some(&part.model.0) {
                            need.models.push(part.model.0);
                        }
                    }
                }
            }
        }
        need
    }

    /// A view's list has that revision now, and names these. To be called before any frame with that list is sent.
    pub(crate) fn on_list(&mut self, view: usize, revision: u64, list: &[SubobjectId]) {
        let total = self.catalogue.total();
        if self.boards.values().all(|board| board.holdings.limit() >= total) && self.used.is_empty() {
            return;
        }
        if self.views.get(view).is_some_and(|entry| entry.stamped == revision && !entry.stamps.is_empty()) {
            return;
        }
        self.clock += 1;
        let pieces = self.catalogue.len();
        self.used.resize(pieces, 0);
        let entry = self.view(view);
        entry.stamps.resize(pieces, 0);
        entry.stamped = revision;
        let stamps = &mut self.views[view].stamps;
        for mesh in list.iter().filter_map(|subobject| self.catalogue.mesh_of(*subobject)) {
            for piece in self.catalogue.unit(mesh) {
                stamps[piece as usize] = revision;
                self.used[piece as usize] = self.clock;
            }
        }
    }

    /// A frame went out to a board, naming these lists.
    pub(crate) fn on_sent(&mut self, key: BoardKey, frame: FrameNumber, lists: Vec<(ViewId, u64)>) {
        if let Some(board) = self.boards.get_mut(&key) {
            board.drawing = Some((frame, lists));
            board.is_blocked = false;
        }
    }

    /// A board has drawn a frame.
    pub(crate) fn on_ready(&mut self, key: BoardKey, frame: FrameNumber) {
        if let Some(board) = self.boards.get_mut(&key)
            && board.drawing.as_ref().is_some_and(|(drawing, _)| *drawing <= frame)
        {
            board.drawing = None;
            board.is_blocked = false;
        }
    }

    /// What a board should hold, brought up to date.
    fn aim(&mut self, key: BoardKey) {
        let Some(board) = self.boards.get_mut(&key) else { return };
        if board.target_of == self.wishes {
            return;
        }
        let serves = |view: &usize| match &board.serves {
            Some(serves) => serves.contains(&ViewId(*view as u32)),
            None => true,
        };
        let views = || (0..self.views.len()).filter(serves).map(|view| &self.views[view]);
        let now: Vec<&Need> = views().map(|view| &view.now).collect();
        let ahead = self.views.iter().map(|view| view.soon.len()).max().unwrap_or(0);
        let soon: Vec<&Need> = (0..ahead).flat_map(|k| views().filter_map(move |view| view.soon.get(k))).collect();
        board.target = target(&self.catalogue, board.holdings.limit(), &now, &soon);
        (board.target_of, board.sent, board.rest) = (self.wishes, 0, 0);
        (board.there, board.is_blocked) = (0, false);
        self.generation += 1;
    }

    /// What a board is sent and gives up now. What is returned counts as done.
    pub(crate) fn plan(&mut self, key: BoardKey) -> Plan {
        let mut plan = Plan::default();
        // One that came with more than it is allowed is whole and has to give something up.
        let is_done = |board: &Resident| board.holdings.is_whole() && board.holdings.has_room(0);
        if self.boards.get(&key).is_none_or(|board| !board.is_known || is_done(board)) {
            return plan;
        }
        self.aim(key);
        let Self { catalogue, boards, views, used, .. } = self;
        let Some(board) = boards.get_mut(&key) else { return plan };
        let pinned = |board: &Resident, piece: u32| {
            let names = |(view, revision): &(ViewId, u64)| {
                let stamps = views.get(view.0 as usize).map(|view| &view.stamps);
                // Without stamps nothing is known: it may be named.
                stamps.is_none_or(|stamps| stamps.get(piece as usize).is_none_or(|stamp| stamp >= revision))
            };
            board.drawing.as_ref().is_some_and(|(_, lists)| lists.iter().any(names))
        };
        let mut make_room = |board: &mut Resident, bytes: u64| {
            if board.holdings.has_room(bytes) || board.is_blocked {
                return !board.is_blocked;
            }
            let mut idle: Vec<u32> =
                board.holdings.held().iter().filter(|piece| !board.target.set.has(*piece)).collect();
            idle.retain(|piece| !pinned(board, *piece));
            idle.sort_by_key(|piece| used.get(*piece as usize).copied().unwrap_or(0));
            let slack = board.holdings.limit() / SLACK;
            for piece in idle {
                if board.holdings.has_room(bytes + slack) {
                    break;
                }
                board.holdings.on_evict(piece, catalogue.memory(piece));
                plan.evict.push(catalogue.id(piece));
            }
            board.is_blocked = !board.holdings.has_room(bytes);
            !board.is_blocked
        };
        let mut is_stuck = !make_room(board, 0);
        while let Some(piece) = board.target.order.get(board.sent).copied().filter(|_| !is_stuck) {
            let bytes = catalogue.memory(piece);
            if board.holdings.is_absent(piece) {
                if !board.holdings.may_send(bytes) || !make_room(board, bytes) {
                    is_stuck = true;
                    break;
                }
                board.holdings.on_send(piece, bytes);
                plan.send.push(piece);
            }
            board.sent += 1;
        }
        for _ in 0..REST_STEP {
            let Some(mesh) = catalogue.rest.get(board.rest).copied().filter(|_| !is_stuck) else { break };
            let absent = || catalogue.unit(mesh).filter(|piece| board.holdings.is_absent(*piece));
            let bytes: u64 = absent().map(|piece| catalogue.memory(piece)).sum();
            if board.holdings.has_room(bytes) {
                let lacking: Vec<u32> = absent().collect();
                for piece in lacking {
                    let bytes = catalogue.memory(piece);
                    is_stuck |= !board.holdings.may_send(bytes);
                    if is_stuck {
                        break;
                    }
                    board.holdings.on_send(piece, bytes);
                    plan.send.push(piece);
                }
            }
            board.rest += usize::from(!is_stuck);
        }
        if !plan.evict.is_empty() {
            self.generation += 1;
        }
        plan
    }

    /// Whether a board holds all that is needed now and that it has room for.
    pub(crate) fn is_ready(&mut self, key: BoardKey) -> bool {
        self.aim(key);
        let Some(board) = self.boards.get_mut(&key) else { return false };
        let Resident { holdings, target, there, .. } = board;
        // What is aimed at isn't given up, so what has been found there stays there.
        let is_there = |piece: &u32| holdings.held().has(*piece);
        while *there < target.now_len && target.order.get(*there).is_some_and(is_there) {
            *there += 1;
        }
        board.is_known && board.holdings.has_room(0) && board.there == board.target.now_len
    }

    /// What all boards of each view can draw, `boards` being who draws which.
    pub(crate) fn available(&mut self, boards: &[(BoardKey, Vec<ViewId>)], patience: Patience) -> Available {
        let mut available = Available { views: vec![None; self.views.len()] };
        for (key, views) in boards {
            self.aim(*key);
            let Some(board) = self.boards.get(key) else { continue };
            let (is_all, own) = match patience {
                Patience::None => (board.holdings.is_whole(), board.holdings.held()),
                Patience::Whole => (board.holdings.limit() >= self.catalogue.total(), &board.target.now),
            };
            if is_all {
                continue;
            }
            for view in views {
                match available.views.get_mut(view.0 as usize) {
                    Some(Some(both)) => both.and(own),
                    Some(none) => *none = Some(own.clone()),
                    None => {}
                }
            }
        }
        available
    }
}
