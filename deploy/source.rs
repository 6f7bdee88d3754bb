//! Where scenes and camera paths come from: files, and the program itself.

use crate::cli::{InspectArgs, SceneArgs};
use crate::error::CommandError;
use crate::output::{note, say};
use manager::host::camera::CameraFile;
use manager::scene::{Parts, Scene, baked, builtin};
use std::path::{Path, PathBuf};

/// A scene, and the camera that goes with it.
pub(crate) struct Source {
    pub scene: Scene,
    pub camera: CameraFile,
}

impl Source {
    /// Writes the camera path into a folder, as a file that other processes can read; returns its path.
    pub(crate) fn camera_file(&self, folder: &Path) -> Result<PathBuf, CommandError> {
        let path = folder.join("camera.json");
        let text = serde_json::to_string(&self.camera).map_err(|error| CommandError::said(error.to_string()))?;
        std::fs::write(&path, text).map_err(|error| CommandError::file(&path, error))?;
        Ok(path)
    }
}

/// Loads the scene that `name` is: a built-in scene, a glTF or a baked file; and the camera file, or what stands in for it.
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

/// The camera path in this file, or that of the built-in scene of this name.
pub(crate) fn camera(file: &Path) -> Result<CameraFile, CommandError> {
    match file.to_str().filter(|_| !file.exists()).and_then(builtin::build) {
        Some(built) => Ok(built.camera),
        None => Ok(CameraFile::read(file)?),
    }
}

/// The camera path that belongs to a scene file: `city.glb` → `city.path.json`.
pub(crate) fn beside(scene: &Path) -> PathBuf {
    scene.with_extension("path.json")
}

fn load_scene(name: &str) -> Result<(Scene, Option<CameraFile>), CommandError> {
    let path = Path::new(name);
    // A built-in scene's name means that scene, whatever lies around.
    if !builtin::names().contains(&name) && baked::is_baked(path) {
        return Ok((baked::open(path)?, None));
    }
    import(name)
}

fn import(name: &str) -> Result<(Scene, Option<CameraFile>), CommandError> {
    let Unassembled { parts, camera } = parts(name, &mut |_| ())?;
    Ok((assemble(name, parts, &|_| ())?, camera))
}

/// What an importer hands over, and a built-in scene's camera.
pub(crate) struct Unassembled {
    pub parts: Parts,
    pub camera: Option<CameraFile>,
}

/// Imports the scene that `name` is: a built-in scene or a glTF file. `watch` hears how far it is, from 0 to 1.
#[cfg(feature = "import")]
pub(crate) fn parts(name: &str, watch: &mut dyn FnMut(f64)) -> Result<Unassembled, CommandError> {
    use manager::scene::import;
    if let Some(built) = builtin::build(name) {
        let parts = import::parts_glb(&built.glb, built.name, watch)?;
        return Ok(Unassembled { parts, camera: Some(built.camera) });
    }
    let path = Path::new(name);
    if !path.exists() {
        return Err(CommandError::said(format!(
            "{name}: no such file, and no built-in scene of that name (there is: {})",
            builtin::names().join(", ")
        )));
    }
    Ok(Unassembled { parts: import::parts(path, watch)?, camera: None })
}

#[cfg(not(feature = "import"))]
pub(crate) fn parts(name: &str, _: &mut dyn FnMut(f64)) -> Result<Unassembled, CommandError> {
    Err(CommandError::said(format!(
        "{name}: this program was built without `import` and opens only what `cyclorama bake` wrote; use one that has it"
    )))
}

/// The scene of these parts, which `name` has. `watch` hears how far it is, from 0 to 1, on any thread.
pub(crate) fn assemble(name: &str, parts: Parts, watch: &(dyn Fn(f64) + Sync)) -> Result<Scene, CommandError> {
    Scene::assemble_watched(parts, watch).map_err(|error| CommandError::said(format!("{name}: {error}")))
}

/// `cyclorama inspect`.
pub(crate) fn inspect(args: &InspectArgs) -> Result<(), CommandError> {
    let (scene, _) = load_scene(&args.scene)?;
    let mut inspection = manager::scene::inspect::inspect(&scene);
    let path = Path::new(&args.scene);
    if scene.is_baked() {
        inspection.baked = Some(baked::facts(path)?);
    }
    if args.check {
        if !scene.is_baked() {
            return Err(CommandError::said(format!("{}: --check is for baked files, and this is none", args.scene)));
        }
        baked::check_all(&scene)?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&inspection);
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
    } else {
        say(inspection.to_string().trim_end());
        if args.check {
            say(&format!(
                "{} meshes and {} textures are what their names say",
                scene.meshes.len(),
                scene.textures.len()
            ));
        }
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
