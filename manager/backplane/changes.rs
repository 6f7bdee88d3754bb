//! Sets of named things (moved objects, weights of models) from frame to frame, as changes: a board that holds the revision
//! before gets what has changed since, one that holds another gets the whole set.

use proto::message::{Changes, ListBase};

/// See the module's head. `T` has a name by which entries are ordered.
#[derive(Clone, Debug)]
pub(crate) struct Book<T> {
    current: Vec<T>,
    revision: u64,
    /// From the revision before to this one.
    change: Vec<T>,
}

impl<T> Default for Book<T> {
    fn default() -> Self {
        Self { current: Vec::new(), revision: 0, change: Vec::new() }
    }
}

impl<T: Clone + PartialEq> Book<T> {
    /// Takes the new set, ascending by `name`; `new` gets the old one's storage back. `gone` is what says of an entry that it is
    /// as if it had never been named.
    pub(crate) fn set<N: Ord>(&mut self, new: &mut Vec<T>, name: impl Fn(&T) -> N, gone: impl Fn(&T) -> T) {
        if self.revision > 0 && self.current == *new {
            return;
        }
        self.change.clear();
        let mut old = self.current.iter().peekable();
        for entry in new.iter() {
            while let Some(left) = old.next_if(|old| name(old) < name(entry)) {
                self.change.push(gone(left));
            }
            let before = old.next_if(|old| name(old) == name(entry));
            if before != Some(entry) {
                self.change.push(entry.clone());
            }
        }
        self.change.extend(old.map(gone));
        self.revision += 1;
        std::mem::swap(&mut self.current, new);
    }

    /// Grows when the set changes.
    pub(crate) fn revision(&self) -> u64 {
        self.revision
    }

    /// What a board that holds revision `held` is sent.
    pub(crate) fn since(&self, held: Option<u64>) -> (Changes, &[T]) {
        let (base, entries) = match held {
            Some(held) if held == self.revision => (ListBase::Same, &[][..]),
            Some(held) if self.revision > 1 && held == self.revision - 1 => (ListBase::Last, &self.change[..]),
            _ => (ListBase::Empty, &self.current[..]),
        };
        (Changes { base, count: entries.len() as u32 }, entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    proptest! {
        /// A board that misses some frames ends with the set all the same, and one that misses none is told only what has changed.
        #[test]
        fn a_board_always_ends_with_the_set(
            frames in prop::collection::vec((prop::collection::btree_map(0u8..6, 1i8..3, 0..6), any::<bool>()), 1..12),
        ) {
            let mut book = Book::default();
            let mut held: (Option<u64>, BTreeMap<u8, i8>) = (None, BTreeMap::new());
            for (set, is_sent) in frames {
                let mut new: Vec<(u8, i8)> = set.clone().into_iter().collect();
                book.set(&mut new, |entry| entry.0, |entry| (entry.0, 0));
                if !is_sent {
                    continue;
                }
                let (changes, entries) = book.since(held.0);
                prop_assert_eq!(changes.count as usize, entries.len());
                if changes.base == ListBase::Empty {
                    held.1.clear();
                }
                for (name, value) in entries {
                    if changes.base == ListBase::Last {
                        prop_assert_ne!(held.1.get(name).copied().unwrap_or(0), *value, "only what has changed");
                    }
                    if *value == 0 { held.1.remove(name); } else { held.1.insert(*name, *value); }
                }
                held.0 = Some(book.revision());
                prop_assert_eq!(&held.1, &set);
            }
        }
    }
}
