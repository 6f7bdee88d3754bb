//! What a board should hold: by what is needed soonest, as much as its memory has room for.

use super::bits::Bits;
use super::catalogue::Catalogue;

/// What views need: meshes in the order of need, and models of several versions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Need {
    pub meshes: Vec<u32>,
    pub models: Vec<u32>,
}

/// What a board should hold.
#[derive(Clone, Debug, Default)]
pub(crate) struct Target {
    /// Pieces in the order in which they are sent; each mesh after its textures.
    pub order: Vec<u32>,
    /// The same as a set.
    pub set: Bits,
    /// Of these, what a frame may show now.
    pub now: Bits,
    /// How many pieces of `order` are for now: they come first.
    pub now_len: usize,
}

/// What a board of so much memory should hold whose views need `now`, and some seconds later `soon`, the nearest future first.
///
/// If all that is needed now has room, that comes first, then what models look like from afar, which stands in for what doesn't come
/// in time, then the future. If it hasn't, the coarsest versions come first: with them every model is shown, and the others replace
/// them as far as memory goes, the nearest first.
pub(crate) fn target(catalogue: &Catalogue, limit: u64, now: &[&Need], soon: &[&Need]) -> Target {
    let mut filling = Filling::new(catalogue, limit);
    let fits = filling.meshes(now);
    if !fits {
        filling = Filling::new(catalogue, limit);
        filling.coarsest(now);
        filling.meshes(now);
    }
    let mut target = Target { now_len: filling.order.len(), now: filling.set.clone(), ..Target::default() };
    if fits {
        filling.coarsest(now);
        for need in soon {
            filling.coarsest(&[need]);
            filling.meshes(&[need]);
        }
    }
    (target.order, target.set) = (filling.order, filling.set);
    target
}

struct Filling<'a> {
    catalogue: &'a Catalogue,
    left: u64,
    order: Vec<u32>,
    set: Bits,
}

impl<'a> Filling<'a> {
    fn new(catalogue: &'a Catalogue, limit: u64) -> Self {
        Self { catalogue, left: limit, order: Vec::new(), set: Bits::new(catalogue.len()) }
    }

    /// The first mesh of each need, then the second of each, and so on. Returns whether all had room.
    fn meshes(&mut self, needs: &[&Need]) -> bool {
        let longest = needs.iter().map(|need| need.meshes.len()).max().unwrap_or(0);
        let mut fits = true;
        for k in 0..longest {
            for need in needs {
                if let Some(mesh) = need.meshes.get(k) {
                    fits &= self.mesh(*mesh);
                }
            }
        }
        fits
    }

    fn coarsest(&mut self, needs: &[&Need]) {
        for model in needs.iter().flat_map(|need| &need.models) {
            for mesh in self.catalogue.versions(*model).last().into_iter().flatten() {
                self.mesh(*mesh);
            }
        }
    }

    /// A mesh with its textures, or nothing of it. What has no room is passed over; something smaller may still have.
    fn mesh(&mut self, mesh: u32) -> bool {
        if self.set.has(mesh) {
            return true;
        }
        let lacking = || self.catalogue.unit(mesh).filter(|piece| !self.set.has(*piece));
        let needed: u64 = lacking().map(|piece| self.catalogue.memory(piece)).sum();
        if needed > self.left {
            return false;
        }
        let from = self.order.len();
        self.order.extend(self.catalogue.unit(mesh).filter(|piece| !self.set.has(*piece)));
        for piece in &self.order[from..] {
            self.set.set(*piece);
        }
        self.left -= needed;
        true
    }
}
