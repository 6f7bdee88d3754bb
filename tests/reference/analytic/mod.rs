//! Cases whose answer a person can work out: the reference's own proof.
//!
//! All are seen through one view of 8 × 8 pixels with tangents ±1 and the eye at the origin, so that [`on_screen`]
//! puts a vertex at a known place of the screen and a known depth.

mod flat;
mod formula;
mod look;
mod planes;

use crate::{Model, World};
use glam::{DAffine3, DVec3};
use proto::debug::DebugPicture;
use proto::frame::{Background, Environment, FrameState};
use proto::ids::{Epoch, FrameNumber};
use proto::scene::{Alpha, Box3, Material, Mesh, Sphere};
use proto::view::{Pose, Samples, Tangents, View};

/// Side of the view, pixels.
const SIDE: u32 = 8;

/// The point that is seen at (x, y) pixels at the distance `depth` along the line of sight.
fn on_screen(x: f64, y: f64, depth: f64) -> DVec3 {
    DVec3::new(depth * (x / 4.0 - 1.0), depth * (1.0 - y / 4.0), -depth)
}

/// Triangles, three points each, of one material; not split, not shared.
fn mesh(points: &[DVec3], material: Material) -> Mesh {
    let count = points.len() as u32 / 3;
    Mesh {
        origin: DVec3::ZERO,
        positions: points.iter().map(|p| p.as_vec3().to_array()).collect(),
        normals: Vec::new(),
        colors: Vec::new(),
        texcoords: Vec::new(),
        triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        face_numbers: (0..count).collect(),
        material,
        sphere: Sphere { centre: DVec3::ZERO, radius: 1e9 },
        bounds: Box3 { min: DVec3::splat(-1e9), max: DVec3::splat(1e9) },
    }
}

/// The two triangles of a quad, corners counter-clockwise as seen.
fn quad([a, b, c, d]: [DVec3; 4]) -> [DVec3; 6] {
    [a, b, c, a, c, d]
}

/// A quad right across the screen and beyond, at one depth.
fn wall(depth: f64) -> [DVec3; 6] {
    rectangle(-8.0, -8.0, 16.0, 16.0, depth)
}

/// A rectangle on the screen at one depth.
fn rectangle(left: f64, top: f64, right: f64, bottom: f64, depth: f64) -> [DVec3; 6] {
    quad([(left, bottom), (right, bottom), (right, top), (left, top)].map(|(x, y)| on_screen(x, y, depth)))
}

/// A surface that shows exactly this colour, opaque.
fn paint(color: [f32; 3]) -> Material {
    let [r, g, b] = color;
    Material { base_color: [r, g, b, 1.0], unlit: true, ..Material::default() }
}

/// The same as glass of that saturation.
fn glass(color: [f32; 3], alpha: f32) -> Material {
    let [r, g, b] = color;
    Material { base_color: [r, g, b, alpha], alpha: Alpha::Blend, unlit: true, ..Material::default() }
}

/// A world of ordinary meshes.
fn world(meshes: &[Mesh]) -> World<'_> {
    let mut world = World::default();
    for mesh in meshes {
        world.add(mesh, DAffine3::IDENTITY);
    }
    world
}

/// A world each mesh of which is a version of one model.
fn versions<'a>(meshes: &'a [Mesh], weights: &[f64]) -> World<'a> {
    let mut world = world(meshes);
    world.models = vec![Model { weights: weights.to_vec(), merged: false }];
    for (version, instance) in world.instances.iter_mut().enumerate() {
        instance.member = Some(crate::Member { model: 0, version });
    }
    world
}

fn view() -> View {
    View {
        offset: Pose::IDENTITY,
        tangents: Tangents { left: -1.0, right: 1.0, bottom: -1.0, top: 1.0 },
        width: SIDE,
        height: SIDE,
        near: View::NEAR_DEFAULT,
        samples: Samples::One,
    }
}

/// The eye at the origin, before a constant background.
fn state(background: [f32; 3]) -> FrameState {
    FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(1),
        eye: Pose::IDENTITY,
        environment: Environment { background: Background::Constant(background), ..Environment::default() },
        debug: DebugPicture::Off,
    }
}

/// Numbers that look random and are the same every time (`SplitMix64`), in 0..1.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

fn assert_close(got: [f64; 3], want: [f64; 3], within: f64) {
    assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() <= within), "{got:?} instead of {want:?}");
}
