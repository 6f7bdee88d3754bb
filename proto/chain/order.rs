//! An order of the row in which no two neighbours are boards that can't reach each other.
//!
//! The backplane learns that a link couldn't be made only by trying. It keeps the pairs that failed for a while and looks for
//! an order without them, as near to the present one as it can; only when there is none is a board put out.

use crate::ids::BoardKey;
use crate::time::Time;
use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

/// How long a pair that failed isn't tried again. A guess: long against a wiring, short against a flight.
const MEMORY: Duration = Duration::from_secs(30);
/// Boards looked at before an order is given up. With few pairs apart an order for 256 boards takes a few hundred, and 33 000 if one
/// board must be at the right end; it matters only where hardly any order exists.
const LOOKS_MAX: u32 = 100_000;

/// Pairs of boards, left and right, between which no link could be made.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Apart {
    pairs: BTreeMap<(BoardKey, BoardKey), Time>,
}

impl Apart {
    /// `right` couldn't reach `left`.
    pub(super) fn insert(&mut self, now: Time, left: BoardKey, right: BoardKey) {
        self.pairs.insert((left, right), now);
    }

    /// A board is gone; should it come back, it is another one.
    pub(super) fn forget(&mut self, key: BoardKey) {
        self.pairs.retain(|(left, right), _| *left != key && *right != key);
    }

    /// `row`, changed as little as need be so that no neighbours are apart; `None` if that can't be done.
    pub(super) fn order(&mut self, now: Time, row: &[BoardKey]) -> Option<Vec<BoardKey>> {
        self.pairs.retain(|_, failed| now.since(*failed) < MEMORY);
        let mut looks = LOOKS_MAX;
        let mut order = Vec::with_capacity(row.len());
        let mut left: BTreeSet<usize> = (0..row.len()).collect();
        self.extend(row, &mut order, &mut left, &mut looks).then_some(order)
    }

    fn extend(&self, row: &[BoardKey], order: &mut Vec<BoardKey>, left: &mut BTreeSet<usize>, looks: &mut u32) -> bool {
        if left.is_empty() {
            return true;
        }
        for next in left.clone() {
            if *looks == 0 {
                return false;
            }
            *looks -= 1;
            if order.last().is_some_and(|last| self.pairs.contains_key(&(*last, row[next]))) {
                continue;
            }
            left.remove(&next);
            order.push(row[next]);
            if self.extend(row, order, left, looks) {
                return true;
            }
            order.pop();
            left.insert(next);
        }
        false
    }

    /// The board that is apart from most others of the row; of several, the one furthest right.
    pub(super) fn worst(&self, row: &[BoardKey]) -> Option<BoardKey> {
        let failures = |key: BoardKey| {
            let others = row
                .iter()
                .filter(|other| self.pairs.contains_key(&(**other, key)) || self.pairs.contains_key(&(key, **other)));
            others.count()
        };
        row.iter().copied().max_by_key(|key| failures(*key))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(keys: &[u64]) -> Vec<BoardKey> {
        keys.iter().map(|key| BoardKey(*key)).collect()
    }

    fn order(row: &[u64], apart: &[(u64, u64)]) -> Option<Vec<BoardKey>> {
        let mut pairs = Apart::default();
        for (left, right) in apart {
            pairs.insert(Time(0), BoardKey(*left), BoardKey(*right));
        }
        pairs.order(Time(1), &keys(row))
    }

    #[test]
    fn two_that_are_apart_are_no_neighbours() {
        assert_eq!(order(&[1, 2, 3, 4], &[(2, 3)]), Some(keys(&[1, 2, 4, 3])));
        assert_eq!(order(&[1, 2], &[(1, 2)]), Some(keys(&[2, 1])), "the other one may be able to connect");
        assert_eq!(order(&[1, 2], &[(1, 2), (2, 1)]), None);
    }

    #[test]
    fn a_full_row_with_a_board_that_nobody_reaches_has_it_at_the_right_end() {
        let row: Vec<u64> = (0..256).collect();
        let apart: Vec<_> = row.iter().filter(|key| **key != 7).map(|key| (7, *key)).collect();
        let order = order(&row, &apart).expect("an order");
        assert_eq!(order.last(), Some(&BoardKey(7)));
    }

    #[test]
    fn who_is_apart_from_most_is_the_worst_and_pairs_are_forgotten_in_time() {
        let mut pairs = Apart::default();
        for (left, right) in [(1, 2), (2, 3), (3, 2), (2, 1), (1, 3)] {
            pairs.insert(Time(0), BoardKey(left), BoardKey(right));
        }
        assert_eq!(pairs.worst(&keys(&[1, 2])), Some(BoardKey(2)), "of two the one that came later");
        assert_eq!(pairs.order(Time(1), &keys(&[1, 2])), None);
        assert!(pairs.order(Time(0) + MEMORY, &keys(&[1, 2])).is_some());
    }
}
