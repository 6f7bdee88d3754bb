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
use proto::scene::Sphere;
use std::ops::Range;

/// Largest number of items that are tested one by one rather than in a branch of their own. A guess: a branch's test
/// costs about as much as an item's.
const LEAF_ITEMS: usize = 4;

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
        let mut tree = Self {
            branches: Vec::new(),
            items: (0..balls.len() as u32).filter(|&i| balls[i as usize].radius >= 0.0).collect(),
        };
        if !tree.items.is_empty() {
            tree.grow(balls, 0..tree.items.len());
        }
        tree
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

    // The recursion is as deep as log₂ of the number of items.
    fn grow(&mut self, balls: &[Sphere], range: Range<usize>) {
        let own = self.branches.len();
        let ball = bounds::ball_of_balls(self.items[range.clone()].iter().map(|&i| &balls[i as usize]));
        self.branches.push(Branch { ball, first: range.start as u32, end: range.end as u32, next: 0 });
        if range.len() > LEAF_ITEMS {
            let middle = range.start + range.len() / 2;
            let axis = {
                let centres = self.items[range.clone()].iter().map(|&i| balls[i as usize].centre);
                longest_axis(centres)
            };
            self.items[range.clone()].select_nth_unstable_by(range.len() / 2, |&a, &b| {
                let (x, y) = (balls[a as usize].centre[axis], balls[b as usize].centre[axis]);
                x.total_cmp(&y).then(a.cmp(&b))
            });
            self.grow(balls, range.start..middle);
            self.grow(balls, middle..range.end);
        } else {
            self.items[range].sort_unstable();
        }
        self.branches[own].next = self.branches.len() as u32;
    }
}

/// The axis along which `points` reach farthest; the first of several.
pub(crate) fn longest_axis(points: impl Iterator<Item = glam::DVec3>) -> usize {
    let mut low = glam::DVec3::INFINITY;
    let mut high = glam::DVec3::NEG_INFINITY;
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
    use glam::DVec3;
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
    fn ten_thousand_balls_in_one_place_still_give_a_shallow_tree() {
        let balls = vec![Sphere { centre: DVec3::ONE, radius: 1.0 }; 10_000];
        let tree = Bvh::build(&balls);
        assert_eq!(tree, Bvh::build(&balls), "the same balls must give the same tree");
        assert!(tree.branches.len() < 10_000, "{} branches", tree.branches.len());
    }
}
