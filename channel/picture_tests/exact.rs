//! `exact`: areas against closed forms, and the same bytes however the work is done.

use super::distribution::motley;
use super::*;
use crate::pipeline::Renderer;
use crate::simd::SimdLevel;
use proto::ids::{BoardId, SubobjectId};
use proto::share::{Part, shares};
use proto::view::{Mode, ViewSetup};
use std::num::NonZeroUsize;

/// A coordinate on the screen is right to half of 1/65 536 pixel.
const STEP: f64 = 1.0 / 65_536.0;

/// A rectangle of the screen at `distance`, pixels of a view of 16 × 16 from its upper left.
fn on_pixels([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], distance: f64, color: [f32; 4]) -> Mesh {
    let at = |x: f64, y: f64| DVec3::new(x / 8.0 - 1.0, 1.0 - y / 8.0, -1.0) * distance;
    let [a, b, c] = [at(x0, y1), at(x1, y1), at(x0, y0)];
    mesh_of(&rectangle(a, b - a, c - a), color)
}

fn exact() -> proto::view::View {
    view(16, 16, Samples::Exact)
}

#[test]
fn a_vertical_edge_has_its_area_wherever_it_is() {
    let mut random = Random(0xA4EA);
    for _ in 0..200 {
        let part = random.unit();
        let white = on_pixels([-99.0, 8.0 + part], [-99.0, 99.0], 1.0, [1.0; 4]);
        let picture = draw(&at_origin(vec![white]), &state(), &exact());
        assert!((f64::from(picture.at(8, 5)[0]) - part).abs() <= STEP, "{} for {part}", picture.at(8, 5)[0]);
        assert_eq!((picture.at(7, 5)[0], picture.at(9, 5)[0]), (1.0, 0.0), "{part}");
    }
}

#[test]
fn a_face_that_meets_no_sample_has_its_area() {
    // 1/1000 pixel wide and as high as the view; and a speck of a thousandth by a thousandth.
    let line = on_pixels([5.5, 5.501], [-99.0, 99.0], 1.0, [1.0; 4]);
    let picture = draw(&at_origin(vec![line]), &state(), &exact());
    assert!((f64::from(picture.at(5, 9)[0]) - 0.001).abs() <= 2.0 * STEP, "{:?}", picture.at(5, 9));
    let speck = on_pixels([5.5, 5.501], [7.25, 7.251], 1.0, [1000.0, 1000.0, 1000.0, 1.0]);
    let picture = draw(&at_origin(vec![speck]), &state(), &exact());
    assert_near(picture.at(5, 7), [0.001; 3], 1000.0 * 0.001 * 3.0 * STEP);
    assert_eq!(
        draw(
            &at_origin(vec![on_pixels([5.5, 5.501], [7.25, 7.251], 1.0, [1.0; 4])]),
            &state(),
            &view(16, 16, Samples::SixtyFour)
        )
        .at(5, 7),
        [0.0; 3]
    );
}

#[test]
fn a_thin_face_is_seen_from_its_front_only() {
    for width in [0.4, 0.01, 0.001, 0.0001] {
        for from in [3.0, 3.3, 3.501] {
            let front = on_pixels([from, from + width], [2.0, 13.0], 2.0, [1.0; 4]);
            let mut back = front.clone();
            back.triangles.iter_mut().for_each(|t| t.swap(1, 2));
            let seen = |mesh: Mesh| draw(&at_origin(vec![mesh]), &state(), &exact()).at(3, 6)[0];
            assert!((f64::from(seen(front)) - width).abs() <= 2.0 * STEP, "{width} from {from}");
            assert_eq!(seen(back), 0.0, "{width} from {from}, from behind");
        }
    }
}

#[test]
fn layers_are_weighed_by_area() {
    // Glass over the left of the pixel, before a wall that has the upper half of it.
    let (x, y) = (0.37, 0.21);
    let glass = on_pixels([-99.0, 8.0 + x], [-99.0, 99.0], 1.0, [0.0, 1.0, 0.0, 0.25]);
    let wall = on_pixels([-99.0, 99.0], [-99.0, 8.0 + y], 2.0, [1.0, 0.0, 0.0, 1.0]);
    let mut state = state();
    state.environment.background = proto::frame::Background::Constant([0.0, 0.0, 1.0]);
    let picture = draw(&at_origin(vec![wall, glass]), &state, &exact());
    let clear = 1.0 - 0.25 * x;
    assert_near(picture.at(8, 8), [y * clear, 0.25 * x, (1.0 - y) * clear], 4.0 * STEP);
}

#[test]
fn surfaces_that_cross_share_a_pixel_along_their_line() {
    // Two planes through the vertical line x = 8.3 pixels at distance 4: one nearer to the left, the other to the right.
    let line = (8.3 / 8.0 - 1.0) * 4.0;
    let tilted = |slope: f64, color: [f32; 4]| {
        let along = DVec3::new(1.0, 0.0, slope);
        let middle = DVec3::new(line, 0.0, -4.0);
        mesh_of(&rectangle(middle - along * 5.0 - DVec3::Y * 9.0, along * 10.0, DVec3::Y * 18.0), color)
    };
    let crossing = vec![tilted(0.5, [1.0, 0.0, 0.0, 1.0]), tilted(-0.5, [0.0, 1.0, 0.0, 1.0])];
    let picture = draw(&at_origin(crossing), &state(), &exact());
    assert_near(picture.at(8, 4), [0.7, 0.3, 0.0], 1e-4);
}

#[test]
fn a_mesh_of_slivers_leaves_no_gap_and_hides_what_is_behind() {
    // A fan of blades thinner than a sub-pixel, opaque, whose pieces must add up to the whole.
    for blades in [7, 300, 1000] {
        let corner = |k: usize| {
            let (angle, radius) = (std::f64::consts::TAU * k as f64 / blades as f64, 0.7);
            DVec3::new(libm::cos(angle) * radius + 0.013, libm::sin(angle) * radius - 0.021, -1.0)
        };
        let hub = DVec3::new(0.113, 0.0571, -1.0);
        let fan: Vec<[DVec3; 3]> = (0..blades).map(|k| [hub, corner(k), corner((k + 1) % blades)]).collect();
        let behind = wall(3.0, [0.0, 1.0, 0.0, 1.0]);
        let picture = draw(&at_origin(vec![behind, mesh_of(&fan, [1.0; 4])]), &state(), &exact());
        for (x, y) in [(8, 7), (8, 8), (7, 7), (9, 7), (6, 9), (5, 8)] {
            assert_near(picture.at(x, y), [1.0; 3], 1e-5);
        }
        let area: f64 = picture.linear.iter().map(|c| f64::from(c[0])).sum();
        let of_polygon = 0.5 * 0.49 * 64.0 * blades as f64 * libm::sin(std::f64::consts::TAU / blades as f64);
        assert!((area - of_polygon).abs() < 1e-3, "{blades} blades: {area} instead of {of_polygon}");
    }
}

#[test]
fn bytes_are_the_same_for_any_threads_shares_lists_and_instruction_sets() {
    let (store, state) = motley(|_| ());
    same_bytes(&store, &state, 100);
    let state = proto::frame::FrameState {
        environment: proto::frame::Environment { visibility_m: None, ..state.environment },
        ..state
    };
    same_bytes(&store, &state, 100);
    same_bytes(&layers(), &state, 1000);
}

/// Crossing layers and faces of every size.
fn layers() -> SceneStore {
    let mut random = Random(0x1A7E);
    let meshes = (0..40).map(|k| {
        let size = [0.1, 1.0, 5.0][k % 3];
        let centre = DVec3::new(random.signed() * 4.0, random.signed() * 3.0, -2.0 - random.unit() * 6.0);
        let faces: Vec<[DVec3; 3]> = (0..10)
            .map(|_| [0; 3].map(|_| centre + DVec3::new(random.signed(), random.signed(), random.signed()) * size))
            .collect();
        let alpha = if k % 2 == 0 { 1.0 } else { 0.5 };
        let mut mesh = mesh_of(&faces, [random.unit() as f32, random.unit() as f32, random.unit() as f32, alpha]);
        mesh.material.double_sided = true;
        mesh
    });
    at_origin(meshes.collect())
}

/// Draws a scene in many ways; at least that many of its pixels aren't those of 64 points.
fn same_bytes(store: &SceneStore, state: &proto::frame::FrameState, integrated: usize) {
    let list = everything(store);
    let mut reversed = list.clone();
    reversed.reverse();
    let mut shuffled: Vec<SubobjectId> = list.clone();
    let mut random = Random(5);
    for i in (1..shuffled.len()).rev() {
        shuffled.swap(i, random.below(i as u64 + 1) as usize);
    }
    let mut renderers = [1, 2].map(|n| Renderer::new(NonZeroUsize::new(n).unwrap()).unwrap());
    let view = view(150, 100, Samples::Exact);
    let standard = draw_with(&mut renderers[0], store, state, &view, &list, &[Part::WHOLE]);
    let points = proto::view::View { samples: Samples::SixtyFour, ..view };
    let points = draw_with(&mut renderers[0], store, state, &points, &list, &[Part::WHOLE]);
    let unlike = standard.linear.iter().zip(&points.linear).filter(|(a, b)| a != b).count();
    assert!(unlike > integrated, "{unlike} pixels differ from those of 64 points");
    let far = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).any(|c| (a[c] - b[c]).abs() > 0.1);
    let far = standard.linear.iter().zip(&points.linear).filter(|pair| far(*pair)).count();
    assert!(far < 50, "{far} pixels are far from those of 64 points");
    for list in [&reversed, &shuffled] {
        let picture = draw_with(&mut renderers[1], store, state, &view, list, &[Part::WHOLE]);
        assert!(picture == standard, "another order");
    }
    for (boards, mode) in [(2, Mode::Interleave), (5, Mode::Region)] {
        let setup = [ViewSetup { mode, ..ViewSetup::new(view) }];
        let parts: Vec<Part> =
            (0..boards as u32).flat_map(|b| shares(BoardId(b), &vec![1; boards], &setup)).map(|s| s.part).collect();
        let picture = draw_with(&mut renderers[1], store, state, &view, &shuffled, &parts);
        assert!(picture == standard, "{boards} boards, {mode:?}");
    }
    for level in SimdLevel::all() {
        renderers[1].set_simd(level);
        let picture = draw_with(&mut renderers[1], store, state, &view, &list, &[Part::WHOLE]);
        assert!(picture == standard, "{level:?}");
    }
}
