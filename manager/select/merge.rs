//! Merges sorted lists of subobjects: the paper's merge (seed 000, section 4: "QS"), over k lists with a heap.
//!
//! Here the lists are what each processor sorted, and the moved objects' subobjects, of which there are few: so a list is copied as far as it
//! is first, in one go, and the heap is asked only when another one's turn comes.

use super::sort::{Entry, id, step};
use proto::ids::SubobjectId;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// The head of a list, and which list.
type Head = Reverse<(u32, u64, u32, u32)>;

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    heads: BinaryHeap<Head>,
    at: Vec<usize>,
}

/// Appends to `out` the ids of all `lists`, each sorted by power, then id, in that order. `power` gives the ordered bits of an id's power, and is asked
/// only where steps are equal.
pub(super) fn merge(lists: &[&[Entry]], scratch: &mut Scratch, power: impl Fn(u32) -> u64, out: &mut Vec<SubobjectId>) {
    out.reserve(lists.iter().map(|list| list.len()).sum());
    let Scratch { heads, at } = scratch;
    heads.clear();
    at.clear();
    at.resize(lists.len(), 0);
    if let [only] = lists {
        return out.extend(only.iter().map(|&entry| id(entry)));
    }
    // Powers are compared only where steps are equal; asking for that of every head costs little, for heads are few.
    let head = |list: usize, at: usize| {
        let entry = *lists[list].get(at)?;
        Some(Reverse((step(entry), power(id(entry).0), id(entry).0, list as u32)))
    };
    heads.extend((0..lists.len()).filter_map(|list| head(list, 0)));
    while let Some(Reverse((.., list))) = heads.pop() {
        let (own, start) = (lists[list as usize], at[list as usize]);
        let Some(&Reverse((next_step, next_power, next_id, _))) = heads.peek() else {
            out.extend(own[start..].iter().map(|&entry| id(entry)));
            return;
        };
        let is_before = |entry: Entry| match step(entry).cmp(&next_step) {
            std::cmp::Ordering::Less => true,
            std::cmp::Ordering::Greater => false,
            std::cmp::Ordering::Equal => (power(id(entry).0), id(entry).0) < (next_power, next_id),
        };
        // The first is before all others.
        let mut end = start + 1;
        while end < own.len() && is_before(own[end]) {
            end += 1;
        }
        out.extend(own[start..end].iter().map(|&entry| id(entry)));
        at[list as usize] = end;
        heads.extend(head(list as usize, end));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::select::sort::{Steps, entry, ordered};
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]
        #[test]
        fn merging_equals_sorting(powers in prop::collection::vec((0usize..5, 0.0..100.0f64), 0..300), coarse in any::<bool>()) {
            // Coarse steps are shared by many, so that powers decide.
            let steps = Steps::over(0.0, if coarse { 1e11 } else { 100.0 });
            let power = |id: u32| ordered(powers[id as usize].1);
            let mut lists = vec![Vec::new(); 5];
            let mut all: Vec<u32> = (0..powers.len() as u32).collect();
            all.sort_by_key(|&id| (power(id), id));
            for &id in &all {
                let (list, value) = powers[id as usize];
                lists[list].push(entry(steps.of(value), id));
            }
            let lists: Vec<&[Entry]> = lists.iter().map(Vec::as_slice).collect();
            let mut out = Vec::new();
            merge(&lists, &mut Scratch::default(), power, &mut out);
            prop_assert_eq!(out.into_iter().map(|id| id.0).collect::<Vec<_>>(), all);
        }
    }
}
