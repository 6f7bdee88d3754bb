//! Whether a flight in which boards are killed, stopped, cut off and added shows what an undisturbed one does.
//!
//! Two manifests are compared (`compositor --manifest`): one of a flight in lock-step with every pose of the path, and one of a flight in real time
//! along the same path. A line of the second may show any pose of the path; its views must have the tiles that the first has for that pose, or
//! repeat what they showed before, as wholes.

use crate::{Figure, at_most};
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;
use std::io::BufRead;

/// Why manifests can't be compared.
#[derive(Debug)]
pub struct ManifestError(String);

impl fmt::Display for ManifestError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for ManifestError {}

/// What was compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Compared {
    /// Frames shown.
    pub frames: u64,
    /// Views that were new, and as they should be.
    pub right: u64,
    /// Views that repeated what they had shown.
    pub repeated: u64,
    /// Views that were neither.
    pub wrong: u64,
    /// Frames of a pose, or of a mixture of models, that the undisturbed flight doesn't have.
    pub unknown: u64,
    /// Frames whose number isn't above that of the one before.
    pub backwards: u64,
}

/// The undisturbed flight: by what a frame depends on, the tiles of its views.
#[derive(Debug, Default)]
pub struct Undisturbed {
    frames: BTreeMap<String, Vec<Value>>,
}

/// A line of a manifest.
struct Line {
    frame: u64,
    /// What the picture depends on.
    depends: String,
    views: Vec<ViewLine>,
}

struct ViewLine {
    complete: bool,
    tiles: Value,
}

impl Line {
    fn read(text: &str) -> Result<Self, ManifestError> {
        let wrong = |what: &str| ManifestError(format!("{what} in the manifest's line {text:.80}"));
        let value: Value = serde_json::from_str(text).map_err(|error| wrong(&error.to_string()))?;
        let frame = value["frame"].as_u64().ok_or_else(|| wrong("no frame number"))?;
        if value["eye"].is_null() {
            return Err(wrong("no eyepoint"));
        }
        let depends = format!("{} {} {}", value["eye"], value["environment"], value["weights"]);
        let views = value["views"].as_array().ok_or_else(|| wrong("no views"))?.iter().map(|view| {
            let complete =
                view["complete"].as_bool().ok_or_else(|| wrong("a view that isn't said to be new or not"))?;
            Ok(ViewLine { complete, tiles: view["tiles"].clone() })
        });
        Ok(Self { frame, depends, views: views.collect::<Result<_, _>>()? })
    }
}

fn lines(manifest: impl BufRead) -> impl Iterator<Item = Result<String, ManifestError>> {
    manifest.lines().map(|text| text.map_err(|error| ManifestError(error.to_string())))
}

impl Undisturbed {
    /// Reads its manifest.
    ///
    /// # Errors
    /// When that is none, or a view is not whole.
    pub fn read(manifest: impl BufRead) -> Result<Self, ManifestError> {
        let mut frames = BTreeMap::new();
        for text in lines(manifest) {
            let Line { frame, depends, views } = Line::read(&text?)?;
            if views.iter().any(|view| !view.complete) {
                return Err(ManifestError(format!("frame {frame} of the undisturbed flight is not whole")));
            }
            frames.insert(depends, views.into_iter().map(|view| view.tiles).collect());
        }
        Ok(Self { frames })
    }

    /// How many different frames it has.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Compares a flight with it.
    ///
    /// # Errors
    /// When its manifest is none.
    pub fn compare(&self, manifest: impl BufRead) -> Result<Compared, ManifestError> {
        let mut compared = Compared::default();
        let mut before: Option<(u64, Vec<Value>)> = None;
        for text in lines(manifest) {
            let Line { frame, depends, views } = Line::read(&text?)?;
            compared.frames += 1;
            compared.backwards += u64::from(before.as_ref().is_some_and(|(number, _)| *number >= frame));
            let expected = self.frames.get(&depends);
            compared.unknown += u64::from(expected.is_none());
            for (k, ViewLine { complete, tiles }) in views.iter().enumerate() {
                let shown = before.as_ref().and_then(|(_, shown)| shown.get(k));
                let wanted = if *complete { expected.and_then(|tiles| tiles.get(k)) } else { shown };
                match wanted {
                    Some(wanted) if wanted != tiles => compared.wrong += 1,
                    Some(_) if *complete => compared.right += 1,
                    Some(_) => compared.repeated += 1,
                    // Unknown as a frame, or a view that was never whole: nothing was shown there.
                    None => {}
                }
            }
            before = Some((frame, views.into_iter().map(|view| view.tiles).collect()));
        }
        Ok(compared)
    }
}

/// A disturbed flight.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// How long it took, s.
    pub seconds: f64,
    /// Frames swapped, those that were passed over included.
    pub swapped: u64,
    /// What was done, and how often.
    pub deeds: Vec<(String, usize)>,
    /// What was shown.
    #[serde(flatten)]
    pub compared: Compared,
    /// Frames in which something was left out or shown in another version, since a board didn't hold it yet.
    pub substituted: u64,
    /// Boards that were lost or put out without having been touched.
    pub expelled: u64,
    /// Processes of the rig at its end, and how many there should be.
    pub processes: [usize; 2],
    /// Open files of the manager, before and after.
    pub files: [usize; 2],
    /// Resident memory of the manager, before and after, MiB.
    pub memory_mib: [f64; 2],
}

/// The row as text.
pub fn table(row: &Row) -> String {
    let Compared { frames, right, repeated, wrong, unknown, backwards } = row.compared;
    let deeds: Vec<_> = row.deeds.iter().map(|(deed, count)| format!("{count} {deed}")).collect();
    let ([processes, wanted], [files, files_after], [memory, memory_after]) =
        (row.processes, row.files, row.memory_mib);
    format!(
        "{:.0} s, boards: {}\n{} frames swapped, {frames} shown: {right} views as undisturbed, {repeated} repeated whole, {wrong} wrong\n\
         {unknown} frames of other poses, {backwards} out of order, {} with something left out, {} boards lost or put out untouched\n\
         processes at the end {processes} of {wanted}; manager's open files {files} -> {files_after}, memory {memory:.1} -> {memory_after:.1} MiB\n",
        row.seconds,
        deeds.join(", "),
        row.swapped,
        row.substituted,
        row.expelled,
    )
}

/// What must hold of it.
pub fn figures(row: &Row) -> Vec<Figure> {
    let Compared { right, wrong, unknown, backwards, .. } = row.compared;
    let seen = |value: u64| if right > 0 { Ok(value as f64) } else { Err("no view was compared".to_owned()) };
    let leaked = row.processes[0].abs_diff(row.processes[1]);
    vec![
        at_most("chain.flight_wrong_views", "", "0", 0.0, seen(wrong + unknown + backwards)),
        at_most("chain.flight_leaked_processes", "", "0", 0.0, Ok(leaked as f64)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u64, eye: u32, views: [(bool, &str); 2]) -> String {
        let view = |(complete, tile): (bool, &str)| format!(r#"{{"complete":{complete},"tiles":["{tile}"]}}"#);
        let [a, b] = views.map(view);
        format!("{{\"frame\":{number},\"eye\":{eye},\"environment\":1,\"weights\":[],\"views\":[{a},{b}]}}\n")
    }

    fn whole(number: u64, eye: u32) -> String {
        frame(number, eye, [(true, &format!("a{eye}")), (true, &format!("b{eye}"))])
    }

    #[test]
    fn poses_may_come_in_any_order_and_views_may_repeat_but_only_as_wholes() {
        let undisturbed = Undisturbed::read((whole(0, 7) + &whole(1, 8)).as_bytes()).unwrap();
        assert_eq!(undisturbed.len(), 2);
        let compare = |text: String| undisturbed.compare(text.as_bytes()).unwrap();
        let good = whole(5, 8) + &frame(6, 7, [(true, "a7"), (false, "b8")]) + &whole(9, 7);
        let expected = Compared { frames: 3, right: 5, repeated: 1, ..Compared::default() };
        assert_eq!(compare(good), expected);
        let torn = whole(5, 8) + &frame(6, 7, [(true, "a7"), (false, "b7")]);
        assert_eq!(compare(torn).wrong, 1, "what repeats has changed");
        assert_eq!(compare(frame(5, 8, [(true, "a8"), (true, "b7")])).wrong, 1, "a part of another frame");
        assert_eq!(compare(whole(5, 9)).unknown, 1);
        assert_eq!(compare(whole(5, 8) + &whole(5, 8)).backwards, 1);
    }

    #[test]
    fn what_is_no_manifest_is_refused() {
        for text in ["nothing\n", "{}\n", r#"{"frame":1,"views":[]}"#, r#"{"frame":1,"eye":1,"views":[{"tiles":[]}]}"#]
        {
            assert!(Undisturbed::read(text.as_bytes()).is_err(), "{text}");
        }
        let repeated = frame(1, 1, [(true, "a"), (false, "b")]);
        assert!(Undisturbed::read(repeated.as_bytes()).is_err());
    }
}
