//! A leader's part: what a majority of its boards has seen.

use super::Seen;
use crate::chain::Wiring;
use crate::ids::{BoardKey, Epoch};
use std::collections::BTreeSet;

/// See the module's head.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Quorum {
    /// The last settled wiring, and how many boards it has.
    settled: BTreeSet<BoardKey>,
    settled_total: usize,
    /// In the first wiring of a term that was granted: the one that the grants name. More may come.
    founding: Option<Epoch>,
    /// The wiring in effect, until it is settled.
    unsettled: Option<Epoch>,
    members: BTreeSet<BoardKey>,
    /// Members that are gone since.
    gone: BTreeSet<BoardKey>,
    /// Members of the settled wiring that were ready under the one in effect.
    confirmed: BTreeSet<BoardKey>,
}

impl Quorum {
    /// The quorum of a first term, taken under this wiring: its boards are told of the term, and know that they were in it.
    pub fn taken(wiring: &Wiring) -> Self {
        let settled: BTreeSet<_> = wiring.members.iter().copied().collect();
        Self { settled_total: settled.len(), settled, ..Self::default() }
    }

    /// The quorum of a term that these boards granted, with their places; `wiring` is the newest that they name.
    pub(super) fn granted(wiring: Seen, grants: impl Iterator<Item = (BoardKey, Seen)>) -> Self {
        let mut quorum = Self { settled_total: wiring.total as usize, founding: Some(wiring.epoch), ..Self::default() };
        let mut places = BTreeSet::new();
        for (key, seen) in grants.filter(|(_, seen)| seen.epoch == wiring.epoch) {
            if places.insert(seen.id) {
                quorum.settled.insert(key);
            }
        }
        quorum
    }

    /// A board that came after the term was won has granted it too.
    pub fn on_granted(&mut self, key: BoardKey, seen: Seen) {
        if self.founding == Some(seen.epoch) && self.settled.len() < self.settled_total {
            self.settled.insert(key);
        }
    }

    /// A wiring takes effect.
    pub fn on_activated(&mut self, wiring: &Wiring) {
        self.members = wiring.members.iter().copied().collect();
        self.confirmed.clear();
        self.gone.clear();
        self.unsettled = Some(wiring.epoch);
        if self.settled_total == 0 {
            // The rig's first: there is nothing before it that another backplane could know of.
            self.settled.clone_from(&self.members);
            self.settled_total = self.members.len();
        }
    }

    /// A board was ready with a frame.
    pub fn on_ready(&mut self, key: BoardKey, epoch: Epoch) {
        if self.unsettled == Some(epoch) && self.settled.contains(&key) {
            self.confirmed.insert(key);
            if self.confirmed.len() * 2 > self.settled_total {
                self.settle();
            }
        }
    }

    /// Whether the wiring in effect is settled, so that another may take effect.
    pub fn is_settled(&self) -> bool {
        // A wiring that can't settle, for too few of those before are in it, may make room for a larger one.
        self.unsettled.is_none() || (self.founding.is_some() && self.wants_consent().is_some())
    }

    /// Whether a frame that these boards are ready with may be shown.
    pub fn may_show(&self, ready: &[BoardKey]) -> bool {
        let count = |of: &BTreeSet<BoardKey>| ready.iter().filter(|key| of.contains(key)).count();
        let carried = count(&self.members) * 2 > self.members.len();
        carried && (self.unsettled.is_none() || count(&self.settled) * 2 > self.settled_total)
    }

    /// A board is gone; should it come back, it is another one.
    pub fn on_lost(&mut self, key: BoardKey) {
        self.gone.insert(key);
    }

    /// The wiring that can't settle by itself: too few of the boards before are in it, or still there.
    pub fn wants_consent(&self) -> Option<Epoch> {
        let epoch = self.unsettled?;
        let can_confirm = |key: &&BoardKey| self.confirmed.contains(key) || !self.gone.contains(key);
        let possible = self.members.intersection(&self.settled).filter(can_confirm).count();
        (possible * 2 <= self.settled_total).then_some(epoch)
    }

    /// The stand-by has consented.
    pub fn on_consent(&mut self, epoch: Epoch) {
        if self.unsettled == Some(epoch) {
            self.settle();
        }
    }

    fn settle(&mut self) {
        self.unsettled = None;
        self.founding = None;
        self.settled.clone_from(&self.members);
        self.settled_total = self.settled.len();
    }
}
