//! Where scenes and camera paths come from: files, and the program itself.

use crate::cli::{InspectArgs, SceneArgs};
use crate::error::CommandError;
use crate::output::{note, say};
use manager::host::camera::CameraFile;
use manager::scene::{Scene, builtin};
use std::path::{Path, PathBuf};

/// A scene, and the camera that goes with it.
pub(crate) struct Source {
    pub scene: Scene,
    pub camera: CameraFile,
}

/// Loads the scene that `name` is: a built-in scene or a file; and the camera file, or what stands in for it.
pub(crate) fn load(name: &str, camera: Option<&Path>) -> Result<Source, CommandError> {
    let (scene, own_camera) = load_scene(name)?;
    for warning in &scene.warnings {
        note(&format!("warning: {warning}"));
    }
    let camera = match (camera, own_camera) {
        (Some(path), _) => CameraFile::read(path)?,
        (None, Some(camera)) => camera,
        (None, None) => match beside(Path::new(name)) {
            path if path.is_file() => CameraFile::read(&path)?,
            _ => CameraFile::orbit(scene.sphere),
        },
    };
    Ok(Source { scene, camera })
}

/// The camera path that belongs to a scene file: `city.glb` → `city.path.json`.
fn beside(scene: &Path) -> PathBuf {
    scene.with_extension("path.json")
}

#[cfg(feature = "import")]
fn load_scene(name: &str) -> Result<(Scene, Option<CameraFile>), CommandError> {
    use manager::scene::import;
    if let Some(built) = builtin::build(name) {
        return Ok((import::load_glb(&built.glb, built.name)?, Some(built.camera)));
    }
    let path = Path::new(name);
    if !path.exists() {
        return Err(CommandError::said(format!(
            "{name}: no such file, and no built-in scene of that name (there is: {})",
            builtin::names().join(", ")
        )));
    }
    Ok((import::load(path)?, None))
}

#[cfg(not(feature = "import"))]
fn load_scene(name: &str) -> Result<(Scene, Option<CameraFile>), CommandError> {
    Err(CommandError::said(format!("{name}: this program was built without `import`; use one that has it")))
}

/// `cyclorama inspect`.
pub(crate) fn inspect(args: &InspectArgs) -> Result<(), CommandError> {
    let (scene, _) = load_scene(&args.scene)?;
    let inspection = manager::scene::inspect::inspect(&scene);
    if args.json {
        let text = serde_json::to_string_pretty(&inspection);
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
    } else {
        say(inspection.to_string().trim_end());
    }
    Ok(())
}

/// `cyclorama scene`.
pub(crate) fn write_scene(args: &SceneArgs) -> Result<(), CommandError> {
    let Some(built) = builtin::build(&args.name) else {
        let known = builtin::names().join(", ");
        return Err(CommandError::said(format!("no built-in scene {:?}; there is: {known}", args.name)));
    };
    let path = beside(&args.output);
    std::fs::write(&args.output, &built.glb).map_err(|error| CommandError::file(&args.output, error))?;
    let camera = serde_json::to_string(&built.camera.poses);
    let camera = camera.map_err(|error| CommandError::said(error.to_string()))?;
    std::fs::write(&path, camera).map_err(|error| CommandError::file(&path, error))?;
    say(&format!(
        "{} ({} bytes), {} ({} poses)",
        args.output.display(),
        built.glb.len(),
        path.display(),
        built.camera.poses.len()
    ));
    Ok(())
}
