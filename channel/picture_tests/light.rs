//! The lights of a scene's file against the formulas of `KHR_lights_punctual`.

use super::{assert_near, wall};
use crate::oracle::*;
use crate::store::{SceneStore, StoreError};
use glam::{DAffine3, DVec3};
use proto::scene::{LightKind, LightRow, Mesh};
use proto::view::Samples;

/// A lit white wall at 2 m.
fn screen() -> Mesh {
    let mut mesh = wall(2.0, [1.0, 0.5, 0.25, 1.0]);
    mesh.material.unlit = false;
    mesh
}

fn lit_by(mesh: Mesh, lights: &[LightRow]) -> SceneStore {
    store_with(vec![(mesh, DAffine3::IDENTITY)], |table| table.lights = lights.to_vec())
}

/// Draws with ambient 0.25 and no sun.
fn drawn(store: &SceneStore, asked_for: bool) -> Picture {
    let mut state = state();
    state.environment.ambient = 0.25;
    state.environment.sun = 0.0;
    state.environment.scene_lights = asked_for;
    draw(store, &state, &view(33, 33, Samples::One))
}

#[test]
fn lights_of_the_file_shine_when_they_are_asked_for() {
    let at = DVec3::new(0.5, 0.25, -1.0);
    let point = LightRow {
        kind: LightKind::Point { range: None },
        intensity: [1.0, 2.0, 3.0],
        position: at,
        direction: DVec3::ZERO,
    };
    let aim = DVec3::new(0.0, 0.1, -1.0).normalize();
    let (inner, outer) = (0.95f32, 0.6f32);
    let spot = LightKind::Spot { range: Some(1.75), inner_cos: inner, outer_cos: outer };
    let spot = LightRow { kind: spot, direction: aim, ..point };
    let ranged = LightRow { kind: LightKind::Point { range: Some(1.5) }, ..point };
    let slanted = DVec3::new(0.0, 0.6, -0.8);
    let sun = LightRow { kind: LightKind::Directional, direction: slanted, ..point };
    let factor = |kind: usize, p: DVec3| -> f64 {
        let towards = at - p;
        let d = towards.length();
        let cos = towards.z / d;
        let window = |range: f64| {
            let part = d / range;
            (1.0 - part * part * part * part).clamp(0.0, 1.0)
        };
        let cone = ((-towards / d).dot(aim) - f64::from(outer)) / f64::from(inner - outer);
        let cone = cone.clamp(0.0, 1.0);
        [cos / (d * d), cos / (d * d) * window(1.75) * cone * cone, cos / (d * d) * window(1.5), 0.8][kind]
    };
    let lights = [point, spot, ranged, sun];
    let mut unlike = std::collections::BTreeSet::new();
    for (kind, light) in lights.iter().enumerate() {
        let store = lit_by(screen(), &[*light]);
        let picture = drawn(&store, true);
        for (x, y) in [(16, 16), (20, 12), (3, 30), (31, 2), (24, 14)] {
            let p = DVec3::new((x as f64 + 0.5) / 16.5 - 1.0, 1.0 - (y as f64 + 0.5) / 16.5, -1.0) * 2.0;
            let l = factor(kind, p);
            let expected = [0.25 + l, 0.5 * (0.25 + 2.0 * l), 0.25 * (0.25 + 3.0 * l)];
            assert_near(picture.at(x, y), expected, 1e-5);
            unlike.insert(picture.at(x, y)[0].to_bits());
        }
        assert_eq!(drawn(&store, false).at(5, 7), [0.25, 0.125, 0.0625], "not asked for");
    }
    assert!(unlike.len() > 12, "lights fall off and end");
    // Together they add up; unlit surfaces don't notice.
    let all = drawn(&lit_by(screen(), &lights), true).at(20, 12);
    let p = DVec3::new(20.5 / 16.5 - 1.0, 1.0 - 12.5 / 16.5, -1.0) * 2.0;
    let sum: f64 = (0..4).map(|kind| factor(kind, p)).sum();
    assert_near(all, [0.25 + sum, 0.5 * (0.25 + 2.0 * sum), 0.25 * (0.25 + 3.0 * sum)], 1e-5);
    assert_eq!(drawn(&lit_by(wall(2.0, [1.0; 4]), &lights), true).at(20, 12), [1.0; 3]);
}

#[test]
fn a_light_behind_a_surface_or_on_it_adds_nothing() {
    for position in [DVec3::new(0.0, 0.0, -3.0), DVec3::new(0.0, 0.0, -2.0)] {
        let kind = LightKind::Point { range: None };
        let light = LightRow { kind, intensity: [1e30; 3], position, direction: DVec3::ZERO };
        assert_eq!(drawn(&lit_by(screen(), &[light]), true).at(16, 16), [0.25, 0.125, 0.0625]);
    }
}

#[test]
fn lights_that_cannot_be_computed_with_are_refused() {
    let light = LightRow {
        kind: LightKind::Point { range: None },
        intensity: [1.0; 3],
        position: DVec3::ZERO,
        direction: DVec3::NEG_Z,
    };
    let spot = |inner_cos| LightKind::Spot { range: None, inner_cos, outer_cos: 0.5 };
    let bad = [
        LightRow { intensity: [f32::NAN, 0.0, 0.0], ..light },
        LightRow { position: DVec3::INFINITY, ..light },
        LightRow { direction: DVec3::NAN, ..light },
        LightRow { kind: LightKind::Point { range: Some(0.0) }, ..light },
        LightRow { kind: spot(f32::NAN), ..light },
    ];
    for row in bad {
        let mut table = place(&[(content(0), DAffine3::IDENTITY)]);
        table.lights = vec![light, row];
        assert_eq!(SceneStore::new().set_table(table), Err(StoreError::Light { light: 1 }), "{row:?}");
    }
}
