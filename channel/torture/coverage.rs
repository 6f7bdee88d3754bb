//! Coverage of whole pictures against exact arithmetic, for faces of every magnitude.

use super::{mesh_of_face, random_vector, report, snapped};
use crate::geometry::camera::Camera;
use crate::geometry::clip::outside;
use crate::oracle::*;
use crate::picture_tests::ALL_SAMPLES;
use crate::samples::Pattern;
use glam::{DAffine3, DVec3};
use proptest::prelude::*;
use proto::view::View;
use std::cell::RefCell;

/// What a test counted.
#[derive(Debug, Default)]
struct Tally {
    whole: u64,
    cut: u64,
    samples: u64,
    near_an_edge: u64,
    covered: u64,
}

/// The number of covered samples of a pixel of a white face on black.
fn drawn_samples(picture: &Picture, pixel: usize, count: usize) -> usize {
    (picture.linear[pixel][0] * count as f32).round() as usize
}

/// Whether the ray through a sub-pixel position hits the face of these corners (eye's frame) beyond the near plane, by the signs of three
/// determinants: no vertex is projected, rounded or cut. `None` within 1/128 pixel of an edge, or of where the near plane cuts.
fn hit_by_ray(view: &View, corners: [DVec3; 3], x: f64, y: f64) -> Option<bool> {
    let t = view.tangents;
    let step = [(t.right - t.left) / f64::from(view.width), (t.top - t.bottom) / f64::from(view.height)];
    let ray = DVec3::new(t.left + x * step[0], t.top - y * step[1], -1.0);
    let [a, b, c] = corners;
    let edges = [b.cross(c), c.cross(a), a.cross(b)];
    // Rounding of the determinants' products, and 1/128 pixel; of the near plane's line likewise.
    let reach = |n: DVec3| (n.x.abs() * step[0] + n.y.abs() * step[1]) / 128.0;
    let mut inside = [true; 2];
    for (n, [p, q]) in edges.into_iter().zip([[b, c], [c, a], [a, b]]) {
        let side = n.dot(ray);
        if side.abs() <= reach(n) + 1e-13 * p.length() * q.length() * ray.length() {
            return None;
        }
        inside[0] &= side > 0.0;
        inside[1] &= side < 0.0;
    }
    if !inside[0] && !inside[1] {
        return Some(false);
    }
    // 1/w = (n · ray) / d; compared with 1/near without the division.
    let sum = edges[0] + edges[1] + edges[2];
    let volume = a.dot(edges[0]);
    let (inverse, near) = (sum.dot(ray) * view.near, volume);
    let scale = 1e-12 * (a.length() * b.length() * c.length() + sum.length() * view.near);
    if (inverse.abs() - near.abs()).abs() <= reach(sum) * view.near + scale {
        return None;
    }
    // In front of the eye, and 1/w no more than 1/near.
    Some(inverse * near > 0.0 && inverse.abs() < near.abs())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    /// Sizes and distances from 1e-9 to 1e9 m, with a near plane in proportion to the one or the other.
    #[test]
    fn random_triangles_of_every_magnitude(
        seed in 1u64..,
        distance_log in -9.0f64..9.0,
        size_log in -9.0f64..9.0,
        near_log in -3.0f64..0.5,
        pattern in 0usize..5,
    ) {
        thread_local! { static TALLY: RefCell<Tally> = RefCell::default(); }
        let mut random = Random(seed);
        let power = |log: f64| libm::exp2(log * std::f64::consts::LOG2_10);
        let (distance, size) = (power(distance_log), power(size_log));
        let view = View { near: distance * power(near_log), ..view(24, 18, ALL_SAMPLES[pattern]) };
        let centre = DVec3::new(random.signed() * distance, random.signed() * distance, -distance);
        // Sometimes of the size that a view can show, mostly of any.
        let size = if seed % 3 == 0 { distance * [1e-2, 1.0, 30.0][(seed / 3 % 3) as usize] } else { size };
        let corners = std::array::from_fn(|_| snapped(centre + random_vector(&mut random) * size));
        let face = OracleFace { corners, color: [1.0; 4] };
        let picture = draw(&store_of(vec![(mesh_of_face(&face), DAffine3::IDENTITY)]), &state(), &view);

        let state = state();
        let camera = Camera::new(&state, &view);
        let is_cut = corners.iter().any(|c| outside(&camera, camera.view_point(*c)) != 0);
        let screen = (!is_cut).then(|| corners.map(|c| on_screen(&view, c)));
        let pattern = Pattern::of(view.samples);
        let mut tally = TALLY.take();
        *(if is_cut { &mut tally.cut } else { &mut tally.whole }) += 1;
        for pixel in 0..24 * 18 {
            let drawn = drawn_samples(&picture, pixel, pattern.count);
            let (mut least, mut most) = (0, 0);
            for [dx, dy] in &pattern.points[..pattern.count] {
                let at = [(pixel % 24) as i32 * 256 + dx, (pixel / 24) as i32 * 256 + dy];
                let hit = match screen {
                    Some(corners) => Some(point_in_triangle(corners, at.map(i128::from))),
                    None => hit_by_ray(&view, corners, f64::from(at[0]) / 256.0, f64::from(at[1]) / 256.0),
                };
                least += usize::from(hit == Some(true));
                most += usize::from(hit != Some(false));
            }
            tally.samples += pattern.count as u64;
            tally.near_an_edge += (most - least) as u64;
            tally.covered += drawn as u64;
            prop_assert!((least..=most).contains(&drawn), "pixel {pixel}: {drawn} of {least} to {most}, {corners:?}, cut: {is_cut}");
        }
        let rounds = tally.whole + tally.cut;
        if rounds == 1500 {
            let Tally { whole, cut, samples, near_an_edge, covered } = tally;
            report(
                "random triangles, 1e-9 to 1e9 m",
                "whole: exact to the sample; cut: wherever 1/128 pixel from an edge",
                &format!("{whole} whole, {cut} cut, {samples} samples ({covered} covered, {near_an_edge} too near an edge to tell): 0 wrong"),
            );
            prop_assert!(covered > 100_000 && whole > 100 && cut > 100);
        }
        TALLY.set(tally);
    }
}
