//! Rig files: TOML, every key known by name. `deploy/rigs/annotated.toml` documents each.

use crate::cli::SelectAheadArg;
use crate::error::CommandError;
use manager::select::DetailMode;
use proto::view::{Mode, Tangents};
use serde::Deserialize;
use std::net::SocketAddr;
use std::path::Path;

/// A rig file as written.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RigFile {
    /// A glTF file, relative to this file, or the name of a built-in scene.
    pub scene: Option<String>,
    /// Camera file whose first pose is shown until a host speaks.
    pub camera: Option<String>,
    /// Folder of the manager's keys, relative to this file.
    pub keys: Option<String>,
    /// Frames a second.
    pub rate_hz: Option<f64>,
    /// How far resolution may fall when boards can't follow: one pixel drawn for so many each way.
    pub lowest_resolution: Option<u32>,
    /// How long before its moment a swap is said to displays, ms.
    pub swap_lead_ms: Option<f64>,
    /// Whether the next frame is selected while boards draw the present one.
    pub select_ahead: Option<SelectAheadArg>,
    /// Most memory of each board that is used for meshes and textures, MiB.
    pub board_memory_mib: Option<f64>,
    /// What somebody must know to change anything at the console.
    pub console_token: Option<String>,
    /// Where frames are sent as traces, OTLP over HTTP.
    pub otlp: Option<String>,
    /// Which levels of detail are shown.
    pub detail: Option<DetailEntry>,
    /// Default row of views, when there are no `[[views]]`.
    #[serde(default)]
    pub row: Row,
    /// Projectors.
    #[serde(default)]
    pub views: Vec<ViewEntry>,
    #[serde(default)]
    pub air: Air,
    #[serde(default)]
    pub ports: Ports,
    /// Likewise of the stand-by.
    #[serde(default)]
    pub standby: Ports,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Row {
    pub views: Option<std::num::NonZeroU32>,
    pub size: Option<[u32; 2]>,
    pub samples: Option<SamplesEntry>,
    pub mode: Option<ModeEntry>,
}

/// A number of points, or `"exact"`.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub(crate) enum SamplesEntry {
    Count(u32),
    Name(String),
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ModeEntry {
    Interleave,
    Region,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum DetailEntry {
    Auto,
    Finest,
}

impl From<DetailEntry> for DetailMode {
    fn from(entry: DetailEntry) -> Self {
        match entry {
            DetailEntry::Auto => Self::Auto,
            DetailEntry::Finest => Self::Finest,
        }
    }
}

impl From<ModeEntry> for Mode {
    fn from(entry: ModeEntry) -> Self {
        match entry {
            ModeEntry::Interleave => Self::Interleave,
            ModeEntry::Region => Self::Region,
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ViewEntry {
    pub name: String,
    pub size: [u32; 2],
    #[serde(default)]
    pub yaw_deg: f64,
    #[serde(default)]
    pub pitch_deg: f64,
    #[serde(default)]
    pub roll_deg: f64,
    #[serde(default)]
    pub offset_m: [f64; 3],
    pub vertical_fov_deg: Option<f64>,
    pub tangents: Option<Tangents>,
    pub near_m: Option<f64>,
    pub samples: Option<SamplesEntry>,
    pub mode: Option<ModeEntry>,
    pub at: Option<[u32; 2]>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Air {
    pub background: Option<[f64; 3]>,
    pub sun: Option<[f64; 3]>,
    pub visibility_m: Option<f64>,
    pub fog: Option<[f64; 3]>,
    pub scene_lights: Option<bool>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Ports {
    pub backplane: Option<SocketAddr>,
    pub pose: Option<SocketAddr>,
    pub console: Option<SocketAddr>,
}

impl RigFile {
    /// Reads a file. Errors name it, the line, and for an unknown key the nearest known one.
    pub(crate) fn read(path: &Path) -> Result<Self, CommandError> {
        let text = std::fs::read_to_string(path).map_err(|error| CommandError::file(path, error))?;
        let mut file: Self = toml::from_str(&text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start).min(text.len());
            let line = text[..at].matches('\n').count() + 1;
            CommandError::said(format!("{}: line {line}: {}", path.display(), suggest(error.message())))
        })?;
        // Paths in a rig file are relative to it, wherever the program runs.
        let folder = path.parent().unwrap_or(Path::new(""));
        let relative = |name: &String| folder.join(name).display().to_string();
        if let Some(scene) = &file.scene
            && !manager::scene::builtin::names().contains(&scene.as_str())
        {
            file.scene = Some(relative(scene));
        }
        file.camera = file.camera.as_ref().map(relative);
        file.keys = file.keys.as_ref().map(relative);
        Ok(file)
    }
}

/// Shortens serde's "unknown field `x`, expected one of …" to the key that was probably meant.
fn suggest(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    match (message.starts_with("unknown field"), quoted.next()) {
        (true, Some(unknown)) => {
            let known: Vec<&str> = quoted.collect();
            let near = known
                .iter()
                .max_by(|a, b| strsim::jaro_winkler(unknown, a).total_cmp(&strsim::jaro_winkler(unknown, b)));
            match near.filter(|near| strsim::jaro_winkler(unknown, near) > 0.7) {
                Some(near) => format!("unknown key \"{unknown}\"; did you mean \"{near}\"?"),
                None => format!("unknown key \"{unknown}\"; known here are: {}", known.join(", ")),
            }
        }
        _ => message.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<RigFile, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, text).unwrap();
        RigFile::read(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn an_unknown_key_is_refused_with_line_and_suggestion() {
        let error = read("scene = \"airport\"\nrate_zh = 60\n").unwrap_err();
        assert!(error.contains("rig.toml: line 2: unknown key \"rate_zh\"; did you mean \"rate_hz\"?"), "{error}");
        let error = read("[ports]\nqqq = 1\n").unwrap_err();
        assert!(error.contains("known here are: backplane, pose, console"), "{error}");
        let error = read("rate_hz = \"fast\"").unwrap_err();
        assert!(error.contains("line 1"), "{error}");
    }

    #[test]
    fn every_example_rig_is_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs");
        let mut count = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let file = RigFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
            crate::settings::check_example(&file);
            count += 1;
        }
        assert!(count >= 2, "{count} examples");
    }
}
