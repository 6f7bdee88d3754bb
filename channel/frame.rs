//! One frame's numbers, as all stages behind geometry read them.

use crate::geometry::camera::Camera;
use crate::geometry::setup::{ClipRecord, Triangle, WHOLE_FACE};
use crate::geometry::transform::{GeometryRun, Item};
use crate::lights::Light;
use crate::resolve::background::fog;
use crate::resolve::colour::Encoder;
use crate::samples::Pattern;
use crate::shade::tile::Sun;
use proto::frame::Environment;

/// −ln 0.02: at the range of visibility 98 % is faded (Koschmieder's limit).
const KOSCHMIEDER: f64 = 3.912_023_005_428_146;

/// A triangle's number is its run's number above these bits, and its place in the run in them.
const RUN_BITS: u32 = 20;

/// Most triangles of a run.
pub const RUN_TRIANGLES_MAX: usize = 1 << RUN_BITS;

/// Most runs of a frame.
pub const RUNS_MAX: usize = 1 << (32 - RUN_BITS);

/// The number of a triangle.
#[inline(always)]
pub fn triangle_number(run: usize, place: u32) -> u32 {
    debug_assert!(run < RUNS_MAX && (place as usize) < RUN_TRIANGLES_MAX, "within a number's fields");
    (run as u32) << RUN_BITS | place
}

/// See the module.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The view's camera.
    pub camera: &'a Camera,
    /// The samples of a pixel.
    pub pattern: &'a Pattern,
    /// Light and air.
    pub environment: &'a Environment,
    /// The lights of the scene's file, if they are asked for.
    pub lights: &'a [Light],
    /// The frame's list.
    pub items: &'a [Item<'a>],
    /// The frame's triangles.
    pub runs: &'a [GeometryRun],
    /// Linear light to bytes.
    pub encoder: &'static Encoder,
    /// The sun, for faces that depend on their normals alone.
    pub sun: Sun,
    /// What things fade to, linear RGB.
    pub fog: [f32; 3],
    /// k of the fade e^(−k d), 1/m, and V², m²; `None` in clear air.
    pub fade: Option<(f64, f64)>,
    /// Whether light is the same everywhere and depends on the normal alone.
    pub lit_alike: bool,
}

impl<'a> Frame<'a> {
    /// The numbers of a frame. The environment has been checked.
    pub fn new(
        camera: &'a Camera,
        pattern: &'a Pattern,
        environment: &'a Environment,
        lights: &'a [Light],
        items: &'a [Item<'a>],
        runs: &'a [GeometryRun],
    ) -> Self {
        let fade = environment.visibility_m.map(|v| (KOSCHMIEDER / v, v * v));
        let lit_alike = lights.iter().all(Light::is_uniform);
        let (encoder, fog) = (Encoder::shared(), fog(environment));
        let sun = Sun::of(environment);
        Self { camera, pattern, environment, lights, items, runs, encoder, sun, fog, fade, lit_alike }
    }

    /// The run of a triangle.
    #[inline(always)]
    pub fn run(&self, number: u32) -> &'a GeometryRun {
        &self.runs[(number >> RUN_BITS) as usize]
    }

    /// The triangle of that number.
    #[inline(always)]
    pub fn triangle(&self, number: u32) -> &'a Triangle {
        &self.run(number).triangles[(number & ((1 << RUN_BITS) - 1)) as usize]
    }

    /// The clip record of a triangle, if it is a piece of a cut face.
    #[inline(always)]
    pub fn clip(&self, number: u32) -> Option<&'a ClipRecord> {
        let clip = self.triangle(number).clip;
        (clip != WHOLE_FACE).then(|| &self.run(number).clips[clip as usize])
    }

    /// Layer, primitive, face, in this order, as one number: where two faces are equally near, the larger wins.
    #[inline]
    pub fn order(&self, number: u32) -> u64 {
        let triangle = self.triangle(number);
        let item = &self.items[triangle.item as usize];
        u64::from(item.rank) << 32 | u64::from(item.stored.mesh.face_numbers[triangle.face as usize])
    }
}
