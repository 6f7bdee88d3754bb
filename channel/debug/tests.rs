//! Debug pictures of scenes of which it is known what they must say.

use crate::oracle::*;
use crate::picture_tests::{at_origin, distribution, wall};
use crate::pipeline::{DrawStats, Renderer, TilePictures};
use crate::store::SceneStore;
use glam::{DAffine3, DVec3};
use proto::debug::{DebugPicture, HIDDEN, NO_LEVELS, Rgb, Way, depth_color, level_color, way_color};
use proto::frame::FrameState;
use proto::ids::{BoardId, ModelId};
use proto::scene::{Alpha, Mesh, ModelPart, ModelRow};
use proto::share::{Part, shares};
use proto::view::{Mode, Samples, ViewSetup};
use std::collections::BTreeMap;
use std::num::NonZeroUsize;

fn debug_state(debug: DebugPicture) -> FrameState {
    FrameState { debug, ..state() }
}

fn colors(store: &SceneStore, debug: DebugPicture, size: u32, samples: Samples) -> Vec<Rgb> {
    draw(store, &debug_state(debug), &view(size, size, samples)).rgb
}

/// How many pixels have each colour.
fn census(pixels: &[Rgb]) -> BTreeMap<Rgb, usize> {
    let mut found = BTreeMap::new();
    pixels.iter().for_each(|color| *found.entry(*color).or_insert(0) += 1);
    found
}

fn glass(mut mesh: Mesh) -> Mesh {
    mesh.material.alpha = Alpha::Blend;
    mesh.material.base_color[3] = 0.5;
    mesh
}

/// A square in the middle of a view: half as high and wide.
fn square(distance: f64, color: [f32; 4]) -> Mesh {
    let d = distance * 0.5;
    mesh_of(&rectangle(DVec3::new(-d, -d, -distance), DVec3::X * 2.0 * d, DVec3::Y * 2.0 * d), color)
}

#[test]
fn depth_counts_every_face_whether_seen_or_hidden() {
    // Thirty walls, the nearest first, so that all shortcuts could be taken.
    let walls: Vec<Mesh> = (0..30).map(|k| wall(1.0 + f64::from(k), [1.0; 4])).collect();
    for samples in [Samples::One, Samples::Sixteen, Samples::Exact] {
        let pixels = colors(&at_origin(walls.clone()), DebugPicture::Depth, 64, samples);
        // A pixel on the diagonal may meet both triangles of each.
        let both = [depth_color(30), depth_color(60)];
        assert!(pixels.iter().all(|color| both.contains(color)), "{samples}: {:?}", census(&pixels));
        let on_diagonal = pixels.iter().filter(|color| **color == both[1]).count();
        assert!(on_diagonal <= if samples == Samples::One { 0 } else { 3 * 64 }, "{samples}: {on_diagonal}");
    }
    // Glass and what is behind it count alike; beside them is nothing.
    let store = at_origin(vec![glass(square(2.0, [1.0; 4])), square(4.0, [1.0; 4])]);
    let found = census(&colors(&store, DebugPicture::Depth, 64, Samples::One));
    assert_eq!(found, BTreeMap::from([(depth_color(0), 64 * 64 - 32 * 32), (depth_color(2), 32 * 32)]));
    // A surface that shows its back isn't there.
    let mut back = square(2.0, [1.0; 4]);
    back.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    back.material.double_sided = false;
    let found = census(&colors(&at_origin(vec![back]), DebugPicture::Depth, 64, Samples::One));
    assert_eq!(found, BTreeMap::from([(depth_color(0), 64 * 64)]));
}

/// Two versions of a square, of which the second is farther and of another colour, beside a wall that is no model.
fn model() -> SceneStore {
    let meshes = vec![square(2.0, [0.2, 0.2, 0.2, 1.0]), square(2.5, [0.8, 0.8, 0.8, 1.0]), wall(9.0, [1.0; 4])];
    let placed = meshes.into_iter().map(|mesh| (mesh, DAffine3::IDENTITY)).collect();
    store_with(placed, |table| {
        table.models = vec![ModelRow { merged: false, versions: 2 }];
        for version in 0..2 {
            table.subobjects[version].part_of = Some(ModelPart { model: ModelId(0), version: version as u32 });
        }
    })
}

/// A colour without its brightness: each channel to the largest.
fn hue(color: Rgb) -> [f64; 3] {
    let largest = f64::from(*color.iter().max().unwrap()).max(1.0);
    color.map(|c| f64::from(c) / largest)
}

fn is_hue(color: Rgb, [r, g, b]: [f64; 3]) -> bool {
    let largest = r.max(g).max(b);
    hue(color).iter().zip([r, g, b]).all(|(own, wanted)| (own - wanted / largest).abs() < 0.03)
}

#[test]
fn levels_tint_each_object_by_its_level_and_stripe_what_is_between() {
    let mut store = model();
    let look = |store: &SceneStore| {
        let picture = draw(store, &debug_state(DebugPicture::Levels), &view(64, 64, Samples::Four));
        (picture.rgb[32 * 64 + 20..32 * 64 + 28].to_vec(), picture.rgb[2 * 64 + 2])
    };
    let plain = |level: usize| level_color(level).map(f64::from);
    for level in 0..2 {
        let shown: &[f32] = if level == 0 { &[1.0, 0.0] } else { &[0.0, 1.0] };
        store.set_weights(&weights(&[(0, shown)])).unwrap();
        let (model, beside) = look(&store);
        assert!(model.iter().all(|color| is_hue(*color, plain(level)) && *color == model[0]), "{level}: {model:?}");
        assert!(is_hue(beside, NO_LEVELS.map(f64::from)), "{beside:?}");
    }
    store.set_weights(&weights(&[(0, &[0.25, 0.75])])).unwrap();
    let (model, beside) = look(&store);
    let mixed = std::array::from_fn(|c| 0.25 * plain(0)[c] + 0.75 * plain(1)[c]);
    assert!(model.iter().all(|color| is_hue(*color, mixed)), "{model:?} is not {mixed:?}");
    let brightest = model.iter().map(|color| color[1]).max().unwrap();
    let dark = model.iter().filter(|color| color[1] < brightest / 2).count();
    assert_eq!(dark, 2, "two of eight pixels of a row are a stripe: {model:?}");
    assert!(is_hue(beside, NO_LEVELS.map(f64::from)), "{beside:?}");
}

/// The debug picture of a store, and what drawing it counted.
fn skips(store: &SceneStore, size: u32, samples: Samples) -> (BTreeMap<Rgb, usize>, DrawStats) {
    let (state, view) = (debug_state(DebugPicture::Skips), view(size, size, samples));
    let mut out = TilePictures::new();
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let stats = renderer.draw(store, &state, &view, &everything(store), &Part::WHOLE, &mut out).unwrap();
    (census(out.rgb.as_chunks().0), stats)
}

#[test]
fn skips_say_how_each_block_and_pixel_was_drawn() {
    let (nothing, stats) = skips(&at_origin(vec![square(-1.0, [1.0; 4])]), 64, Samples::Four);
    assert_eq!(nothing, BTreeMap::from([(way_color(Way::Background), 64 * 64)]));
    assert_eq!(stats.pixels.pixels_single, 64 * 64);
    // The diagonal of the large wall isn't in view.
    let (d, z) = (400.0, -4.0);
    let large = mesh_of(&[[DVec3::new(-d, -d, z), DVec3::new(d, -d, z), DVec3::new(0.0, d, z)]], [1.0; 4]);
    let (constant, _) = skips(&at_origin(vec![large.clone()]), 64, Samples::Four);
    assert_eq!(constant, BTreeMap::from([(way_color(Way::Constant), 64 * 64)]));
    // Forty walls of two faces each are behind it: forty faces make a square of 3 × 3 pixels, both of each, in the eight blocks of the diagonal,
    // one of 4 × 4.
    let mut behind: Vec<Mesh> = (0..40).map(|k| wall(10.0 + f64::from(k), [1.0; 4])).collect();
    behind.insert(0, large.clone());
    let (hidden, _) = skips(&at_origin(behind), 64, Samples::Four);
    let marked = BTreeMap::from([(way_color(Way::Constant), 64 * 64 - 632), (HIDDEN, 56 * 9 + 8 * 16)]);
    assert_eq!(hidden, marked);
    let (layers, _) = skips(&at_origin(vec![glass(square(2.0, [1.0; 4])), large]), 64, Samples::Four);
    assert_eq!(layers[&way_color(Way::Layers)], 32 * 32);
    assert_eq!(layers[&way_color(Way::Constant)], 64 * 64 - 32 * 32);
}

#[test]
fn ways_of_pixels_are_what_the_resolve_counts() {
    // Only opaque faces, so that each pixel is shaded once or averaged; no faces hidden from the marks' squares.
    let mut random = Random(0x51C1);
    let faces: Vec<[DVec3; 3]> = (0..40)
        .map(|_| std::array::from_fn(|_| DVec3::new(random.signed() * 3.0, random.signed() * 3.0, -3.0)))
        .collect();
    let store = at_origin(vec![mesh_of(&faces, [1.0; 4])]);
    let (found, stats) = skips(&store, 96, Samples::Sixteen);
    let of = |way| found.get(&way_color(way)).copied().unwrap_or(0) as u64;
    let marks = found.get(&HIDDEN).copied().unwrap_or(0) as u64;
    let once = of(Way::Background) + of(Way::Constant) + of(Way::ByNormal) + of(Way::Single);
    let (single, multi) = (stats.pixels.pixels_single, stats.pixels.pixels_multi);
    assert!(of(Way::Several) > 500 && of(Way::Single) > 500 && of(Way::Layers) == 0, "{found:?}");
    assert!(once <= single && single <= once + marks, "{single} pixels shaded once: {found:?}");
    assert!(of(Way::Several) <= multi && multi <= of(Way::Several) + marks, "{multi} averaged: {found:?}");
}

#[test]
fn a_tile_like_that_of_the_frame_before_is_darkened_and_only_that() {
    let state = debug_state(DebugPicture::Skips);
    let view = view(128, 64, Samples::One);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut frame = |x: f64| {
        let mut store = at_origin(vec![square(4.0, [1.0; 4])]);
        let transform = DAffine3::from_translation(DVec3::X * x);
        store.set_moved(&[proto::frame::Moved { object: proto::ids::ObjectId(0), transform }]).unwrap();
        let mut out = TilePictures::with_linear();
        renderer.draw(&store, &state, &view, &everything(&store), &Part::WHOLE, &mut out).unwrap();
        out
    };
    let (first, mut second) = (frame(0.0), frame(1.0));
    let untouched = second.clone();
    second.darken_unchanged(&TilePictures::new());
    assert_eq!(second, untouched, "there was none before");
    second.darken_unchanged(&first);
    let mut darkened = 0;
    for k in 0..second.tiles.len() {
        let (was, is) = (untouched.tile(k), second.tile(k));
        if was != is {
            darkened += 1;
            assert!(was.iter().zip(is).all(|(was, is)| was / 2 == *is));
            let decoded = crate::resolve::colour::decode_srgb([is[0], is[1], is[2]]);
            assert_eq!(second.tile_linear(k).unwrap()[..3], decoded);
        }
    }
    // The square is in the two columns in the middle, and stays there.
    assert_eq!(darkened, 4, "the tiles of the outer columns");
}

#[test]
fn debug_pictures_are_the_same_for_any_threads_shares_and_lists() {
    let (mut store, plain) = distribution::everything_shown(|_| ());
    store.set_weights(&weights(&[(0, &[0.3, 0.7]), (2, &[0.5, 0.25, 0.25]), (3, &[0.6])])).unwrap();
    let list = everything(&store);
    let mut reversed = list.clone();
    reversed.reverse();
    let mut one = Renderer::new(NonZeroUsize::MIN).unwrap();
    let mut two = Renderer::new(NonZeroUsize::new(2).unwrap()).unwrap();
    for (debug, samples) in [
        (DebugPicture::Depth, Samples::Four),
        (DebugPicture::Levels, Samples::Sixteen),
        (DebugPicture::Skips, Samples::Eight),
        (DebugPicture::Skips, Samples::Exact),
    ] {
        let (state, view) = (FrameState { debug, ..plain }, view(150, 100, samples));
        let standard = draw_with(&mut one, &store, &state, &view, &list, &[Part::WHOLE]);
        assert!(census(&standard.rgb).len() > 2, "{debug:?}: a picture worth comparing");
        assert!(standard.rgb != draw_with(&mut one, &store, &plain, &view, &list, &[Part::WHOLE]).rgb);
        assert_eq!(draw_with(&mut two, &store, &state, &view, &reversed, &[Part::WHOLE]), standard, "{debug:?}");
        for (boards, mode) in [(3, Mode::Interleave), (5, Mode::Region)] {
            let setup = [ViewSetup { mode, ..ViewSetup::new(view) }];
            let weights = vec![1; boards];
            let parts: Vec<Part> =
                (0..boards as u32).flat_map(|b| shares(BoardId(b), &weights, &setup)).map(|s| s.part).collect();
            let picture = draw_with(&mut two, &store, &state, &view, &list, &parts);
            assert_eq!(picture, standard, "{debug:?}, {boards} boards, {mode:?}");
        }
    }
}
