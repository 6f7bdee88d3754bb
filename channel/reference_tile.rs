//! The reference tile: a small picture that every board draws before it joins. Its hash tells a board that draws wrongly, for a fault of its
//! machine or because it is of another version, from one that can be trusted with a part of a picture (seed 001: faulty boards are simply removed).
//!
//! What is in it takes the ways that pixels take: faces whole and clipped, thin and crossing, lit by normals and flat, with a texture, behind three
//! sheets of which one cuts another, in fog, before the sky; at one point, at 16, and exactly.

use crate::pipeline::{Renderer, TilePictures};
use crate::simd::SimdLevel;
use crate::store::{Prepared, SceneStore};
use glam::{DAffine3, DVec3};
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState};
use proto::ids::{ContentId, Epoch, FrameNumber, ObjectId, SubobjectId};
use proto::scene::{
    Alpha, Box3, Filter, Material, Mesh, ObjectRow, SceneTable, Sphere, SubobjectRow, TRANSFORM_IDENTITY, Texture,
    TextureUse, Wrap,
};
use proto::share::Part;
use proto::view::{Pose, Samples, Tangents, View};
use std::num::NonZeroUsize;

/// Side of the picture, pixels: four tiles, so that one is left for the sky.
const SIDE: u32 = 64;

/// Draws it; returns the hash of its bytes.
///
/// # Errors
/// Why it can't be drawn at all, for people.
pub fn draw(level: SimdLevel) -> Result<ContentId, String> {
    let mut renderer = Renderer::new(NonZeroUsize::MIN).map_err(|error| error.to_string())?;
    renderer.set_simd(level);
    let store = scene().map_err(|error| error.to_string())?;
    let list: Vec<_> = (0..store.subobjects() as u32).map(SubobjectId).collect();
    let environment = Environment { visibility_m: Some(400.0), ..Environment::default() };
    let (frame, epoch, eye) = (FrameNumber(0), Epoch(0), Pose::IDENTITY);
    let state = FrameState { frame, epoch, eye, environment, debug: DebugPicture::Off };
    let mut bytes = Vec::new();
    for samples in [Samples::One, Samples::Sixteen, Samples::Exact] {
        let tangents = Tangents { left: -1.0, right: 1.0, bottom: -1.0, top: 1.0 };
        let (width, height, near) = (SIDE, SIDE, View::NEAR_DEFAULT);
        let view = View { offset: Pose::IDENTITY, tangents, width, height, near, samples };
        let mut picture = TilePictures::new();
        renderer.draw(&store, &state, &view, &list, &Part::WHOLE, &mut picture).map_err(|error| error.to_string())?;
        (0..picture.tiles.len()).for_each(|k| bytes.extend_from_slice(picture.tile(k)));
    }
    Ok(ContentId::of(&bytes))
}

fn scene() -> Result<SceneStore, Box<dyn std::error::Error>> {
    let texels = (0..64u8).map(|k| [k * 4, 255 - k * 3, k ^ 0x5a, 255]).collect();
    let texture = ContentId([0xff; 16]);
    let mut store = SceneStore::new();
    store.insert(Prepared::texture(texture, Texture { width: 8, height: 8, texels })?);
    let ground = [DVec3::new(-40.0, -3.0, -2.0), DVec3::new(40.0, -3.0, -2.0), DVec3::new(0.0, -3.0, -300.0)];
    let hill = [
        [DVec3::new(-8.0, -3.0, -12.0), DVec3::new(-1.0, -3.0, -10.0), DVec3::new(-4.0, 1.5, -11.0)],
        [DVec3::new(-1.0, -3.0, -10.0), DVec3::new(3.0, -3.0, -14.0), DVec3::new(-4.0, 1.5, -11.0)],
    ];
    let sliver = [DVec3::new(-9.0, 2.0, -10.0), DVec3::new(9.0, 2.3, -10.5), DVec3::new(9.0, 2.31, -10.5)];
    let behind = [DVec3::new(1.0, -2.0, 1.0), DVec3::new(3.0, -2.0, -6.0), DVec3::new(3.0, 1.0, -6.0)];
    let sheet = |x: f64, turn: f64| {
        [
            DVec3::new(x - 3.0, -2.5, -7.0 - turn),
            DVec3::new(x + 3.0, -2.5, -7.0 + turn),
            DVec3::new(x + 2.0, 2.5, -7.0 + turn),
        ]
    };
    let lit = |color| Material { base_color: color, ..Material::default() };
    let clear = |color| Material { alpha: Alpha::Blend, double_sided: true, ..lit(color) };
    let painted = TextureUse {
        texture,
        set: 0,
        transform: TRANSFORM_IDENTITY,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Mirror,
        magnify: Filter::Linear,
    };
    let mut round = mesh(&hill, lit([0.8, 0.5, 0.3, 1.0]));
    round.normals = round
        .positions
        .iter()
        .map(|p| DVec3::new(f64::from(p[0]) + 4.0, 4.0, 6.0).normalize().as_vec3().to_array())
        .collect();
    let mut floor = mesh(&[ground], Material { base_texture: Some(painted), ..Material::default() });
    floor.texcoords = vec![vec![[0.0, 0.0], [20.0, 0.0], [10.0, 75.0]]];
    let meshes = [
        floor,
        round,
        mesh(&[sliver], lit([0.1, 0.9, 0.2, 1.0])),
        mesh(&[behind], Material { double_sided: true, ..lit([0.9, 0.9, 0.1, 1.0]) }),
        mesh(&[sheet(0.0, 1.0)], clear([1.0, 0.2, 0.2, 0.5])),
        mesh(&[sheet(0.5, -1.0)], clear([0.2, 0.2, 1.0, 0.4])),
        mesh(&[sheet(1.0, 0.3)], Material { unlit: true, ..clear([0.3, 1.0, 0.3, 0.7]) }),
    ];
    let name = |k: usize| ContentId([k as u8 + 1; 16]);
    let row = |k: usize| SubobjectRow {
        object: ObjectId(k as u32),
        mesh: name(k),
        primitive: k as u32,
        layer: 0,
        part_of: None,
        planes: None,
    };
    let table = SceneTable {
        objects: meshes.iter().map(|_| ObjectRow { transform: DAffine3::IDENTITY }).collect(),
        subobjects: (0..meshes.len()).map(row).collect(),
        ..SceneTable::default()
    };
    for (k, mesh) in meshes.into_iter().enumerate() {
        store.insert(Prepared::mesh(name(k), mesh)?);
    }
    store.set_table(table)?;
    Ok(store)
}

fn mesh(triangles: &[[DVec3; 3]], material: Material) -> Mesh {
    let corners: Vec<DVec3> = triangles.iter().flatten().copied().collect();
    let min = corners.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let max = corners.iter().copied().reduce(DVec3::max).unwrap_or_default();
    Mesh {
        origin: DVec3::ZERO,
        positions: corners.iter().map(|p| p.as_vec3().to_array()).collect(),
        normals: Vec::new(),
        colors: Vec::new(),
        texcoords: Vec::new(),
        triangles: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        face_numbers: (0..triangles.len() as u32).collect(),
        material,
        sphere: Sphere { centre: (min + max) / 2.0, radius: (max - min).length() / 2.0 },
        bounds: Box3 { min, max },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::frame::REFERENCE_TILE;

    #[test]
    fn every_instruction_set_draws_it_as_the_backplane_expects() {
        for level in SimdLevel::all() {
            let drawn = draw(level).unwrap();
            assert_eq!(
                drawn,
                REFERENCE_TILE,
                "{}: if pixels are meant to differ now, this is the new name",
                level.name()
            );
        }
    }
}
