//! `cyclorama bench open`: what it takes until a manager can select from a scene, imported and baked.
//!
//! `import` reads the glTF file; `open` maps the baked one; `read` is the plain alternative to the map, reading it whole; `open, all` maps it
//! and then reads and checks every mesh and texture, which a manager does as boards ask for them. Everything is in the page cache: what
//! a disk takes is the disk's affair. That the scenes are the same is checked before a time counts.

use crate::cli::OpenArgs;
use crate::error::CommandError;
use crate::output::{note, say};
use crate::source::{self, Unassembled};
use ::bench::{Figure, Report, Spread};
use manager::scene::{ContentError, Scene, baked, builtin};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Imports for each time that a baked file is opened.
const IMPORTS_PER_OPENING: usize = 5;
/// Triangles of a scene that the figure is about.
const TRIANGLES: u64 = 1_000_000;
/// Of the median, ms.
const TARGET_MS: f64 = 50.0;

/// One way into memory.
#[derive(Clone, Debug, Serialize)]
struct Row {
    scene: String,
    how: &'static str,
    /// Length of the file, bytes; of a glTF file without those beside it.
    bytes: u64,
    /// Triangles, each mesh once.
    triangles: u64,
    times: usize,
    ms: Spread,
}

/// Runs the command.
pub(crate) fn open(args: &OpenArgs) -> Result<(), CommandError> {
    let folder = tempfile::tempdir().map_err(|error| CommandError::said(format!("no temporary folder: {error}")))?;
    let mut rows = Vec::new();
    for scene in &args.scenes {
        note(&format!("{scene} …"));
        rows.extend(rows_of(scene, folder.path(), args.times.get())?);
    }
    let large = rows.iter().filter(|row| row.how == "open" && row.triangles >= TRIANGLES);
    let value = large.map(|row| row.ms.median).max_by(f64::total_cmp);
    let figures = vec![Figure {
        figure: "open.baked_ms",
        value,
        unit: "ms",
        target: "≤ 50, of a scene of 1 000 000 triangles",
        met: value.map(|value| value <= TARGET_MS),
        why: value.is_none().then(|| "no scene has 1 000 000 triangles".into()),
    }];
    if args.json {
        let text = serde_json::to_string(&Report::new("open", rows, figures));
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
        return Ok(());
    }
    say(&format!(
        "{:<16} {:<10} {:>12} {:>10} {:>9} {:>9} {:>9}",
        "scene", "", "bytes", "triangles", "ms min", "median", "max"
    ));
    for Row { scene, how, bytes, triangles, ms, .. } in &rows {
        let Spread { min, median, max } = ms;
        say(&format!("{scene:<16} {how:<10} {bytes:>12} {triangles:>10} {min:>9.2} {median:>9.2} {max:>9.2}"));
    }
    figures.iter().for_each(|figure| say(&figure.to_string()));
    Ok(())
}

fn rows_of(scene: &str, folder: &Path, times: usize) -> Result<Vec<Row>, CommandError> {
    let gltf = match builtin::build(scene) {
        None => PathBuf::from(scene),
        Some(built) => {
            let path = folder.join(format!("{scene}.glb"));
            std::fs::write(&path, &built.glb).map_err(|error| CommandError::file(&path, error))?;
            path
        }
    };
    let name = gltf.display().to_string();
    let Unassembled { parts, .. } = source::parts(&name, &mut |_| ())?;
    let imported = source::assemble(&name, parts.clone(), &|_| ())?;
    let baked_file = folder.join("scene.baked");
    baked::write(&parts, &imported, &baked_file, &mut |_| ControlFlow::Continue(()))?;
    drop(parts);

    let import = || source::parts(&name, &mut |_| ()).and_then(|found| source::assemble(&name, found.parts, &|_| ()));
    let open = || Ok(baked::open(&baked_file)?);
    let read = || Ok(baked::open_by_reading(&baked_file)?);
    let all = || {
        let scene = baked::open(&baked_file)?;
        baked::check_all(&scene)?;
        Ok(scene)
    };
    let triangles = imported.meshes.sizes().map(|(_, size)| u64::from(size[1])).sum();
    let row = |how, file: &Path, times: usize, load: &dyn Fn() -> Result<Scene, CommandError>| {
        let loaded = load()?;
        if !is_same(&imported, &loaded)? {
            return Err(CommandError::said(format!("{scene}: another scene comes by `{how}`; please report this")));
        }
        drop(loaded);
        let mut ms = Vec::with_capacity(times);
        for _ in 0..times {
            let begun = Instant::now();
            let loaded = load()?;
            ms.push(begun.elapsed().as_secs_f64() * 1e3);
            drop(loaded);
        }
        let bytes = std::fs::metadata(file).map_err(|error| CommandError::file(file, error))?.len();
        Ok(Row { scene: scene.to_owned(), how, bytes, triangles, times, ms: Spread::of(&ms) })
    };
    Ok(vec![
        row("import", &gltf, times.div_ceil(IMPORTS_PER_OPENING), &import)?,
        row("open", &baked_file, times, &open)?,
        row("open, all", &baked_file, times, &all)?,
        row("read", &baked_file, times, &read)?,
    ])
}

/// Whether two scenes show the same: the tables that boards get, and every mesh and texture.
fn is_same(a: &Scene, b: &Scene) -> Result<bool, ContentError> {
    Ok(a.table == b.table && a.meshes.all()? == b.meshes.all()? && a.textures.all()? == b.textures.all()?)
}
