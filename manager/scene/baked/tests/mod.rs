//! Tests of baked files: that they hold the scene, and that nothing in them is believed.

mod hostile;
mod interrupted;
mod mutations;
mod round_trip;

use super::{BakedFault, open_bytes};
use crate::scene::split::{Primitive, split};
use crate::scene::{Extras, LightSource, MaterialEntry, NodeSource, Parts, PieceSource, Scene};
use glam::{DAffine3, DQuat, DVec3};
use proto::scene::{Alpha, Filter, LightKind, Material, Mesh, TRANSFORM_IDENTITY, Texture, TextureUse, Wrap};
use std::sync::OnceLock;

/// A small scene in which everything occurs that a file can hold: textures, a mesh of several pieces, levels of detail, a merged
/// part, extras, an entity number, lights of all kinds, faces in one plane, names and warnings.
fn small() -> Parts {
    let mut parts = Parts { name: "small".into(), ..Parts::default() };
    let texels = (0..6).map(|i| [i, 2 * i, 3 * i, 255]).collect();
    let texture = parts.add_texture(Texture { width: 3, height: 2, texels });
    let usage = TextureUse {
        texture,
        set: 1,
        transform: [[2.0, 0.0, 0.5], [0.0, 4.0, 0.25]],
        wrap_u: Wrap::Clamp,
        wrap_v: Wrap::Mirror,
        magnify: Filter::Nearest,
    };
    let materials = [
        Material { base_texture: Some(usage), alpha: Alpha::Mask { cutoff: 0.25 }, ..Material::default() },
        Material {
            emissive: [1.0, 2.0, 0.5],
            emissive_texture: Some(TextureUse { transform: TRANSFORM_IDENTITY, ..usage }),
            double_sided: true,
            ..Material::default()
        },
        Material { base_color: [0.1, 0.2, 0.3, 0.4], alpha: Alpha::Blend, unlit: true, ..Material::default() },
    ];
    parts.materials = materials
        .iter()
        .enumerate()
        .map(|(i, material)| MaterialEntry { name: format!("material {i}"), material: *material })
        .collect();
    let sheet = |side: u32, y: f32, material: usize| -> Vec<Mesh> {
        let at = |x: u32, z: u32| x * (side + 1) + z;
        let positions = (0..=side).flat_map(|x| (0..=side).map(move |z| [x as f32, y, z as f32])).collect();
        let square = |x, z| [[at(x, z), at(x, z + 1), at(x + 1, z)], [at(x + 1, z), at(x, z + 1), at(x + 1, z + 1)]];
        let triangles = (0..side).flat_map(|x| (0..side).flat_map(move |z| square(x, z))).collect();
        split(&Primitive { positions, triangles, material: materials[material], ..Primitive::default() })
    };
    let pieces = |meshes: Vec<Mesh>, material: u32, primitive: u32, extras: Extras| {
        meshes.into_iter().map(move |mesh| PieceSource { mesh, material, primitive, extras: extras.clone() })
    };
    let layer = Extras { layer: Some(3), ..Extras::default() };
    let ground = pieces(sheet(4, 0.0, 0), 0, 0, Extras::default())
        .chain(pieces(sheet(2, 0.0, 1), 1, 1, layer))
        .chain(pieces(sheet(1, 9.0, 1), 1, 2, Extras::default()));
    let whole = Extras { surface: Some(true), critical_radius: Some(7.5), ..Extras::default() };
    let ground = parts.add_shape("ground", whole, ground.collect());
    let smoke = Extras { merged: Some(true), ..Extras::default() };
    let glass = parts.add_shape("", smoke, pieces(sheet(3, 2.0, 2), 2, 0, Extras::default()).collect());
    let hut = parts.add_shape("hut", Extras::default(), pieces(sheet(4, 5.0, 1), 1, 0, Extras::default()).collect());

    let rotation = DQuat::from_rotation_y(0.5);
    let light = |kind| Some(LightSource { kind, intensity: [1.0, 2.0, 3.0] });
    let said = |entity, layer| Extras {
        entity,
        layer,
        cue: Some(true),
        is_static: Some(false),
        levels: Some(vec!["fine".into(), "coarse".into()]),
        ..Extras::default()
    };
    let node = |name: &str, parent: Option<u32>, shape| NodeSource {
        name: name.into(),
        parent,
        shape,
        local: DAffine3::from_rotation_translation(rotation, DVec3::new(1e6, 0.1, -3.0)),
        rotation,
        ..NodeSource::default()
    };
    parts.nodes = vec![
        node("world", None, None),
        NodeSource { extras: said(Some(1 << 40), None), ..node("ground", Some(0), ground) },
        NodeSource { light: light(LightKind::Directional), ..node("", Some(1), None) },
        NodeSource { levels: 2, extras: said(None, Some(-5)), ..node("hut", Some(0), None) },
        NodeSource { version: Some(0), ..node("fine", Some(3), hut) },
        NodeSource { version: Some(1), ..node("coarse", Some(3), hut) },
        node("glass", Some(0), glass),
        NodeSource { light: light(LightKind::Point { range: Some(20.0) }), ..node("ground", None, ground) },
        NodeSource {
            light: light(LightKind::Spot { range: None, inner_cos: 0.9, outer_cos: 0.8 }),
            ..node("lamp", Some(7), None)
        },
    ];
    parts.warnings = vec!["the first thing".into(), "das zweite, größere".into()];
    parts
}

/// The small scene's file.
fn small_file() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| bake(&small()))
}

/// A scene's file, in memory.
fn bake(parts: &Parts) -> Vec<u8> {
    let scene = Scene::assemble(parts.clone()).unwrap();
    super::write::to_bytes(parts, &scene).unwrap()
}

fn open(bytes: &[u8]) -> Result<Scene, BakedFault> {
    open_bytes(bytes.to_vec(), "city.baked").map_err(|error| {
        let text = error.to_string();
        assert!(text.starts_with("city.baked: ") && !text.contains('\n') && !text.ends_with('.'), "{text}");
        *error.fault
    })
}
