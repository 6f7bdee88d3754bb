//! Models in transition: one picture for each choice of versions.
//!
//! The design book's formula for a model's versions is a mean: what is seen if each model shows one of its versions, or none, with its
//! weight as its probability, independently of the other models. So a pixel with a few versions is the weighted mean of a few
//! pixels without, each of which has the short ways open to it. Merged models don't split that way: of their layers only
//! the nearest counts, which no set of ordinary faces says.

use super::ExactFace;
use super::prepare::Faces;
use crate::room::room;

/// With more choices of versions than this a pixel is cut into cells, once. The cells of two meshes laid over each other take
/// as long as some twenty pixels of one (7.1 µs against 0.3 µs for fans of four, AMD EPYC).
const CHOICES_MAX: usize = 16;

/// A version of a model that has faces in the pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Version {
    model: u32,
    version: usize,
    weight: f64,
}

/// The versions of one model.
#[derive(Clone, Copy, Debug)]
struct Group {
    /// Where its versions begin, and where they end.
    first: usize,
    end: usize,
    /// The version shown; `end` is none of them.
    shown: usize,
    /// The weight of showing none.
    rest: f64,
}

/// The versions in a pixel, and which of them are shown.
#[derive(Debug, Default)]
pub(super) struct Versions {
    versions: Vec<Version>,
    groups: Vec<Group>,
}

room!(Versions: versions, groups;);

impl Versions {
    /// Finds the versions of the faces that reach the pixel. Returns false if it is no case for this.
    pub(super) fn set(&mut self, faces: &[ExactFace<'_>], order: &Faces) -> bool {
        self.versions.clear();
        self.groups.clear();
        for k in 0..order.len() {
            let Some(part) = &faces[order.at(k).face].part else { continue };
            let member = &part.member;
            if member.merged {
                return false;
            }
            let (model, version) = (member.model, member.version);
            if let Err(at) = self.versions.binary_search_by_key(&(model, version), |v| (v.model, v.version)) {
                self.versions.insert(at, Version { model, version, weight: member.weights[version] });
            }
        }
        let mut choices = 1;
        let mut first = 0;
        for group in self.versions.chunk_by(|a, b| a.model == b.model) {
            let end = first + group.len();
            let held: f64 = group.iter().map(|version| version.weight).sum();
            self.groups.push(Group { first, end, shown: first, rest: (1.0 - held).max(0.0) });
            choices *= group.len() + 1;
            if choices > CHOICES_MAX {
                return false;
            }
            first = end;
        }
        true
    }

    /// How much the pixel with what is shown counts.
    pub(super) fn weight(&self) -> f64 {
        let weight =
            |group: &Group| if group.shown == group.end { group.rest } else { self.versions[group.shown].weight };
        self.groups.iter().map(weight).product()
    }

    /// Shows the next choice. Returns false if there is none.
    pub(super) fn advance(&mut self) -> bool {
        for group in &mut self.groups {
            if group.shown < group.end {
                group.shown += 1;
                return true;
            }
            group.shown = group.first;
        }
        false
    }

    /// Whether a face is shown.
    pub(super) fn shows(&self, face: &ExactFace<'_>) -> bool {
        face.part.as_ref().is_none_or(|part| {
            let is_shown = |group: &Group| {
                self.versions[group.first..group.end]
                    .get(group.shown - group.first)
                    .is_some_and(|v| (v.model, v.version) == (part.member.model, part.member.version))
            };
            self.groups.iter().any(is_shown)
        })
    }
}
