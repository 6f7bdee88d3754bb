//! The benchmark scenes: five worlds, each of which stresses one thing, with a camera path of 60 poses.
//!
//! | scene | stresses |
//! |---|---|
//! | [`city`] | culling and instances: 2025 buildings on a net of streets |
//! | [`dense`] | geometry: a million triangles of hills, and 10 000 trees |
//! | [`smoke`] | translucency: 40 spheres and 20 panes over each other |
//! | [`runway`] | coplanar layers, and slanting edges: 42 markings on a runway, seen on approach |
//! | [`overdraw`] | hidden surfaces: 30 walls drawn from back to front |
//!
//! Counts, sizes, colours and paths are those of the peers' benchmark (`../shared/peers/scenes.py`), so that figures can be
//! compared; where chance places things it is our own, hence the scenes are alike in kind and not to the metre. Nothing has a
//! texture. Nodes come in the order in which a renderer that does not sort would draw them.

mod city;
mod dense;
mod overdraw;
mod runway;
mod smoke;

use super::BuiltIn;
use super::random::Random;
use super::shapes::{Shape, Vertex};
use crate::host::camera::{CameraFile, CameraPose};
use crate::scene::glb::{AlphaMode, GlbBuilder, MaterialId, MeshId, Node, Surface};
use glam::{DQuat, DVec3, dvec3};
use serde_json::json;

/// The names of the scenes here.
pub(super) const NAMES: [&str; 5] = ["city", "dense", "smoke", "runway", "overdraw"];

const SEED: u64 = 1983;
/// Poses of each path.
const POSES: u32 = 60;
/// Vertical field of view, degrees, where a scene has no reason for another.
const FOV_DEG: f64 = 45.0;
/// Width by height of the pictures that the scenes are laid out for.
const ASPECT: f64 = 16.0 / 9.0;

/// Makes the scene of that name.
pub(super) fn build(name: &str) -> Option<BuiltIn> {
    let (name, make): (_, fn(&mut Kit) -> Vec<CameraPose>) = match name {
        "city" => ("city", city::build),
        "dense" => ("dense", dense::build),
        "smoke" => ("smoke", smoke::build),
        "runway" => ("runway", runway::build),
        "overdraw" => ("overdraw", overdraw::build),
        // What `overdraw` is measured against; no scene to look at, hence not among the names.
        "overdraw-front" => ("overdraw-front", overdraw::build_front),
        _ => return None,
    };
    let mut kit = Kit { glb: GlbBuilder::new("cyclorama bench"), random: Random::new(SEED) };
    let poses = make(&mut kit);
    Some(BuiltIn { name, glb: kit.glb.write(), camera: CameraFile { origin: None, poses } })
}

/// The scene under construction.
#[derive(Debug)]
struct Kit {
    glb: GlbBuilder,
    random: Random,
}

/// Where a mesh is put.
#[derive(Clone, Copy, Debug)]
struct Place {
    at: DVec3,
    /// About +Y, counter-clockwise seen from above, rad.
    turn: f64,
    scale: DVec3,
}

impl Place {
    const ORIGIN: Self = Self { at: DVec3::ZERO, turn: 0.0, scale: DVec3::ONE };
}

impl Kit {
    /// An opaque colour, linear RGB.
    fn color(&mut self, name: &str, [r, g, b]: [f32; 3]) -> MaterialId {
        self.glb.material(name, &Surface::plain(r, g, b))
    }

    /// A translucent colour.
    fn glass(&mut self, name: &str, [r, g, b]: [f32; 3], alpha: f32, double_sided: bool) -> MaterialId {
        let surface = Surface::plain(r, g, b);
        let base_color = [r, g, b, alpha];
        self.glb.material(name, &Surface { base_color, alpha: AlphaMode::Blend, double_sided, ..surface })
    }

    fn mesh(&mut self, name: &str, parts: &[(&Shape, MaterialId)]) -> MeshId {
        let parts: Vec<_> = parts.iter().map(|(shape, material)| (shape.geometry(), *material)).collect();
        self.glb.mesh(name, &parts)
    }

    fn put(&mut self, name: &str, mesh: MeshId, place: Place) {
        let turned = if place.turn == 0.0 { DQuat::IDENTITY } else { DQuat::from_rotation_y(place.turn) };
        self.glb.node(None, Node::new(name).mesh(mesh).at(place.at).turned(turned).scaled(place.scale));
    }

    /// A mesh of its own on the level ground, in a coplanar layer.
    fn paint(&mut self, name: &str, layer: i32, shape: &Shape, material: MaterialId) {
        let mesh = self.mesh(name, &[(shape, material)]);
        self.glb.node(None, Node::new(name).mesh(mesh).extras(json!({"cyclorama": {"layer": layer}})));
    }
}

/// Level ground of `cells[0]` × `cells[1]` squares.
fn ground(x: [f64; 2], z: [f64; 2], cells: [u32; 2]) -> Shape {
    let along = |range: [f64; 2], i: u32, n: u32| range[0] + (range[1] - range[0]) * (f64::from(i) / f64::from(n));
    Shape::grid(cells[0], cells[1], |i, j| {
        Vertex::new(dvec3(along(x, i, cells[0]), 0.0, along(z, j, cells[1])), DVec3::Y)
    })
}

/// A path: `pose(t)` gives eye and target for t from 0 to 1.
fn path(fov_deg: f64, pose: impl Fn(f64) -> (DVec3, DVec3)) -> Vec<CameraPose> {
    (0..POSES)
        .map(|i| {
            let (eye, target) = pose(f64::from(i) / f64::from(POSES - 1));
            CameraPose::looking_at(None, eye, target, fov_deg)
        })
        .collect()
}

#[cfg(test)]
mod tests;
