//! `cyclorama bake`: imports a scene once, with a bar that says how long it will take, and writes it to a file that opens in
//! milliseconds.

use crate::cli::{BakeArgs, Supervision};
use crate::error::CommandError;
use crate::output::{note, say};
use crate::serve::{runtime, shutdown_token};
use crate::source::{self, Unassembled, beside};
use indicatif::{ProgressBar, ProgressStyle};
use manager::host::camera::CameraFile;
use manager::scene::baked;
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Shares of the three stages in the whole time: reading the scene, looking for shared planes, writing. On `dense` they take 0.58, 1.25 and
/// 0.05 s, on small scenes with pictures about as long as each other. They only decide how evenly the bar moves.
const STAGES: [(&str, f64); 3] = [("importing", 0.3), ("looking for shared planes", 0.6), ("writing", 0.1)];
/// Steps of the bar.
const STEPS: f64 = 1000.0;
/// How often it is said how far it is where there is no terminal.
const PROGRESS_PERIOD: Duration = Duration::from_secs(5);

/// How far a bake is: a bar on a terminal, a line now and then elsewhere.
struct Progress {
    bar: Option<ProgressBar>,
    stage: usize,
    said: Mutex<Instant>,
}

impl Progress {
    fn new() -> Self {
        let style = ProgressStyle::with_template("{bar:30} {percent} %, {eta} left: {msg}");
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(STEPS as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        });
        let mut progress = Self { bar, stage: 0, said: Mutex::new(Instant::now()) };
        progress.begin(0);
        progress
    }

    fn begin(&mut self, stage: usize) {
        self.stage = stage;
        if let Some(bar) = &self.bar {
            bar.set_message(STAGES[stage].0);
        }
        self.on(0.0);
    }

    /// `part` of the present stage is done.
    fn on(&self, part: f64) {
        let before: f64 = STAGES[..self.stage].iter().map(|(_, share)| share).sum();
        let (name, share) = STAGES[self.stage];
        let done = before + share * part;
        match &self.bar {
            Some(bar) => bar.set_position((done * STEPS) as u64),
            None => {
                // Whoever panicked with it has left a moment in it all the same.
                let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
                if said.elapsed() >= PROGRESS_PERIOD {
                    *said = Instant::now();
                    note(&format!("{name}: {:.0} %", done * 100.0));
                }
            }
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        // Also before an error is printed: it gets a line of its own.
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

/// Runs the command.
pub(crate) fn run(args: &BakeArgs) -> Result<(), CommandError> {
    if baked::is_baked(Path::new(&args.scene)) {
        let what = "is baked already; name the glTF file that it was made from";
        return Err(CommandError::said(format!("{}: {what}", args.scene)));
    }
    let begun = Instant::now();
    let mut progress = Progress::new();
    let Unassembled { parts, camera } = source::parts(&args.scene, &mut |part| progress.on(part))?;
    progress.begin(1);
    let scene = source::assemble(&args.scene, parts.clone(), &|part| progress.on(part))?;
    progress.begin(2);
    {
        // Until here there is no file that an interrupt could leave behind. From here on it takes the part file away.
        let runtime = runtime(2)?;
        let interrupted = runtime.block_on(async { shutdown_token(Supervision { supervised: false }) })?;
        let mut watch = |part| {
            progress.on(part);
            if interrupted.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        baked::write(&parts, &scene, &args.output, &mut watch)?;
    }
    drop(progress);
    for warning in &scene.warnings {
        note(&format!("warning: {warning}"));
    }
    let bytes = std::fs::metadata(&args.output).map_err(|error| CommandError::file(&args.output, error))?.len();
    let triangles: u64 =
        scene.shapes.iter().flat_map(|shape| &shape.pieces).map(|piece| u64::from(piece.triangles)).sum();
    let mut line = format!(
        "{} ({bytes} bytes): {triangles} triangles, {} textures; {:.1} s",
        args.output.display(),
        scene.textures.len(),
        begun.elapsed().as_secs_f64()
    );
    if let Some(path) = keep_camera(args, camera)? {
        line.push_str(&format!("; camera path {}", path.display()));
    }
    say(&line);
    Ok(())
}

/// Puts the scene's own camera path beside the baked file, where commands look for it; one that is there already stays. Returns
/// where it was written.
fn keep_camera(args: &BakeArgs, camera: Option<CameraFile>) -> Result<Option<PathBuf>, CommandError> {
    let path = beside(&args.output);
    if path.exists() {
        return Ok(None);
    }
    let text = match camera {
        Some(camera) => serde_json::to_string(&camera.poses).map_err(|error| CommandError::said(error.to_string()))?,
        None => match beside(Path::new(&args.scene)) {
            own if own.is_file() => std::fs::read_to_string(&own).map_err(|error| CommandError::file(&own, error))?,
            _ => return Ok(None),
        },
    };
    std::fs::write(&path, text).map_err(|error| CommandError::file(&path, error))?;
    Ok(Some(path))
}
