//! What is left out changes no picture, in any order of the list and any share of the tiles.

use super::ALL_SAMPLES;
use crate::oracle::*;
use crate::pipeline::{Renderer, Skips, TilePictures};
use crate::store::SceneStore;
use glam::{DAffine3, DQuat, DVec3};
use proto::ids::{BoardId, SubobjectId};
use proto::scene::{Alpha, Mesh};
use proto::share::{Part, shares};
use proto::view::{Mode, ViewSetup};
use std::num::NonZeroUsize;

/// A closed box of twelve faces and a few beside them.
fn crate_of(size: DVec3, color: [f32; 4]) -> Mesh {
    let [x, y, z] = [DVec3::X * size.x, DVec3::Y * size.y, DVec3::Z * size.z];
    let low = -(x + y + z) / 2.0;
    let sides = [(low, y, x), (low, z, y), (low, x, z), (low + z, x, y), (low + x, y, z), (low + y, z, x)];
    let faces: Vec<_> = sides.into_iter().flat_map(|(at, u, v)| rectangle(at, u, v)).collect();
    mesh_of(&faces, color)
}

/// Boxes of all sizes about the line of sight: some fill the view, some are behind these, some touch or cross them.
fn scene(random: &mut Random) -> SceneStore {
    let mut placed = Vec::new();
    for k in 0..40 {
        let distance = 2.0 + random.unit() * 60.0;
        let reach = [0.3, 0.05, 1.5][random.below(3) as usize] * distance;
        let mut unit = || 0.2 + random.unit();
        let size = DVec3::new(unit(), unit(), unit()) * reach;
        let mut mesh = crate_of(size, [random.unit() as f32, random.unit() as f32, random.unit() as f32, 1.0]);
        mesh.material.double_sided = k % 4 == 0;
        match k % 9 {
            3 => {
                mesh.material.alpha = Alpha::Blend;
                mesh.material.base_color[3] = 0.5;
            }
            5 => mesh.material.alpha = Alpha::Mask { cutoff: 0.5 },
            7 => {
                mesh.material.alpha = Alpha::Mask { cutoff: 0.5 };
                mesh.material.base_color[3] = 0.1;
            }
            _ => {}
        }
        let turn = if k % 2 == 0 { DQuat::IDENTITY } else { DQuat::from_rotation_y(random.signed() * 0.8) };
        let at = DVec3::new(random.signed() * 0.4, random.signed() * 0.3, -1.0) * distance;
        placed.push((mesh, DAffine3::from_rotation_translation(turn, at)));
    }
    placed.sort_by(|a, b| b.1.translation.z.total_cmp(&a.1.translation.z));
    store_of(placed)
}

/// All skips, then all but one of each.
fn choices() -> [Skips; 6] {
    let all = Skips::default();
    [
        all,
        Skips { hidden: false, ..all },
        Skips { back_faces: false, ..all },
        Skips { occluded: false, ..all },
        Skips { single: false, ..all },
        Skips { opaque_tiles: false, ..all },
    ]
}

#[test]
fn no_picture_depends_on_what_is_skipped() {
    let mut random = Random(0xB0C5);
    let (mut hidden, mut back_faces, mut occluded) = (0, 0, 0);
    for round in 0..60 {
        let store = scene(&mut random);
        let mut state = state();
        state.environment.visibility_m = (round % 4 == 1).then_some(40.0);
        let view = view(200, 136, ALL_SAMPLES[round % 5]);
        let mut list = everything(&store);
        if round % 3 == 2 {
            list.reverse();
        }
        let mode = if round % 2 == 0 { Mode::Interleave } else { Mode::Region };
        let setup = [ViewSetup { mode, ..ViewSetup::new(view) }];
        let parts: Vec<Part> = if round % 3 == 0 {
            vec![Part::WHOLE]
        } else {
            (0..3).flat_map(|board| shares(BoardId(board), &[1; 3], &setup)).map(|share| share.part).collect()
        };
        let mut first = None;
        for skips in choices() {
            let mut renderer = Renderer::new(NonZeroUsize::new(1 + round % 2).unwrap()).unwrap();
            renderer.set_skips(skips);
            let mut out = TilePictures::new();
            for part in &parts {
                let stats = renderer.draw(&store, &state, &view, &list, part, &mut out).unwrap();
                assert!(skips.hidden || stats.geometry.hidden_subobjects == 0);
                assert!(skips.back_faces || stats.geometry.backface == 0);
                assert!(skips.occluded || stats.opaque.occluded == 0);
                hidden += stats.geometry.hidden_subobjects;
                occluded += stats.opaque.occluded;
                back_faces += stats.geometry.backface;
            }
            let picture = draw_with(&mut renderer, &store, &state, &view, &list, &parts);
            assert!(picture == *first.get_or_insert_with(|| picture.clone()), "round {round}: {skips:?}");
        }
    }
    assert!(back_faces > 500, "{back_faces} back faces were left out");
    assert!(hidden > 500, "{hidden} subobjects were left out");
    assert!(occluded > 500, "{occluded} triangles were left out");
}

/// Frames differ in what boards and threads leave out, so pictures alone wouldn't show that bins have become useless.
#[test]
fn triangles_behind_a_wall_enter_no_tile_that_it_covers() {
    let wall = crate_of(DVec3::new(400.0, 400.0, 1.0), [1.0; 4]);
    let mut placed = vec![(wall, DAffine3::from_translation(DVec3::new(100.0, 30.0, -20.0)))];
    let behind = mesh_of(&rectangle(DVec3::new(-50.0, -50.0, -30.0), DVec3::X * 100.0, DVec3::Y * 100.0), [0.5; 4]);
    placed.push((behind, DAffine3::IDENTITY));
    let store = store_of(placed);
    let view = view(128, 128, ALL_SAMPLES[2]);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut out = TilePictures::new();
    let stats = renderer.draw(&store, &state(), &view, &everything(&store), &Part::WHOLE, &mut out).unwrap();
    let tiles = stats.tiles;
    assert!(stats.opaque.pairs < tiles * 2, "{} triangles in {tiles} tiles", stats.opaque.pairs);
    assert!(stats.opaque.occluded >= tiles, "{} triangles left out of {tiles} tiles", stats.opaque.occluded);
}

#[test]
fn a_wall_hides_the_boxes_behind_it_and_not_those_in_front() {
    // Its diagonal is beside the view: a tile that two triangles share is covered by neither.
    let wall = crate_of(DVec3::new(400.0, 400.0, 1.0), [1.0; 4]);
    let cube = |z: f64| (crate_of(DVec3::ONE, [0.5, 0.1, 0.1, 1.0]), DAffine3::from_translation(DVec3::NEG_Z * z));
    let mut placed: Vec<_> = (0..200).map(|k| cube(10.0 + f64::from(k) * 0.001)).collect();
    placed.push((wall, DAffine3::from_translation(DVec3::new(100.0, 30.0, -20.0))));
    placed.extend((0..200).map(|_| cube(30.0)));
    let store = store_of(placed);
    let view = view(128, 128, ALL_SAMPLES[2]);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut hidden = |list: &[SubobjectId]| {
        let mut out = TilePictures::new();
        renderer.draw(&store, &state(), &view, list, &Part::WHOLE, &mut out).unwrap().geometry.hidden_subobjects
    };
    let list = everything(&store);
    // Those in the wall's own run are asked before it is in the tiles.
    let behind = hidden(&list);
    assert!((100..=200).contains(&behind), "{behind} of the 200 behind");
    assert_eq!(hidden(&list[..201]), 0, "nothing is behind those in front");
}
