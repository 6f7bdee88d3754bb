//! What selection asks of a world beside its database of balls: what has moved, which subobjects are shown at all, and, at a border, shapes.
//!
//! A [`Scene`] with its [`Entities`] is such a world; so is what a benchmark makes up. Selection itself sees neither meshes nor nodes.

use super::Counters;
use super::frustum::{Frustum, Where};
use crate::scene::blocks::Blocks;
use crate::scene::{Entities, Scene, bounds};
use glam::DAffine3;
use proto::ids::ObjectId;
use proto::scene::Sphere;

/// Pieces of a shape from which its own tree is asked before its pieces are.
const SHAPE_TREE_FROM: usize = 9;

/// Where an object is to be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Body {
    /// Where the database has it, in this slot.
    AtRest(usize),
    /// It is the moved object of this number.
    Moved(usize),
}

/// See the module's head.
pub trait World: Sync {
    /// The database.
    fn blocks(&self) -> &Blocks;

    /// Objects that are not where the database has them: numbered from 0, in an order that stays until [`World::moved_set`] changes.
    fn moved_count(&self) -> usize;

    /// The moved object of a number.
    fn moved_object(&self, moved: usize) -> u32;

    /// The number of an object's first subobject.
    fn first_piece(&self, object: u32) -> u32;

    /// The ball of the moved object of a number, world.
    fn moved_ball(&self, moved: usize) -> Sphere;

    /// The ball of its subobject k, world.
    fn moved_piece_ball(&self, moved: usize, piece: usize) -> Sphere;

    /// The number of an object if it has moved.
    fn moved_number(&self, object: u32) -> Option<usize>;

    /// Never the same for different sets of moved objects of one database.
    fn moved_set(&self) -> u64;

    /// Never the same for different places of moved objects of one database.
    fn moved_places(&self) -> u64;

    /// Calls `ask` with the objects of which not every subobject is shown at all times.
    fn conditional(&self, ask: &mut dyn FnMut(u32));

    /// Never the same for different sets of shown subobjects of one database.
    fn shown_set(&self) -> u64;

    /// Whether the subobject is shown, whatever sees it.
    fn is_shown(&self, piece: u32) -> bool;

    /// Calls `take` with the subobjects, numbered from the object's first, of a body that lies across a border of the frustum, but for those of
    /// which nothing can be seen, and with their balls.
    fn across(&self, body: Body, frustum: &Frustum, counters: &mut Counters, take: &mut dyn FnMut(usize));
}

/// A scene and where its entities are.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Where its entities are.
    pub entities: &'a Entities,
    /// By model: a bit for each version that is shown. Empty: the finest of each.
    pub shown: &'a [u16],
    /// Grows when that changes.
    pub shown_set: u64,
}

impl Placed<'_> {
    /// Mesh space → world.
    fn transform(&self, body: Body) -> (ObjectId, DAffine3) {
        match body {
            Body::AtRest(slot) => {
                let object = self.scene.blocks.object(slot);
                (ObjectId(object), self.scene.table.objects[object as usize].transform)
            }
            Body::Moved(moved) => {
                let moved = &self.entities.objects()[moved];
                (moved.object, moved.transform)
            }
        }
    }
}

impl World for Placed<'_> {
    fn blocks(&self) -> &Blocks {
        &self.scene.blocks
    }

    fn moved_count(&self) -> usize {
        self.entities.objects().len()
    }

    fn moved_object(&self, moved: usize) -> u32 {
        self.entities.objects()[moved].object.0
    }

    fn first_piece(&self, object: u32) -> u32 {
        self.scene.objects[object as usize].first_subobject.0
    }

    fn moved_ball(&self, moved: usize) -> Sphere {
        self.entities.objects()[moved].sphere
    }

    fn moved_piece_ball(&self, moved: usize, piece: usize) -> Sphere {
        let moved = &self.entities.objects()[moved];
        bounds::ball_moved(&moved.transform, self.scene.shape_of(self.scene.object(moved.object)).pieces[piece].sphere)
    }

    fn moved_number(&self, object: u32) -> Option<usize> {
        self.entities.moved_number(ObjectId(object))
    }

    fn moved_set(&self) -> u64 {
        self.entities.set_revision()
    }

    fn moved_places(&self) -> u64 {
        self.entities.revision()
    }

    fn conditional(&self, ask: &mut dyn FnMut(u32)) {
        for row in &self.scene.table.subobjects {
            if row.part_of.is_some() {
                ask(row.object.0);
            }
        }
    }

    fn shown_set(&self) -> u64 {
        self.shown_set
    }

    fn is_shown(&self, piece: u32) -> bool {
        let part = self.scene.table.subobjects[piece as usize].part_of;
        let bits = |model: usize| self.shown.get(model).copied().unwrap_or(1);
        part.is_none_or(|part| bits(part.model.0 as usize) >> part.version & 1 == 1)
    }

    fn across(&self, body: Body, frustum: &Frustum, counters: &mut Counters, take: &mut dyn FnMut(usize)) {
        let (id, transform) = self.transform(body);
        let shape = self.scene.shape_of(self.scene.object(id));
        if frustum.misses_box(&transform, shape.bounds) {
            return;
        }
        if let [_] = shape.pieces[..] {
            // The object's ball and box are its only piece's, and have been asked.
            return take(0);
        }
        let stretch = bounds::stretch(&transform);
        let blocks = &self.scene.blocks;
        let ball_of = |piece: usize| match body {
            Body::AtRest(slot) => blocks.piece_ball(slot, blocks.places(slot).start + piece),
            Body::Moved(_) => bounds::ball_moved_by(&transform, stretch, shape.pieces[piece].sphere),
        };
        let is_seen = |piece: usize, counters: &mut Counters| {
            counters.subobjects_tested += 1;
            match frustum.ball(ball_of(piece)) {
                Where::Outside => false,
                Where::Inside => true,
                Where::Across => !frustum.misses_box(&transform, shape.pieces[piece].bounds),
            }
        };
        if shape.pieces.len() < SHAPE_TREE_FROM {
            return (0..shape.pieces.len()).filter(|&piece| is_seen(piece, counters)).for_each(take);
        }
        let mut index = 0;
        while let Some(branch) = shape.tree.branches.get(index) {
            counters.branches_tested += 1;
            let found = frustum.ball(bounds::ball_moved_by(&transform, stretch, branch.ball));
            if found == Where::Across && !branch.is_leaf(index) {
                index += 1;
                continue;
            }
            counters.branches_outside += u64::from(found == Where::Outside);
            counters.branches_inside += u64::from(found == Where::Inside);
            if found != Where::Outside {
                let pieces = shape.tree.items[branch.range()].iter().map(|&piece| piece as usize);
                pieces.filter(|&piece| found == Where::Inside || is_seen(piece, counters)).for_each(&mut *take);
            }
            index = branch.next as usize;
        }
    }
}
