//! The views' lists from frame to frame, and the scripts that bring each board from what it holds to what it needs.
//!
//! A list has a revision that grows when the list changes. A board that holds the revision before gets the changes, one
//! that holds another (it just joined, or a frame for it was dropped) gets the whole list; each is encoded once for
//! all boards.

use proto::ids::SubobjectId;
use proto::list::ListEncoder;
use proto::message::ListBase;

#[derive(Debug, Default)]
struct ViewList {
    current: Vec<SubobjectId>,
    revision: u64,
    /// From the revision before to this one.
    change: Vec<u8>,
    /// From nothing to this one; made when somebody needs it.
    whole: Option<Vec<u8>>,
}

/// See the module's head.
#[derive(Debug, Default)]
pub(crate) struct Lists {
    views: Vec<ViewList>,
    encoder: ListEncoder,
}

impl Lists {
    /// Takes the new list of a view; `list` gets the old one's storage back.
    pub(crate) fn set(&mut self, view: usize, list: &mut Vec<SubobjectId>) {
        if self.views.len() <= view {
            self.views.resize_with(view + 1, ViewList::default);
        }
        let entry = &mut self.views[view];
        if entry.revision > 0 && entry.current == *list {
            return;
        }
        entry.change.clear();
        self.encoder.encode(&entry.current, list, &mut entry.change);
        entry.whole = None;
        entry.revision += 1;
        std::mem::swap(&mut entry.current, list);
    }

    /// The revision of a view's list.
    pub(crate) fn revision(&self, view: usize) -> u64 {
        self.views.get(view).map_or(0, |entry| entry.revision)
    }

    /// A view's list as it is now.
    pub(crate) fn list(&self, view: usize) -> &[SubobjectId] {
        self.views.get(view).map_or(&[], |entry| &entry.current)
    }

    /// What a board that holds revision `held` is sent; appends the script to `out`.
    pub(crate) fn script(&mut self, view: usize, held: Option<u64>, out: &mut Vec<u8>) -> (ListBase, u32) {
        let Self { views, encoder } = self;
        let Some(entry) = views.get_mut(view) else { return (ListBase::Empty, 0) };
        if held == Some(entry.revision) {
            return (ListBase::Same, 0);
        }
        let (base, script) = if entry.revision > 1 && held == Some(entry.revision - 1) {
            (ListBase::Last, &entry.change)
        } else {
            let whole = entry.whole.get_or_insert_with(|| {
                let mut script = Vec::new();
                encoder.encode(&[], &entry.current, &mut script);
                script
            });
            (ListBase::Empty, &*whole)
        };
        out.extend_from_slice(script);
        (base, script.len() as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::list::apply;

    #[test]
    fn a_board_gets_changes_the_whole_list_or_nothing_and_always_ends_with_the_list() {
        let mut lists = Lists::default();
        let frames: [&[u32]; 5] = [&[1, 2, 3], &[1, 2, 3], &[3, 2], &[], &[9, 8, 7]];
        let mut held = (None, Vec::new());
        let mut bases = Vec::new();
        for (i, frame) in frames.iter().enumerate() {
            let want: Vec<_> = frame.iter().map(|id| SubobjectId(*id)).collect();
            lists.set(0, &mut want.clone());
            if i == 3 {
                continue; // this frame's message to the board is lost
            }
            let mut script = Vec::new();
            let (base, _) = lists.script(0, held.0, &mut script);
            bases.push(base);
            let mut new = Vec::new();
            match base {
                ListBase::Same => new.clone_from(&held.1),
                ListBase::Last => apply(&held.1, &script, 100, &mut new).unwrap(),
                ListBase::Empty => apply(&[], &script, 100, &mut new).unwrap(),
            }
            assert_eq!(new, want);
            held = (Some(lists.revision(0)), new);
        }
        assert_eq!(bases, [ListBase::Empty, ListBase::Same, ListBase::Last, ListBase::Empty]);
    }
}
