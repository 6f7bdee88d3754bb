//! Feeds [`Residency`] with what the views show and will show, and makes frames' lists of what boards can draw.
//!
//! Looking ahead costs a selection for each view and moment; one is made per frame, in turn, and none when all boards hold all there
//! is.

use super::director::{Director, Substituted};
use super::residency::foresight::{AHEAD_S, Motion};
use super::residency::{Available, Catalogue, Patience, Residency};
use proto::chain::Wiring;
use proto::ids::{BoardId, BoardKey, ViewId};
use proto::share::views_of;
use proto::time::Time;
use std::ops::{Deref, DerefMut};

/// Boards, and the views that each draws a share of.
type Sharers = Vec<(BoardKey, Vec<ViewId>)>;

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Stream {
    residency: Residency,
    motion: Motion,
    /// The next look ahead: moment and view in turn.
    turn: usize,
    /// Looks since the eye or the scene last changed; after one full round they would find the same.
    looks: usize,
    /// Residency knows what the views want.
    is_wished: bool,
    /// For which boards and which state of theirs `available` holds.
    found_for: Option<(u64, Sharers)>,
    available: Available,
}

impl Deref for Stream {
    type Target = Residency;
    fn deref(&self) -> &Residency {
        &self.residency
    }
}

impl DerefMut for Stream {
    fn deref_mut(&mut self) -> &mut Residency {
        &mut self.residency
    }
}

impl Stream {
    pub(crate) fn new(catalogue: Catalogue) -> Self {
        Self {
            residency: Residency::new(catalogue),
            motion: Motion::default(),
            turn: 0,
            looks: 0,
            is_wished: false,
            found_for: None,
            available: Available::default(),
        }
    }

    /// The views' lists have been selected, `is_new` or as before, at a time that goes with the eye's motion.
    pub(crate) fn on_selected(&mut self, director: &mut Director, is_new: bool, at: Time) {
        let views = director.views().len();
        self.residency.set_views(views);
        self.motion.on_pose(at, director.eye());
        if self.residency.is_whole() {
            self.is_wished = false;
            return;
        }
        if is_new || !self.is_wished {
            for view in 0..views {
                self.residency.set_wanted(view, director.wanted(view));
            }
            self.is_wished = true;
            self.looks = 0;
        }
        let round = views * AHEAD_S.len();
        if self.looks < round {
            self.looks += 1;
            self.turn = (self.turn + 1) % round;
            let (ahead, view) = (self.turn / views, self.turn % views);
            if let Some(eye) = self.motion.ahead(AHEAD_S[ahead]) {
                self.residency.set_soon(view, ahead, director.foresee(view, eye));
            }
        }
    }

    /// Tells residency who draws which views; `boards` are all that are there.
    pub(crate) fn on_wiring(&mut self, wiring: Option<&Wiring>, boards: impl Iterator<Item = BoardKey>, views: usize) {
        let members = members(wiring, views);
        for key in boards {
            let serves = members.iter().find(|(member, _)| *member == key).map(|(_, views)| views.clone());
            self.residency.set_serves(key, serves);
        }
    }

    /// Makes the lists of a frame under this wiring.
    pub(crate) fn settle(&mut self, director: &mut Director, wiring: &Wiring, patience: Patience) -> Substituted {
        let members = members(Some(wiring), director.views().len());
        let generation = self.residency.generation();
        if self.found_for.as_ref().is_none_or(|(of, boards)| *of != generation || *boards != members) {
            self.available = self.residency.available(&members, patience);
            // Which may have brought targets up to date.
            self.found_for = Some((self.residency.generation(), members));
        }
        let substituted = director.settle(self.residency.catalogue(), &self.available);
        for view in 0..director.views().len() {
            self.residency.on_list(view, director.lists.revision(view), director.lists.list(view));
        }
        substituted
    }
}

/// The boards of a wiring, each with the views of which it draws a part.
fn members(wiring: Option<&Wiring>, views: usize) -> Vec<(BoardKey, Vec<ViewId>)> {
    let Some(wiring) = wiring else { return Vec::new() };
    let of = |i: usize| views_of(BoardId(i as u32), &wiring.weights, views as u32).map(ViewId).collect();
    wiring.members.iter().enumerate().map(|(i, key)| (*key, of(i))).collect()
}
