//! What a board follows from frame to frame: the views, their lists, what has moved, and how models are mixed. Frames bring only
//! what has changed, so every frame is followed, drawn or not.

use glam::DAffine3;
use proto::codec::within;
use proto::frame::{Moved, VersionWeights};
use proto::ids::{ModelId, ObjectId, SubobjectId, ViewId};
use proto::limits;
use proto::list::apply;
use proto::message::{Changes, FrameHeader, FramePayload, ListBase};
use proto::view::ViewSetup;
use std::collections::BTreeMap;

/// See the module's head.
#[derive(Debug, Default)]
pub(super) struct Followed {
    pub(super) views: Vec<ViewSetup>,
    lists: BTreeMap<ViewId, Vec<SubobjectId>>,
    moved: BTreeMap<ObjectId, DAffine3>,
    weights: BTreeMap<ModelId, Vec<f32>>,
    revision: u64,
}

impl Followed {
    /// A number that is another one whenever lists, moved objects or weights are.
    pub(super) fn revision(&self) -> u64 {
        self.revision
    }

    /// A view's list; empty for a view that isn't drawn here.
    pub(super) fn list(&self, view: ViewId) -> &[SubobjectId] {
        self.lists.get(&view).map_or(&[], Vec::as_slice)
    }

    /// The objects that are elsewhere than the table says.
    pub(super) fn moved(&self) -> Vec<Moved> {
        self.moved.iter().map(|(object, transform)| Moved { object: *object, transform: *transform }).collect()
    }

    /// The models that don't show their finest version alone.
    pub(super) fn weights(&self) -> Vec<VersionWeights> {
        self.weights.iter().map(|(model, weights)| VersionWeights { model: *model, weights: weights.clone() }).collect()
    }

    /// Forgets everything: it was another session's.
    pub(super) fn clear(&mut self) {
        *self = Self { revision: self.revision + 1, ..Self::default() };
    }

    /// Follows a frame. `subobjects` is how many the table has, `home` where it has an object.
    ///
    /// # Errors
    /// When the payload is malformed, or changes what was never sent, or more is moved or mixed than a frame may name.
    pub(super) fn take(
        &mut self,
        header: &FrameHeader,
        payload: &[u8],
        subobjects: usize,
        home: impl Fn(ObjectId) -> Option<DAffine3>,
    ) -> Result<(), String> {
        let content = FramePayload::decode(header, payload).map_err(|error| error.to_string())?;
        if let Some(views) = &header.views {
            self.views.clone_from(views);
        }
        let mut scripts = &content.scripts[..];
        let mut kept = BTreeMap::new();
        for update in &header.lists {
            // `FramePayload::decode` has checked the sum.
            let (script, rest) = scripts.split_at(update.script_bytes as usize);
            scripts = rest;
            let last = self.lists.remove(&update.view);
            let mut changed = |last: &[SubobjectId]| {
                let mut list = Vec::new();
                self.revision += 1;
                apply(last, script, subobjects, &mut list).map(|()| list).map_err(|error| error.to_string())
            };
            let list = match (update.base, last) {
                (ListBase::Same, Some(last)) => last,
                (ListBase::Last, Some(last)) => changed(&last)?,
                (ListBase::Empty, _) => changed(&[])?,
                (ListBase::Same | ListBase::Last, None) => return Err("changes to a list that was never sent".into()),
            };
            kept.insert(update.view, list);
        }
        self.lists = kept;
        let elsewhere = |moved: Moved| Some(moved.transform).filter(|transform| home(moved.object) != Some(*transform));
        let moved = content.moved.into_iter().map(|moved| (moved.object, elsewhere(moved)));
        self.revision += lay_over(&mut self.moved, header.moved, moved);
        let weights = content.weights.into_iter().map(|row| (row.model, Some(row.weights).filter(|w| !w.is_empty())));
        self.revision += lay_over(&mut self.weights, header.weights, weights);
        let bounded = within("moved objects", self.moved.len() as u64, limits::MOVED_MAX)
            .and_then(|_| within("models with weights", self.weights.len() as u64, limits::MODELS_MAX));
        bounded.map(|_| ()).map_err(|error| error.to_string())
    }
}

/// Lays entries over what was last, or over nothing; `None` takes an entry away. Returns 1 if that may have changed anything, else 0.
fn lay_over<K: Ord, V>(
    held: &mut BTreeMap<K, V>,
    changes: Changes,
    entries: impl Iterator<Item = (K, Option<V>)>,
) -> u64 {
    match changes.base {
        ListBase::Same => return 0,
        ListBase::Empty => held.clear(),
        ListBase::Last => {}
    }
    for (key, value) in entries {
        match value {
            Some(value) => drop(held.insert(key, value)),
            None => drop(held.remove(&key)),
        }
    }
    1
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proto::debug::DebugPicture;
    use proto::frame::{Environment, FrameState, PixelFormat};
    use proto::ids::{Epoch, FrameNumber};
    use proto::list::ListEncoder;
    use proto::message::ListUpdate;
    use proto::view::Pose;

    fn frame(
        lists: Vec<ListUpdate>,
        payload: &FramePayload,
        moved: ListBase,
        weights: ListBase,
    ) -> (FrameHeader, Vec<u8>) {
        let state = FrameState {
            frame: FrameNumber(1),
            epoch: Epoch(1),
            eye: Pose::IDENTITY,
            environment: Environment::default(),
            debug: DebugPicture::Off,
        };
        let moved = Changes { base: moved, count: payload.moved.len() as u32 };
        let weights = Changes { base: weights, count: payload.weights.len() as u32 };
        let header = FrameHeader { state, views: None, format: PixelFormat::Srgb8, lists, moved, weights };
        (header, payload.encode())
    }

    /// All objects are at home at the origin.
    fn home(object: ObjectId) -> Option<DAffine3> {
        (object.0 < 10).then_some(DAffine3::IDENTITY)
    }

    fn at(object: u32, x: f64) -> Moved {
        Moved { object: ObjectId(object), transform: DAffine3::from_translation(DVec3::X * x) }
    }

    fn mixed(model: u32, weights: &[f32]) -> VersionWeights {
        VersionWeights { model: ModelId(model), weights: weights.to_vec() }
    }

    #[test]
    fn only_changes_travel_and_what_is_not_named_stays() {
        let mut followed = Followed::default();
        let mut take = |payload: FramePayload, moved, weights| {
            let (header, bytes) = frame(Vec::new(), &payload, moved, weights);
            let before = followed.revision();
            followed.take(&header, &bytes, 10, home).unwrap();
            (followed.moved(), followed.weights(), followed.revision() != before)
        };
        let payload = |moved: &[Moved], weights: &[VersionWeights]| FramePayload {
            moved: moved.to_vec(),
            weights: weights.to_vec(),
            scripts: Vec::new(),
        };
        let half = mixed(1, &[0.5, 0.5]);
        let first = take(payload(&[at(3, 1.0)], std::slice::from_ref(&half)), ListBase::Empty, ListBase::Empty);
        assert_eq!(first, (vec![at(3, 1.0)], vec![half.clone()], true));
        let still = take(payload(&[], &[]), ListBase::Same, ListBase::Same);
        assert_eq!(still, (vec![at(3, 1.0)], vec![half.clone()], false));
        let quarter = mixed(4, &[0.25]);
        let more = take(payload(&[at(2, 5.0)], std::slice::from_ref(&quarter)), ListBase::Last, ListBase::Last);
        assert_eq!(more, (vec![at(2, 5.0), at(3, 1.0)], vec![half, quarter.clone()], true));
        let finest = take(payload(&[at(3, 0.0)], &[mixed(1, &[])]), ListBase::Last, ListBase::Last);
        assert_eq!(finest, (vec![at(2, 5.0)], vec![quarter], true), "home again, and the finest alone");
        let anew = take(payload(&[], &[]), ListBase::Empty, ListBase::Empty);
        assert_eq!(anew, (vec![], vec![], true));
    }

    #[test]
    fn changes_to_a_list_that_was_never_sent_are_refused() {
        let mut followed = Followed::default();
        let mut script = Vec::new();
        ListEncoder::default().encode(&[], &[SubobjectId(3)], &mut script);
        let payload = FramePayload { scripts: script.clone(), ..FramePayload::default() };
        let update = |base| ListUpdate { view: ViewId(0), base, script_bytes: script.len() as u32 };
        let mut take = |base| {
            let (header, bytes) = frame(vec![update(base)], &payload, ListBase::Same, ListBase::Same);
            followed.take(&header, &bytes, 10, home).map(|()| followed.list(ViewId(0)).to_vec())
        };
        assert!(take(ListBase::Last).is_err() && take(ListBase::Same).is_err());
        assert_eq!(take(ListBase::Empty), Ok(vec![SubobjectId(3)]));
        let (header, bytes) = frame(vec![update(ListBase::Empty)], &payload, ListBase::Same, ListBase::Same);
        assert!(followed.take(&header, &bytes, 3, home).is_err(), "an id beyond the table");
    }
}
