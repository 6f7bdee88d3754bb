//! How far a picture is from the reference renderer's.

use crate::error::CommandError;
use crate::in_process::placed;
use ::bench::pixels::{Errors255, Row};
use channel::pipeline::TilePictures;
use manager::host::camera::CameraPose;
use manager::scene::Scene;
use proto::frame::FrameState;
use proto::view::View;
use reference::compare::{Shown, compare, difference_picture};
use reference::picture::Picture;
use reference::sampling::{Options, sample};
use reference::screen::Vertices;
use reference::world::World;
use std::path::Path;

/// Points of the reference where there is no integral.
const POINTS: usize = 1024;
/// Steps of grey for a difference of 1/255 in a difference picture.
const DIFFERENCE_GAIN: f64 = 16.0;

/// The truth: the integral where the scene has no textures, [`POINTS`] points otherwise.
pub(super) fn truth(
    scene: &Scene,
    pose: &CameraPose,
    state: &FrameState,
    view: &View,
) -> Result<Picture, CommandError> {
    let said = |error: String| CommandError::said(error);
    let mut moved = Vec::new();
    placed(scene, pose)?.moved(&mut moved);
    let weights = scene.version_weights(&pose.versions).map_err(|error| said(error.to_string()))?;
    let (meshes, textures) = (scene.meshes.all()?, scene.textures.all()?);
    let world = World::of_scene(&scene.table, &meshes, &textures, &moved, &weights);
    let world = world.map_err(|error| said(error.to_string()))?;
    // Edges are told apart as for 64 samples, the same for all rows.
    let integral = reference::integral::integrate(&world, state, view, Vertices::Exact, 1.0 / 8.0);
    Ok(integral.unwrap_or_else(|_| sample(&world, state, view, &Options::truth(POINTS, 64))))
}

/// A picture that is judged.
pub(super) struct Judged {
    /// Linear RGB, row-major.
    pub linear: Vec<f32>,
    /// The same as it is shown; `None`: as the linear one comes out when it is encoded and not rounded.
    pub rgb: Option<Vec<u8>>,
}

impl Judged {
    /// The tiles as one picture.
    pub(super) fn of_tiles(out: &TilePictures, width: u32, height: u32) -> Self {
        let size = width as usize * height as usize * 3;
        let (mut linear, mut rgb) = (vec![0.0; size], vec![0; size]);
        for (k, tile) in out.tiles.iter().enumerate() {
            let rect = tile.rect(width, height);
            let row = rect.width() as usize * 3;
            for y in rect.y0..rect.y1 {
                let to = (y as usize * width as usize + rect.x0 as usize) * 3;
                let from = (y - rect.y0) as usize * row;
                rgb[to..to + row].copy_from_slice(&out.tile(k)[from..from + row]);
                if let Some(tile) = out.tile_linear(k) {
                    linear[to..to + row].copy_from_slice(&tile[from..from + row]);
                }
            }
        }
        Self { linear, rgb: Some(rgb) }
    }

    fn shown(&self) -> Shown<'_> {
        self.rgb.as_deref().map_or(Shown::Linear(&self.linear), Shown::Bytes)
    }

    /// Enters the picture's errors into its row.
    pub(super) fn judge(&self, row: &mut Row, truth: &Picture) {
        let in_light = compare(Shown::Linear(&self.linear), truth);
        let on_screen = compare(self.shown(), truth);
        row.rms_edges = Some(in_light.edges.rms_linear);
        row.rms_all = Some(in_light.all.rms_linear);
        row.max_all = Some(in_light.all.max_linear);
        row.errors_255 = Some(Errors255 {
            edges_rms: on_screen.edges.rms_255,
            interior_max: on_screen.interior.max_255,
            untextured_max: on_screen.untextured.max_255,
            magnified_p99: on_screen.magnified.p99_255,
            minified_p99: on_screen.minified.p99_255,
            edge_pixels: on_screen.edges.pixels,
            textured_pixels: on_screen.magnified.pixels + on_screen.minified.pixels,
        });
    }

    /// Writes what is different.
    pub(super) fn write_difference(&self, path: &Path, truth: &Picture) -> Result<(), CommandError> {
        let picture = difference_picture(self.shown(), truth, DIFFERENCE_GAIN);
        let picture = picture.map_err(|error| CommandError::file(path, error))?;
        std::fs::write(path, picture).map_err(|error| CommandError::file(path, error))
    }
}
