//! Selection: from (scene, poses, eye, view) to the list of what is seen, nearest first.
//!
//! Four of the steps of manager.md are here. *Detail*: which versions of each model are shown, and how they are mixed
//! ([`detail`]). *Cull*: the tree of balls over all objects is walked from the top; a branch
//! outside the view is dropped without a look inside it, one wholly inside gives all it has without another test,
//! and only what lies across a border is asked again, down to the single subobject and its box. Moved objects are
//! outside the tree and are asked one by one. *Key*: the power of the view's apex with respect to each subobject's ball,
//! |centre − apex|² − radius². *Sort*: by that key.
//!
//! Power, not distance, because balls differ in size: of two that don't overlap, the plane of equal power separates
//! them, and the eye is on the side of the one with the smaller power, so that one can't be hidden by the other. By
//! centre distance a large ball in front may come after a small one behind it (the test
//! `power_order_beats_centre_distance` has such a pair).
//!
//! All of it is a pure function; [`Selector`] holds only working memory. Nothing here knows how many boards there are.

pub mod detail;
mod frustum;
mod sort;
#[cfg(test)]
mod tests;

pub use detail::{Detail, DetailMode, LevelTable};
pub use frustum::{Frustum, Where};

use crate::scene::{Entities, MovedObject, Scene, bounds};
use glam::{DAffine3, DVec3};
use proto::frame::VersionWeights;
use proto::ids::{ObjectId, SubobjectId};
use proto::limits;
use proto::scene::Sphere;
use proto::view::{Pose, View};
use serde::Serialize;
use sort::Keyed;

/// Pieces of a shape from which its own tree is asked before its pieces are.
const SHAPE_TREE_FROM: usize = 9;

/// What a view sees, and what it cost to find out. A buffer to be used again and again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// Ascending power, then id.
    pub subobjects: Vec<SubobjectId>,
    /// Objects of which something is selected, in no order: those whose visual flag is on.
    pub objects: Vec<ObjectId>,
    /// What was looked at and what was skipped.
    pub counters: Counters,
}

/// How much work one selection was, and how much was left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counters {
    /// Branches of the scene's tree that were asked.
    pub branches_tested: u64,
    /// Those that were dropped with all below.
    pub branches_outside: u64,
    /// Those that were taken with all below.
    pub branches_inside: u64,
    /// Objects that were asked one by one.
    pub objects_tested: u64,
    /// Objects of which something was selected.
    pub objects_visible: u64,
    /// Objects of which nothing was, whether asked or in a dropped branch.
    pub objects_culled: u64,
    /// Subobjects that were asked one by one.
    pub subobjects_tested: u64,
    /// Subobjects selected.
    pub subobjects_visible: u64,
    /// Subobjects not selected.
    pub subobjects_culled: u64,
}

/// Selects; holds working memory from one call to the next.
#[derive(Clone, Debug, Default)]
pub struct Selector {
    keyed: Vec<Keyed>,
    sorting: sort::Scratch,
    shown: Vec<u16>,
}

/// What the steps of one selection share.
struct Run<'a> {
    scene: &'a Scene,
    frustum: Frustum,
    /// By model: a bit for each version that is shown. Empty if the scene has no models.
    shown: &'a [u16],
    keyed: &'a mut Vec<Keyed>,
    objects: &'a mut Vec<ObjectId>,
    counters: Counters,
}

impl Selector {
    /// A selector without memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// What `view` shows of `scene` to an eye at `eye`, `entities` being where they are. With a visibility, what is
    /// wholly beyond it is left out; so is any version that has no weight (a model without `weights` shows its finest
    /// version alone). Replaces the content of `out`.
    ///
    /// Nothing that could colour a sample is left out; something that can't may be in.
    pub fn select(
        &mut self,
        scene: &Scene,
        entities: &Entities,
        weights: &[VersionWeights],
        eye: Pose,
        view: &View,
        visibility_m: Option<f64>,
        out: &mut Selection,
    ) {
        self.keyed.clear();
        out.objects.clear();
        self.shown.clear();
        self.shown.resize(scene.models.len(), 1);
        for model in weights {
            if let Some(shown) = self.shown.get_mut(model.model.0 as usize) {
                let weights = model.weights.iter().take(limits::VERSIONS_MAX).enumerate();
                *shown = weights.fold(0, |bits, (version, &weight)| bits | (u16::from(weight > 0.0) << version));
            }
        }
        let mut run = Run {
            scene,
            frustum: Frustum::new(eye, view, visibility_m),
            shown: &self.shown,
            keyed: &mut self.keyed,
            objects: &mut out.objects,
            counters: Counters::default(),
        };
        run.at_rest(entities);
        for moved in entities.objects() {
            run.moved(moved);
        }
        let mut counters = run.counters;
        counters.objects_visible = out.objects.len() as u64;
        counters.objects_culled = scene.objects.len() as u64 - counters.objects_visible;
        counters.subobjects_visible = self.keyed.len() as u64;
        counters.subobjects_culled = scene.table.subobjects.len() as u64 - counters.subobjects_visible;
        out.counters = counters;

        sort::sort(&mut self.keyed, &mut self.sorting);
        out.subobjects.clear();
        out.subobjects.extend(self.keyed.iter().map(|entry| entry.id));
    }
}

/// The power of `eye` with respect to `ball`: the square of the tangent's length; negative inside.
pub fn power(eye: DVec3, ball: Sphere) -> f64 {
    ball.centre.distance_squared(eye) - ball.radius * ball.radius
}

impl Run<'_> {
    /// Walks the tree over the objects that are where the file puts them.
    fn at_rest(&mut self, entities: &Entities) {
        let tree = &self.scene.tree;
        let mut index = 0;
        while let Some(branch) = tree.branches.get(index) {
            self.counters.branches_tested += 1;
            let found = self.frustum.ball(branch.ball);
            if found == Where::Across && !branch.is_leaf(index) {
                index += 1;
                continue;
            }
            match found {
                Where::Outside => self.counters.branches_outside += 1,
                Where::Inside => self.counters.branches_inside += 1,
                Where::Across => {}
            }
            if found != Where::Outside {
                for &item in &tree.items[branch.range()] {
                    let id = ObjectId(item);
                    if entities.is_moved(id) {
                    } else if found == Where::Inside {
                        self.take_at_rest(id);
                    } else {
                        self.test_at_rest(id);
                    }
                }
            }
            index = branch.next as usize;
        }
    }

    fn take_at_rest(&mut self, id: ObjectId) {
        let before = self.keyed.len();
        for subobject in self.scene.subobjects_of(self.scene.object(id)) {
            self.take(subobject, self.scene.subobject_spheres[subobject as usize]);
        }
        self.taken_since(before, id);
    }

    /// The object is visible if something of it was taken.
    fn taken_since(&mut self, before: usize, id: ObjectId) {
        if self.keyed.len() > before {
            self.objects.push(id);
        }
    }

    fn test_at_rest(&mut self, id: ObjectId) {
        self.counters.objects_tested += 1;
        let object = self.scene.object(id);
        match self.frustum.ball(object.sphere) {
            Where::Outside => {}
            Where::Inside => self.take_at_rest(id),
            Where::Across => {
                let transform = self.scene.table.objects[id.0 as usize].transform;
                self.across(id, &transform, true);
            }
        }
    }

    fn moved(&mut self, moved: &MovedObject) {
        self.counters.objects_tested += 1;
        match self.frustum.ball(moved.sphere) {
            Where::Outside => {}
            Where::Inside => {
                let object = self.scene.object(moved.object);
                let stretch = bounds::stretch(&moved.transform);
                let before = self.keyed.len();
                for (piece, subobject) in
                    self.scene.shape_of(object).pieces.iter().zip(self.scene.subobjects_of(object))
                {
                    self.take(subobject, bounds::ball_moved_by(&moved.transform, stretch, piece.sphere));
                }
                self.taken_since(before, moved.object);
            }
            Where::Across => self.across(moved.object, &moved.transform, false),
        }
    }

    /// An object that lies across a border: its pieces one by one, by way of their own tree if they are many.
    fn across(&mut self, id: ObjectId, transform: &DAffine3, at_rest: bool) {
        let scene = self.scene;
        let object = scene.object(id);
        let shape = scene.shape_of(object);
        if self.frustum.misses_box(transform, shape.bounds) {
            return;
        }
        let stretch = bounds::stretch(transform);
        let before = self.keyed.len();
        let first = object.first_subobject.0;
        let ball_of = |piece: usize| {
            if at_rest {
                scene.subobject_spheres[first as usize + piece]
            } else {
                bounds::ball_moved_by(transform, stretch, shape.pieces[piece].sphere)
            }
        };
        let test = |run: &mut Self, piece: usize| {
            run.counters.subobjects_tested += 1;
            let ball = ball_of(piece);
            let visible = match run.frustum.ball(ball) {
                Where::Outside => false,
                Where::Inside => true,
                Where::Across => !run.frustum.misses_box(transform, shape.pieces[piece].bounds),
            };
            if visible {
                run.take(first + piece as u32, ball);
            }
        };
        if let [_] = shape.pieces[..] {
            // The object's ball and box are its only piece's, and have been asked.
            self.take(first, ball_of(0));
        } else if shape.pieces.len() < SHAPE_TREE_FROM {
            (0..shape.pieces.len()).for_each(|piece| test(self, piece));
        } else {
            let mut index = 0;
            while let Some(branch) = shape.tree.branches.get(index) {
                self.counters.branches_tested += 1;
                let found = self.frustum.ball(bounds::ball_moved_by(transform, stretch, branch.ball));
                if found == Where::Across && !branch.is_leaf(index) {
                    index += 1;
                    continue;
                }
                let pieces = shape.tree.items[branch.range()].iter().map(|&piece| piece as usize);
                match found {
                    Where::Outside => self.counters.branches_outside += 1,
                    Where::Inside => {
                        self.counters.branches_inside += 1;
                        pieces.for_each(|piece| self.take(first + piece as u32, ball_of(piece)));
                    }
                    Where::Across => pieces.for_each(|piece| test(self, piece)),
                }
                index = branch.next as usize;
            }
        }
        self.taken_since(before, id);
    }

    fn take(&mut self, subobject: u32, ball: Sphere) {
        if !self.shown.is_empty() {
            let part = self.scene.table.subobjects[subobject as usize].part_of;
            if part.is_some_and(|part| self.shown[part.model.0 as usize] >> part.version & 1 == 0) {
                return;
            }
        }
        let key = sort::ordered(power(self.frustum.apex(), ball));
        self.keyed.push(Keyed { key, id: SubobjectId(subobject) });
    }
}
