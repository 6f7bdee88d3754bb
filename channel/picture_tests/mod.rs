//! Claims about whole pictures, against formulas and the brute-force sampler of [`crate::oracle`].

pub(crate) mod distribution;
mod exact;
mod formulas;
mod light;
mod models;
pub(crate) mod planes;
mod skips;

use crate::oracle::*;
use crate::store::SceneStore;
use glam::{DAffine3, DVec3};
use proto::scene::{Mesh, Texture};
use proto::view::Samples;

pub(crate) const ALL_SAMPLES: [Samples; 5] =
    [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour];

pub(crate) fn at_origin(meshes: Vec<Mesh>) -> SceneStore {
    store_of(meshes.into_iter().map(|m| (m, DAffine3::IDENTITY)).collect())
}

/// A rectangle square to the line of sight at `distance`, far beyond the view's borders.
pub(crate) fn wall(distance: f64, color: [f32; 4]) -> Mesh {
    let d = distance * 4.0;
    mesh_of(&rectangle(DVec3::new(-d, -d, -distance), DVec3::X * 2.0 * d, DVec3::Y * 2.0 * d), color)
}

pub(crate) fn near(a: [f32; 3], b: [f64; 3], by: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (f64::from(*a) - b).abs() <= by)
}

pub(crate) fn assert_near(a: [f32; 3], b: [f64; 3], by: f64) {
    assert!(near(a, b, by), "{a:?} is not {b:?}");
}

pub(crate) fn checker(store: &mut SceneStore, n: usize, size: u32, light: [u8; 4], dark: [u8; 4]) {
    let texels = (0..size * size).map(|i| if (i % size + i / size).is_multiple_of(2) { light } else { dark }).collect();
    store.insert_texture(content(n), Texture { width: size, height: size, texels }).unwrap();
}
