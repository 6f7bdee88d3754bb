//! Scene extras of the file: `extras.cyclorama`, and `extras.layer` alone.
//!
//! They are written by hand, so whatever is not understood is said, with the place, and left out: a misspelt key must
//! not pass in silence, nor should it keep a scene from being seen.

use super::Warnings;
use crate::scene::Extras;
use gltf::json::extras::Extras as Raw;
use serde_json::{Map, Value};

/// What the extras stand at; decides which keys make sense.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    Node,
    Mesh,
    /// A primitive or material: parts of a mesh.
    Part,
}

/// Largest entity number: f64, in which JSON tools hold numbers, has all integers up to here.
const ENTITY_MAX: u64 = 1 << 53;

/// Reads what `raw` says; `place` is for warnings.
pub(super) fn read(raw: &Raw, at: At, place: &dyn Fn() -> String, warnings: &mut Warnings) -> Extras {
    let mut found = Extras::default();
    let Some(raw) = raw.as_ref().filter(|raw| raw.get().contains("cyclorama") || raw.get().contains("layer")) else {
        return found;
    };
    let Ok(Value::Object(all)) = serde_json::from_str::<Value>(raw.get()) else { return found };
    if let Some(layer) = all.get("layer") {
        // Someone else's "layer" may be anything, such as a name.
        found.layer = integer(layer).and_then(|number| i32::try_from(number).ok());
    }
    match all.get("cyclorama") {
        None => {}
        Some(Value::Object(ours)) => Reader { ours, at, place, warnings }.read(&mut found),
        Some(_) => warnings.add(format!("{}: extras.cyclorama is no object and is ignored", place())),
    }
    found
}

struct Reader<'a> {
    ours: &'a Map<String, Value>,
    at: At,
    place: &'a dyn Fn() -> String,
    warnings: &'a mut Warnings,
}

impl Reader<'_> {
    fn read(&mut self, found: &mut Extras) {
        let ours = self.ours;
        for (key, value) in ours {
            let misplaced = match (key.as_str(), self.at) {
                ("levels" | "entity", At::Mesh | At::Part) => Some("a node"),
                ("surface" | "critical_radius" | "cue" | "static", At::Part) => Some("a node or mesh"),
                _ => None,
            };
            if let Some(right) = misplaced {
                self.say(key, &format!("means nothing here, only at {right}, and is ignored"));
                continue;
            }
            match key.as_str() {
                "layer" => {
                    let layer = integer(value).and_then(|number| i32::try_from(number).ok());
                    found.layer = self.expect(key, layer, "an integer of 32 bits").or(found.layer);
                }
                "merged" => found.merged = self.expect(key, value.as_bool(), "true or false"),
                "surface" => found.surface = self.expect(key, value.as_bool(), "true or false"),
                "cue" => found.cue = self.expect(key, value.as_bool(), "true or false"),
                "static" => found.is_static = self.expect(key, value.as_bool(), "true or false"),
                "critical_radius" => {
                    let radius = value.as_f64().filter(|radius| *radius > 0.0 && radius.is_finite());
                    found.critical_radius = self.expect(key, radius, "a length in metres above 0");
                }
                "entity" => {
                    let number = integer(value).and_then(|number| u64::try_from(number).ok());
                    let number = number.filter(|number| *number <= ENTITY_MAX);
                    found.entity = self.expect(key, number, "a whole number from 0 to 2⁵³");
                }
                "levels" => {
                    let name = |value: &Value| value.as_str().map(str::to_owned);
                    let names = value.as_array().and_then(|all| all.iter().map(name).collect());
                    found.levels = self.expect(key, names, "a list of names of nodes");
                }
                _ => self.say(key, "is not known and is ignored"),
            }
        }
    }

    fn expect<T>(&mut self, key: &str, value: Option<T>, what: &str) -> Option<T> {
        if value.is_none() {
            self.say(key, &format!("must be {what} and is ignored"));
        }
        value
    }

    fn say(&mut self, key: &str, what: &str) {
        let key: String = key.chars().take(40).collect();
        self.warnings.add(format!("{}: extras.cyclorama.{key} {what}", (self.place)()));
    }
}

/// An integer, also one that is written `2.0`.
fn integer(value: &Value) -> Option<i64> {
    let exact = |number: f64| {
        let whole = number as i64;
        (whole as f64 == number && whole.unsigned_abs() <= ENTITY_MAX).then_some(whole)
    };
    value.as_i64().or_else(|| value.as_f64().and_then(exact))
}
