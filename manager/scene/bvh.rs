//! The culling tree: a hierarchy of balls over a set of balls, in one flat array.
//!
//! A scene's own node tree is built by a modeller, who groups by name ("all trees") more often than by place, and a file
//! may well be a flat list of ten thousand nodes. So the tree that culls is made from the places alone: the set is cut
//! in two at the median along the longest axis of its centres, and so on until few are left. The cut is by count,
//! hence the depth is log₂ n whatever the input, and ties go by index, hence the same scene gives the same tree.
//!
//! Branches lie in depth-first order, and each says where its subtree ends. A traversal is a loop over one index:
//! `+1` looks inside, `= next` passes by. The items of a branch are a range of [`Bvh::items`], so that a branch wholly
//! inside a frustum gives all of its items without another test.

use super::bounds;
use glam::DVec3;
use proto::scene::Sphere;
use std::ops::Range;

/// Largest number of items that are tested one by one rather than in a branch of their own. A guess: a branch's test
/// costs about as much as an item's.
const LEAF_ITEMS: usize = 4;

/// Subtrees of fewer items are grown by one thread.
const FORK_FROM: usize = 8192;

/// A branch of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch {
    /// Encloses all items.
    pub ball: Sphere,
    /// First item, an index into [`Bvh::items`].
    pub first: u32,
    /// One past the last item.
    pub end: u32,
    /// The branch after this one and all below it.
    pub next: u32,
}

impl Branch {
    /// The items of this branch, as indices into [`Bvh::items`].
    pub fn range(&self) -> Range<usize> {
        self.first as usize..self.end as usize
    }

    /// Whether there are no branches below, given this branch's own index.
    pub fn is_leaf(&self, own: usize) -> bool {
        self.next as usize == own + 1
    }
}

/// A hierarchy over the balls that it was built from.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bvh {
    /// Depth-first; empty if there are no items.
    pub branches: Vec<Branch>,
    /// Indices of the enclosed balls, so ordered that each branch has a range.
    pub items: Vec<u32>,
}

impl Bvh {
    /// The tree over all of `balls` that enclose something. Order n log² n.
    pub fn build(balls: &[Sphere]) -> Self {
        let items = (0..balls.len() as u32).filter(|&i| balls[i as usize].radius >= 0.0).collect();
        Self::grown(items, Shape { leaf: LEAF_ITEMS, grain: 1, cut: Cut::Middle }, &|i| balls[i as usize])
    }

    /// The first branch that can't be one, and why: for trees that come from outside. In a tree without fault, every
    /// range lies within the items and every way through the branches ends; which things are enclosed is not looked at.
    pub(super) fn fault(&self) -> Option<(usize, &'static str)> {
        let (branches, items) = (self.branches.len(), self.items.len());
        if branches == 0 && items > 0 {
            return Some((0, "items without a branch"));
        }
        // Ends of the subtrees that the branch is in: where the next one begins, and its items.
        let mut open: Vec<(usize, u32, u32)> = Vec::new();
        for (own, branch) in self.branches.iter().enumerate() {
            while open.last().is_some_and(|(next, ..)| *next == own) {
                open.pop();
            }
            let next = branch.next as usize;
            let (end, first_item, end_item) = match open.last() {
                Some(&around) => around,
                None if own == 0 => (branches, 0, items as u32),
                None => return Some((own, "a second root")),
            };
            if next <= own || next > end || (own == 0 && next != branches) {
                return Some((own, "its subtree doesn't end within the one around it"));
            }
            if branch.first > branch.end || branch.first < first_item || branch.end > end_item {
                return Some((own, "its items are not among those of the branch around it"));
            }
            open.push((next, branch.first, branch.end));
        }
        None
    }

    /// The tree over the balls 0 to `count` − 1, none of them empty, whose leaves are blocks: each has exactly `block` items, but for
    /// the last one. Leaf k begins at item k · `block`, so that what is kept by item lies block by block.
    pub fn in_blocks(count: usize, block: usize, cut: Cut, ball: &(impl Fn(u32) -> Sphere + Sync)) -> Self {
        Self::grown((0..count as u32).collect(), Shape { leaf: block, grain: block, cut }, ball)
    }

    fn grown(mut items: Vec<u32>, shape: Shape, ball: &(impl Fn(u32) -> Sphere + Sync)) -> Self {
        const NO_BRANCH: Branch = Branch { ball: bounds::NOTHING, first: 0, end: 0, next: 0 };
        if items.is_empty() {
            return Self::default();
        }
        let mut branches = vec![NO_BRANCH; shape.branches(items.len())];
        shape.grow(&mut branches, &mut items, (0, 0), ball);
        Self { branches, items }
    }
}

/// Where a branch is cut in two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cut {
    /// At the median: the depth is log₂ n.
    #[default]
    Middle,
    /// An eighth to one side. Such trees come from modellers, not from here; what hands out their nodes is measured on them.
    Eighth,
}

/// How a tree is cut.
#[derive(Clone, Copy)]
struct Shape {
    /// Most items of a leaf.
    leaf: usize,
    /// Cuts are at multiples of it; `leaf` or a divisor of that.
    grain: usize,
    cut: Cut,
}

impl Shape {
    /// Where `count` items are cut in two, if they are.
    fn cut(self, count: usize) -> Option<usize> {
        let part = match self.cut {
            Cut::Middle => count / 2,
            Cut::Eighth => (count / 8).max(1),
        };
        (count > self.leaf).then(|| part.next_multiple_of(self.grain))
    }

    /// Branches over so many items.
    fn branches(self, count: usize) -> usize {
        self.cut(count).map_or(1, |cut| 1 + self.branches(cut) + self.branches(count - cut))
    }

    /// Fills `branches` with the tree over `items`, which lie in the whole tree from `at_branch` and `at_item` on. The recursion is as deep
    /// as the tree: log₂ n, or log n to the base of 8/7. Which thread grows what makes no difference.
    fn grow(
        self,
        branches: &mut [Branch],
        items: &mut [u32],
        (at_branch, at_item): (usize, usize),
        ball: &(impl Fn(u32) -> Sphere + Sync),
    ) {
        let balls = || items.iter().map(|&i| ball(i));
        let (first, end) = (at_item as u32, (at_item + items.len()) as u32);
        let next = (at_branch + branches.len()) as u32;
        branches[0] = Branch { ball: bounds::ball_of_balls(balls()), first, end, next };
        let Some(cut) = self.cut(items.len()) else {
            items.sort_unstable();
            return;
        };
        let axis = longest_axis(balls().map(|ball| ball.centre));
        items.select_nth_unstable_by(cut, |&a, &b| {
            let along = |i| -> f64 { ball(i).centre[axis] };
            along(a).total_cmp(&along(b)).then(a.cmp(&b))
        });
        let fork = items.len() >= FORK_FROM;
        let (low, high) = items.split_at_mut(cut);
        let (below, above) = branches[1..].split_at_mut(self.branches(cut));
        let at_high = (at_branch + 1 + below.len(), at_item + cut);
        let mut grow_low = || self.grow(below, low, (at_branch + 1, at_item), ball);
        let mut grow_high = || self.grow(above, high, at_high, ball);
        if fork {
            rayon::join(grow_low, grow_high);
        } else {
            grow_low();
            grow_high();
        }
    }
}

/// The axis along which `points` reach farthest; the first of several.
pub(crate) fn longest_axis(points: impl Iterator<Item = DVec3>) -> usize {
    let mut low = DVec3::INFINITY;
    let mut high = DVec3::NEG_INFINITY;
    for point in points {
        low = low.min(point);
        high = high.max(point);
    }
    let extent = high - low;
    if extent.x >= extent.y && extent.x >= extent.z {
        0
    } else if extent.y >= extent.z {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn inside(outer: Sphere, inner: Sphere) -> bool {
        inner.centre.distance(outer.centre) + inner.radius <= outer.radius * (1.0 + 1e-12)
    }

    proptest! {
        #[test]
        fn every_branch_encloses_its_items_and_every_item_is_in_one_leaf(
            balls in prop::collection::vec((-1e3..1e3, -1e3..1e3, -1e3..1e3, -0.2..50.0), 0..200)
        ) {
            let balls: Vec<_> =
                balls.into_iter().map(|(x, y, z, radius)| Sphere { centre: DVec3::new(x, y, z), radius }).collect();
            let tree = Bvh::build(&balls);
            let mut seen = vec![0; balls.len()];
            for (i, branch) in tree.branches.iter().enumerate() {
                for &item in &tree.items[branch.range()] {
                    prop_assert!(inside(branch.ball, balls[item as usize]));
                    if branch.is_leaf(i) {
                        seen[item as usize] += 1;
                    }
                }
                prop_assert!(!branch.is_leaf(i) || branch.range().len() <= LEAF_ITEMS);
            }
            for (ball, seen) in balls.iter().zip(seen) {
                prop_assert_eq!(seen, i32::from(ball.radius >= 0.0));
            }
        }
    }

    #[test]
    fn blocks_are_full_and_begin_at_multiples() {
        let ball =
            |i: u32| Sphere { centre: DVec3::new(f64::from(i * 7919 % 1000), f64::from(i % 31), 0.0), radius: 1.0 };
        let counts = [1, 63, 64, 65, 1000, 20_000].into_iter();
        for (count, cut) in counts.flat_map(|count| [(count, Cut::Middle), (count, Cut::Eighth)]) {
            let tree = Bvh::in_blocks(count, 64, cut, &ball);
            let leaves: Vec<_> = (0..).zip(&tree.branches).filter(|(i, branch)| branch.is_leaf(*i)).collect();
            for (k, (_, leaf)) in leaves.iter().enumerate() {
                assert_eq!(leaf.range(), k * 64..count.min((k + 1) * 64), "of {count}");
                assert!(tree.items[leaf.range()].iter().all(|&i| inside(leaf.ball, ball(i))), "of {count}");
            }
            assert_eq!(leaves.len(), count.div_ceil(64));
        }
    }

    #[test]
    fn ten_thousand_balls_in_one_place_still_give_a_shallow_tree() {
        let balls = vec![Sphere { centre: DVec3::ONE, radius: 1.0 }; 10_000];
        let tree = Bvh::build(&balls);
        assert_eq!(tree, Bvh::build(&balls), "the same balls must give the same tree");
        assert!(tree.branches.len() < 10_000, "{} branches", tree.branches.len());
    }
}
