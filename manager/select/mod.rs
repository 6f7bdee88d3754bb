//! Selection: from (scene, poses, eye, views) to the lists of what each view shows, nearest first.
//!
//! Four of the steps of manager.md are here. *Detail*: which versions of each model are shown, and how they are mixed
//! ([`detail`]). *Cull*: the tree of balls over all objects is walked once for all views of an eyepoint (`walk`, by object processors, `dispatch`); a branch
//! outside of every view is dropped without a look inside it, one wholly inside gives all it has without another test,
//! and only what lies across a border is asked again, down to the single subobject and its box. Moved objects are
//! outside the tree and are asked one by one. *Key*: the power of the view's apex with respect to each subobject's ball,
//! |centre − apex|² − radius². *Sort*: by that key (`sort`, `merge`).
//!
//! Power, not distance, because balls differ in size: of two that don't overlap, the plane of equal power separates
//! them, and the eye is on the side of the one with the smaller power, so that one can't be hidden by the other. By
//! centre distance a large ball in front may come after a small one behind it (the test
//! `power_order_beats_centre_distance` has such a pair).
//!
//! If a view's work is to be spread over several boards, objects that overlap are marked and joined to groups (`overlap`, `groups`), and
//! neighbouring groups are mixed to as many lists as are wanted, evenly by predicted cost ([`cost`], `spread`). A list is in ascending power of its *subobjects*, as one
//! for the whole view is: whether objects are one group decides which list they are in, never how it is sorted.
//!
//! What can't have changed isn't done again: nothing at all if nothing moved, and only what moved if the eye didn't.
//! All of it is a pure function; [`Selector`] holds only working memory, and what it may answer again. Nothing here knows how many boards there are.

pub mod cost;
pub mod detail;
mod dispatch;
mod eyepoint;
mod frustum;
mod gather;
mod groups;
mod merge;
mod moving;
mod overlap;
#[cfg(test)]
mod properties;
mod selector;
mod sort;
mod spread;
#[cfg(test)]
mod tests;
mod walk;
mod world;

pub use detail::{Detail, DetailMode, LevelTable};
pub use dispatch::{Dispatch, GROUP};
pub use frustum::{Frustum, Where};
pub use selector::{Selector, StageTimes};
pub use spread::{Channels, longest_first};
pub use world::{Body, Placed, World};

use glam::DVec3;
use proto::ids::SubobjectId;
use proto::scene::Sphere;
use proto::view::{Pose, View};
use serde::Serialize;
use std::num::NonZeroUsize;

/// What is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Sight<'a> {
    /// The eye.
    pub eye: Pose,
    /// Its views.
    pub views: &'a [View],
    /// What is wholly beyond it is left out, m.
    pub visibility_m: Option<f64>,
    /// Objects whose radius spans fewer display elements are left out. A display element is the smallest of any view, and the air isn't taken into
    /// account: that would be up to what fades, which nothing here does.
    pub least_elements: Option<f64>,
    /// Lists that a view's work is mixed to, at most.
    pub lists: NonZeroUsize,
}

impl<'a> Sight<'a> {
    /// Everything that could colour a sample, in one list a view.
    pub fn whole(eye: Pose, views: &'a [View], visibility_m: Option<f64>) -> Self {
        Self { eye, views, visibility_m, least_elements: None, lists: NonZeroUsize::MIN }
    }
}

/// What a view sees, and what it cost to find out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    /// List after list; each ascending by power, then id.
    pub subobjects: Vec<SubobjectId>,
    /// By list: where it ends in `subobjects`.
    pub ends: Vec<usize>,
    /// By list: what drawing it is predicted to take, ns; empty if there is one list only, which nobody asks that of.
    pub costs: Vec<u64>,
    /// What was looked at and what was skipped.
    pub counters: Counters,
}

impl Selection {
    /// The lists.
    pub fn lists(&self) -> impl Iterator<Item = &[SubobjectId]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.subobjects[start..end])
    }
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
    /// Objects of which the distance was worked out, to tell whether they are large enough; with the first view of their eyepoint.
    pub objects_measured: u64,
    /// Objects of which something was selected.
    pub objects_visible: u64,
    /// Objects of which nothing was, whether asked or in a dropped branch.
    pub objects_culled: u64,
    /// Of these, objects that were left out for being small, before it was known that they are outside.
    pub objects_small: u64,
    /// Subobjects that were asked one by one.
    pub subobjects_tested: u64,
    /// Subobjects selected.
    pub subobjects_visible: u64,
    /// Subobjects not selected.
    pub subobjects_culled: u64,
    /// Objects that were marked as overlapping another; 0 where nobody asks.
    pub objects_overlapping: u64,
    /// Groups of more than one object.
    pub groups: u64,
}

impl Counters {
    fn add(&mut self, other: &Self) {
        self.branches_tested += other.branches_tested;
        self.branches_outside += other.branches_outside;
        self.branches_inside += other.branches_inside;
        self.objects_tested += other.objects_tested;
        self.objects_measured += other.objects_measured;
        self.objects_visible += other.objects_visible;
        self.objects_culled += other.objects_culled;
        self.objects_small += other.objects_small;
        self.subobjects_tested += other.subobjects_tested;
        self.subobjects_visible += other.subobjects_visible;
        self.subobjects_culled += other.subobjects_culled;
        self.objects_overlapping += other.objects_overlapping;
        self.groups += other.groups;
    }
}

/// The power of `eye` with respect to `ball`: the square of the tangent's length; negative inside.
pub fn power(eye: DVec3, ball: Sphere) -> f64 {
    ball.centre.distance_squared(eye) - ball.radius * ball.radius
}
