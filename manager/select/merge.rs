//! Merges sorted lists of subobjects: the paper's merge (seed 000, section 4: "QS"), over k lists with a heap.
//!
//! Here the lists are what each processor sorted, and the moved objects' subobjects, of which there are few: so a list is copied as far as it
//! is first, in one go, and the heap is asked only when another one's turn comes.

use super::sort::{Entry, id, step};
use proto::ids::SubobjectId;
use std::cmp::Ordering;

/// Working memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    /// Numbers of the lists that aren't through, as a heap by their heads: the first is the least, and k is no greater than 2k + 1 and 2k + 2.
    heap: Vec<usize>,
    at: Vec<usize>,
}

/// Appends to `out` the ids of all `lists`, each sorted by power, then id, in that order. `power` gives the ordered bits of an id's power, and is asked
/// only where steps are equal: it may have to search.
pub(super) fn merge(
    lists: &[&[Entry]],
    Scratch { heap, at }: &mut Scratch,
    power: impl Fn(u32) -> u64,
    out: &mut Vec<SubobjectId>,
) {
    out.reserve(lists.iter().map(|list| list.len()).sum());
    let exact = |entry: Entry| (power(id(entry).0), id(entry).0);
    let compare = |a: Entry, b: Entry| step(a).cmp(&step(b)).then_with(|| exact(a).cmp(&exact(b)));
    at.clear();
    at.resize(lists.len(), 0);
    heap.clear();
    heap.extend((0..lists.len()).filter(|&list| !lists[list].is_empty()));
    for top in (0..heap.len() / 2).rev() {
        sift(heap, top, |a, b| compare(lists[a][at[a]], lists[b][at[b]]));
    }
    while let Some(&least) = heap.first() {
        let own = &lists[least][at[least]..];
        // The next list is below the first, on the left or on the right.
        let next = match heap[1..] {
            [] => None,
            [only] => Some(only),
            [a, b, ..] => Some(if compare(lists[a][at[a]], lists[b][at[b]]) == Ordering::Greater { b } else { a }),
        };
        let taken = match next.map(|next| lists[next][at[next]]) {
            None => own.len(),
            // The head is before all others.
            Some(other) => 1 + own[1..].iter().take_while(|&&entry| compare(entry, other) == Ordering::Less).count(),
        };
        out.extend(own[..taken].iter().map(|&entry| id(entry)));
        at[least] += taken;
        if at[least] == lists[least].len() {
            heap.swap_remove(0);
        }
        sift(heap, 0, |a, b| compare(lists[a][at[a]], lists[b][at[b]]));
    }
}

/// Lets the list at `top` sink to where those below it are no less.
fn sift(heap: &mut [usize], mut top: usize, compare: impl Fn(usize, usize) -> Ordering) {
    loop {
        let below = [2 * top + 1, 2 * top + 2].into_iter().filter(|&below| below < heap.len());
        let Some(least) = below.min_by(|&a, &b| compare(heap[a], heap[b])) else { return };
        if compare(heap[least], heap[top]) != Ordering::Less {
            return;
        }
        heap.swap(least, top);
        top = least;
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
