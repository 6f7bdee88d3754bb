//! What the host flies, and what must be seen of it: the manifest of a rig of plain processes, in lock-step and with one board.

use crate::engine::run;
use serde_json::Value;
use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Small, so that two cores draw it with five boards beside all else.
pub(crate) const SIZE: &str = "160x90";
pub(crate) const VIEWS: u32 = 2;
pub(crate) const SAMPLES: &str = "4";
/// Frames and poses a second.
pub(crate) const RATE: u32 = 20;
/// Every so manyth pose of the built-in flight.
const STEP: usize = 5;
/// Fewer frames of known poses would prove little.
const COMPARED_MIN: usize = 100;

/// A folder that containers see.
pub(crate) struct Flight {
    folder: tempfile::TempDir,
}

/// What each pose's frame shows: tiles by view, or nothing where a view was repeated.
pub(crate) type Shown = Vec<(String, Vec<Option<Value>>)>;

impl Flight {
    /// The built-in flight, in larger steps.
    pub(crate) fn write() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let flight = Self { folder };
        let scene = flight.folder.path().join("airport.glb");
        run(cyclorama().args(["scene", "airport", "-o"]).arg(&scene));
        let poses: Vec<Value> =
            serde_json::from_str(&std::fs::read_to_string(scene.with_extension("path.json")).unwrap()).unwrap();
        let mut chosen: Vec<Value> = poses.into_iter().step_by(STEP).collect();
        for (k, pose) in chosen.iter_mut().enumerate() {
            pose["t"] = (k as f64 / f64::from(RATE)).into();
        }
        std::fs::write(flight.camera(), serde_json::to_string(&chosen).unwrap()).unwrap();
        std::fs::create_dir(flight.out()).unwrap();
        // Containers are somebody else here, and write into `out`.
        std::fs::set_permissions(flight.folder(), PermissionsExt::from_mode(0o755)).unwrap();
        std::fs::set_permissions(flight.out(), PermissionsExt::from_mode(0o777)).unwrap();
        flight
    }

    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn out(&self) -> PathBuf {
        self.folder().join("out")
    }

    fn camera(&self) -> PathBuf {
        self.folder().join("flight.json")
    }

    /// What the composed rig has shown.
    pub(crate) fn shown(&self) -> Shown {
        lines(&self.out().join("manifest.jsonl"))
    }

    /// Each view of a frame that was shown must be what plain processes show of that pose.
    pub(crate) fn compare(&self, shown: &Shown) {
        let manifest = self.folder().join("expected.jsonl");
        let views = VIEWS.to_string();
        let row = ["--views", &views, "--boards", "1", "--size", SIZE, "--samples", SAMPLES, "--console", "off"];
        run(cyclorama().args(["rig", "--camera"]).arg(self.camera()).args(row).arg("--manifest").arg(&manifest));
        let expected: BTreeMap<_, _> = lines(&manifest).into_iter().collect();
        let (mut compared, mut poses) = (0, BTreeMap::new());
        for (state, views) in shown {
            let Some(right) = expected.get(state) else { continue };
            for (view, (found, right)) in views.iter().zip(right).enumerate() {
                let Some(found) = found else { continue };
                assert_eq!(Some(found), right.as_ref(), "view {view} of {state}");
                compared += 1;
                poses.insert(state, ());
            }
        }
        println!("{compared} views of {} poses, of {} frames shown, are what they should be", poses.len(), shown.len());
        assert!(poses.len() >= COMPARED_MIN, "{} of {} frames showed a pose of the flight", poses.len(), shown.len());
    }
}

/// A manifest's frames by what they depend on.
fn lines(manifest: &Path) -> Shown {
    let text = std::fs::read_to_string(manifest).unwrap();
    // The last line may still be being written.
    let whole = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let line = |line: Value| {
        let state = format!("{} {} {}", line["eye"], line["environment"], line["weights"]);
        let views = line["views"].as_array().unwrap().iter();
        (state, views.map(|view| (view["complete"] == true).then(|| view["tiles"].clone())).collect())
    };
    whole.map(line).collect()
}

/// The program under test, without this machine's environment getting in.
fn cyclorama() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cyclorama"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("CYCLORAMA_")) {
        command.env_remove(name);
    }
    command
}
