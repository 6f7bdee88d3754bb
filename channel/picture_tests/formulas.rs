//! Whole pictures against formulas and the brute-force sampler.

use super::{ALL_SAMPLES, assert_near, at_origin, checker, near, wall};
use crate::oracle::*;
use crate::pipeline::Renderer;
use crate::samples::Pattern;
use glam::{DAffine3, DMat3, DQuat, DVec3};
use proto::frame::{Background, Environment};
use proto::ids::SubobjectId;
use proto::scene::{Alpha, Filter, Mesh};
use proto::share::Part;
use proto::view::{Pose, Samples};
use std::num::NonZeroUsize;

#[test]
fn a_vertical_edge_is_seen_in_as_many_steps_as_samples() {
    for samples in ALL_SAMPLES {
        let n = samples.count() as i32;
        for k in 0..=n {
            // White to the left of x = 8 + k/n pixels, in a view of 16 pixels and tangents ±1.
            let x = f64::from(k) / f64::from(n) / 8.0;
            let white =
                mesh_of(&rectangle(DVec3::new(-9.0, -9.0, -1.0), DVec3::X * (9.0 + x), DVec3::Y * 18.0), [1.0; 4]);
            let picture = draw(&at_origin(vec![white]), &state(), &view(16, 16, samples));
            // With one sample the pixel flips when the edge passes its centre; k/n = 1 has passed it.
            assert_eq!(picture.at(8, 5)[0], k as f32 / n as f32, "{samples:?}, step {k}");
            assert_eq!((picture.at(7, 5)[0], picture.at(9, 5)[0]), (1.0, 0.0), "{samples:?}, step {k}");
        }
    }
}

#[test]
fn a_slanted_edges_coverage_approaches_the_area() {
    let mut random = Random(7);
    let mut errors = Vec::new();
    for samples in ALL_SAMPLES {
        let mut square_sum = 0.0;
        let mut pixels = 0.0;
        for _ in 0..12 {
            // A half-plane n · (x, y) ≤ d, in pixels of a 16 × 16 view: a rectangle that reaches far beyond.
            let angle = random.unit() * 7.0;
            let normal = DVec3::new(libm::cos(angle), libm::sin(angle), 0.0);
            let on_edge = DVec3::new(random.signed(), random.signed(), 0.0) * 0.2;
            let along = DVec3::new(-normal.y, normal.x, 0.0);
            let start = on_edge - along * 9.0 - normal * 9.0 - DVec3::Z;
            let half = mesh_of(&rectangle(start, normal * 9.0, along * 18.0), [1.0; 4]);
            let picture = draw(&at_origin(vec![half]), &state(), &view(16, 16, samples));
            for y in 0..16 {
                for x in 0..16 {
                    // The area by 64 × 64 points on a regular grid.
                    let inside = (0..4096).filter(|i| {
                        let (px, py) =
                            (x as f64 + (f64::from(i % 64) + 0.5) / 64.0, y as f64 + (f64::from(i / 64) + 0.5) / 64.0);
                        (DVec3::new(px / 8.0 - 1.0, 1.0 - py / 8.0, 0.0) - on_edge).dot(normal) <= 0.0
                    });
                    let area = inside.count() as f64 / 4096.0;
                    if area > 0.0 && area < 1.0 {
                        let error = f64::from(picture.at(x, y)[0]) - area;
                        square_sum += error * error;
                        pixels += 1.0;
                    } else {
                        assert_eq!(f64::from(picture.at(x, y)[0]), area, "no edge at ({x}, {y})");
                    }
                }
            }
        }
        errors.push(f64::sqrt(square_sum / pixels));
    }
    assert!(errors.is_sorted_by(|a, b| a > b), "more samples, less error: {errors:?}");
    assert!(errors[4] < 0.02, "64 samples: {errors:?}");
}

#[test]
fn random_scenes_equal_the_brute_force_sampler() {
    let mut random = Random(0xC1C1);
    for round in 0..60 {
        let samples = ALL_SAMPLES[round % 5];
        let view = view(48, 40, samples);
        let mut faces = Vec::new();
        for _ in 0..1 + random.below(30) {
            // From sub-pixel crumbs to faces far larger than the view.
            let size = [0.02, 0.3, 2.0, 30.0][random.below(4) as usize];
            let centre = DVec3::new(random.signed() * 3.0, random.signed() * 3.0, -0.5 - random.unit() * 4.0);
            let corner = |random: &mut Random| {
                let p = centre + DVec3::new(random.signed(), random.signed(), random.signed()) * size;
                DVec3::new(p.x, p.y, -p.z.abs().max(0.2)).as_vec3().as_dvec3()
            };
            let corners = [corner(&mut random), corner(&mut random), corner(&mut random)];
            let alpha = if random.below(2) == 0 { 1.0 } else { 0.25 + 0.5 * random.unit() as f32 };
            let color = [random.unit() as f32, random.unit() as f32, random.unit() as f32, alpha];
            faces.push(OracleFace { corners, color });
        }
        let meshes = faces.iter().map(|f| {
            let mut mesh = mesh_of(&[f.corners], f.color);
            mesh.material.double_sided = true;
            mesh
        });
        let picture = draw(&at_origin(meshes.collect()), &state(), &view);
        let expected = sample_by_force(&view, &faces);
        for (i, (drawn, expected)) in picture.linear.iter().zip(&expected).enumerate() {
            assert!(near(*drawn, *expected, 1e-5), "round {round}, pixel {i}: {drawn:?} is not {expected:?}");
        }
    }
}

#[test]
fn panes_over_panes_are_the_front_to_back_formula() {
    let panes: [(f64, [f32; 4]); 4] = [
        (2.0, [0.9, 0.1, 0.1, 0.5]),
        (4.0, [0.1, 0.9, 0.1, 0.25]),
        (1.0, [0.1, 0.1, 0.9, 0.125]),
        (8.0, [0.5, 0.6, 0.7, 1.0]),
    ];
    let mut sorted = panes;
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut expected, mut through) = ([0.0; 3], 1.0);
    for (_, c) in sorted {
        for k in 0..3 {
            expected[k] += f64::from(c[k]) * f64::from(c[3]) * through;
        }
        through *= 1.0 - f64::from(c[3]);
    }
    for samples in ALL_SAMPLES {
        let scene = at_origin(panes.iter().map(|(d, c)| wall(*d, *c)).collect());
        let picture = draw(&scene, &state(), &view(40, 40, samples));
        for pixel in picture.linear {
            assert_near(pixel, expected, 1e-6);
        }
    }
}

#[test]
fn a_thousand_layers_in_any_order_lose_none() {
    let mut random = Random(5);
    let mut order: Vec<u32> = (0..1000).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, random.below(i as u64 + 1) as usize);
    }
    let depth = |k: u32| 2.0 + f64::from(k) * 0.01;
    let meshes =
        order.iter().map(|k| wall(depth(*k), [f32::from(k % 2 == 0), 0.5, f32::from(k % 3 == 0), 0.01])).collect();
    let picture = draw(&at_origin(meshes), &state(), &view(8, 8, Samples::Four));
    let (mut expected, mut through) = ([0.0; 3], 1.0);
    for k in 0..1000 {
        let c = [f64::from(k % 2 == 0), 0.5, f64::from(k % 3 == 0)];
        for i in 0..3 {
            expected[i] += c[i] * f64::from(0.01f32) * through;
        }
        through *= 1.0 - f64::from(0.01f32);
    }
    for pixel in picture.linear {
        assert_near(pixel, expected, 1e-6);
    }
}

#[test]
fn alpha_zero_contributes_nothing_and_alpha_one_hides() {
    let mut glass = wall(1.0, [1.0, 1.0, 1.0, 0.0]);
    let behind = wall(2.0, [0.25, 0.5, 0.75, 1.0]);
    let picture = draw(&at_origin(vec![behind.clone(), glass.clone()]), &state(), &view(8, 8, Samples::Four));
    assert_eq!(picture.at(3, 3), [0.25, 0.5, 0.75]);
    glass.material.base_color = [0.1, 0.2, 0.3, 1.0];
    let picture = draw(&at_origin(vec![behind, glass]), &state(), &view(8, 8, Samples::Four));
    assert_eq!(picture.at(3, 3), [0.1, 0.2, 0.3]);
}

#[test]
fn near_faces_hide_far_ones_a_millimetre_or_ten_metres_behind() {
    for (distance, gap, slope) in [(10.0, 0.001, 0.0), (10.0, 0.001, 5.0), (10_000.0, 10.0, 0.0), (10_000.0, 10.0, 3.0)]
    {
        for swap in [false, true] {
            // Two parallel faces, their far sides tilted away; the second farther along the line of sight.
            let face = |d: f64, color| {
                let s = distance;
                let up = DVec3::new(0.0, 1.0, -slope * 0.1);
                let start = DVec3::new(-s, 0.0, -d) - up * 2.0 * s * 0.2;
                mesh_of(&rectangle(start, DVec3::X * 2.0 * s, up * 4.0 * s * 0.2), color)
            };
            let mut meshes = vec![face(distance, [0.0, 1.0, 0.0, 1.0]), face(distance + gap, [1.0, 0.0, 0.0, 1.0])];
            if swap {
                meshes.reverse();
            }
            let picture = draw(&at_origin(meshes), &state(), &view(64, 64, Samples::Sixteen));
            let green = picture.linear.iter().filter(|c| c[1] > 0.0).count();
            // The rear face shows at most in a sliver beyond the front one's rim.
            let red = picture.linear.iter().filter(|c| c[0] > 0.2).count();
            assert!(green > 300 && red == 0, "{distance} m, {gap} m, slope {slope}: {green} green, {red} red");
        }
    }
}

#[test]
fn where_faces_coincide_the_later_in_the_file_wins_whatever_the_list() {
    let scene = at_origin(vec![wall(3.0, [1.0, 0.0, 0.0, 1.0]), wall(3.0, [0.0, 1.0, 0.0, 1.0])]);
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    for list in [[0, 1], [1, 0]] {
        let list = list.map(SubobjectId);
        for samples in ALL_SAMPLES {
            let view = view(16, 16, samples);
            let picture = draw_with(&mut renderer, &scene, &state(), &view, &list, &[Part::WHOLE]);
            assert!(picture.linear.iter().all(|c| *c == [0.0, 1.0, 0.0]), "{list:?}");
        }
    }
}

#[test]
fn faces_cut_at_the_near_plane_leave_no_gap_and_no_double_hit() {
    // A crumpled carpet that passes under and behind the eye, half transparent: every sample that it covers once is 1/2.
    let mut random = Random(99);
    for round in 0..20 {
        let n = 12;
        let mut grid = Vec::new();
        for i in 0..=n {
            for j in 0..=n {
                let jitter = |random: &mut Random| random.signed() * 0.3;
                let rim = i == 0 || j == 0 || i == n || j == n;
                let step = if rim { 1000.0 } else { 1.0 };
                grid.push(DVec3::new(
                    (f64::from(i) - 6.0 + jitter(&mut random)) * step,
                    -0.35 + if rim { 0.0 } else { random.signed() * 0.1 },
                    (f64::from(j) - 6.0 + jitter(&mut random)) * step,
                ));
            }
        }
        let at = |i: i32, j: i32| grid[(i * (n + 1) + j) as usize];
        let mut triangles = Vec::new();
        for i in 0..n {
            for j in 0..n {
                triangles.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
                triangles.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
        let mut carpet = mesh_of(&triangles, [1.0, 1.0, 1.0, 0.5]);
        carpet.material.double_sided = true;
        let mut state = state();
        let down = DQuat::from_rotation_x(-1.2) * DQuat::from_rotation_z(random.signed());
        state.eye = Pose { position: DVec3::ZERO, orientation: DQuat::from_rotation_y(random.signed() * 3.0) * down };
        let mut view = view(96, 96, Samples::SixtyFour);
        view.near = 0.3;
        let picture = draw(&at_origin(vec![carpet]), &state, &view);
        // The near plane cuts a hole into the carpet's bumps; inside of it and out, a sample is hit once or not at all.
        for (i, pixel) in picture.linear.iter().enumerate() {
            let (x, y) = (i % 96, i / 96);
            let ray =
                state.eye.orientation * DVec3::new((x as f64 + 0.5) / 48.0 - 1.0, 1.0 - (y as f64 + 0.5) / 48.0, -1.0);
            let level = -0.25 / ray.y;
            if ray.y < -0.05 && level > 0.3 {
                assert_eq!(pixel[0], 0.5, "round {round}, pixel ({x}, {y})");
            }
            assert!(pixel[0] <= 0.5, "round {round}, pixel ({x}, {y}): hit twice: {}", pixel[0]);
        }
    }
}

#[test]
fn the_sky_is_seen_by_elevation() {
    let mut state = state();
    state.environment.background = Background::Sky;
    let picture = draw(&at_origin(vec![]), &state, &view(33, 33, Samples::Four));
    assert_eq!(picture.at(16, 30), [0.60, 0.70, 0.80]);
    assert_eq!(picture.at(16, 2), [0.15, 0.30, 0.60]);
    // Column 16 looks straight ahead; the centre of row 12 is 4/16.5 above. A pixel is the mean of its samples' skies.
    let part: f64 = Pattern::of(Samples::Four).points[..4]
        .iter()
        .map(|[x, y]| {
            let [right, up] = [f64::from(x - 128) / 256.0, 4.0 - f64::from(y - 128) / 256.0].map(|c| c / 16.5);
            (up / (right * right + 1.0).sqrt()).atan().to_degrees() / 30.0 / 4.0
        })
        .sum();
    let mix = |h: f64, z: f64| h + (z - h) * part;
    assert_near(picture.at(16, 12), [mix(0.6, 0.15), mix(0.7, 0.3), mix(0.8, 0.6)], 1e-6);
}

#[test]
fn flat_faces_are_lit_by_their_own_normal_and_from_behind_by_its_opposite() {
    let sun = Environment::default().sun_direction;
    let lit = |cos: f64| 0.3 + 0.7 * cos.max(0.0);
    let mut front = wall(2.0, [1.0, 0.5, 0.25, 1.0]);
    front.material.unlit = false;
    front.material.emissive = [0.0, 0.0, 0.125];
    let expected = |light: f64| [light, 0.5 * light, 0.25 * light + 0.125];
    let small = view(8, 8, Samples::Four);
    assert_near(draw(&at_origin(vec![front.clone()]), &state(), &small).at(4, 4), expected(lit(sun.z)), 1e-6);
    // Turned round: not drawn, or lit with −n when it is double-sided.
    let half_turn = DAffine3::from_rotation_translation(DQuat::from_rotation_y(std::f64::consts::PI), DVec3::Z * -4.0);
    let turned = |mesh: &Mesh| store_of(vec![(mesh.clone(), half_turn)]);
    assert_eq!(draw(&turned(&front), &state(), &small).at(4, 4), [0.0; 3]);
    front.material.double_sided = true;
    assert_near(draw(&turned(&front), &state(), &small).at(4, 4), expected(lit(sun.z)), 1e-6);
    // Mirrored: still its front that is seen, its normal mirrored with it.
    front.material.double_sided = false;
    let mirror = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0)));
    let mirrored = store_of(vec![(front.clone(), mirror)]);
    assert_near(draw(&mirrored, &state(), &small).at(4, 4), expected(lit(sun.z)), 1e-6);
    // A zero normal counts as none.
    front.normals = vec![[0.0; 3]; front.positions.len()];
    assert_near(draw(&at_origin(vec![front]), &state(), &small).at(4, 4), expected(lit(sun.z)), 1e-6);
}

#[test]
fn attributes_are_interpolated_in_space_and_not_on_the_screen() {
    // A floor from 1 m to 100 m whose colour is its distance; also cut by the near plane when it starts behind the eye.
    for start in [-1.0, 50.0] {
        let a = DVec3::new(-300.0, -1.0, start);
        let mut floor = mesh_of(&rectangle(a, DVec3::X * 600.0, DVec3::Z * (-100.0 - start)), [1.0; 4]);
        floor.colors = floor.positions.iter().map(|p| [(-p[2] + 50.0) / 150.0, 0.0, 0.0, 1.0]).collect();
        let picture = draw(&at_origin(vec![floor]), &state(), &view(65, 64, Samples::One));
        for y in 34..64 {
            let distance = 1.0 / ((y as f64 + 0.5 - 32.0) / 32.0);
            let expected = (distance + 50.0) / 150.0;
            for x in [0, 31, 64] {
                let drawn = f64::from(picture.at(x, y)[0]);
                assert!((drawn - expected).abs() < 2e-3 * distance, "({x}, {y}): {drawn}, not {expected}");
            }
        }
    }
}

#[test]
fn normals_are_normalised_before_and_after_interpolation() {
    let mut face = wall(1.0, [1.0; 4]);
    face.material.unlit = false;
    // Left: straight towards the sun; right: 90° away, and ten times as long.
    let sun = Environment::default().sun_direction;
    let across = sun.any_orthonormal_vector() * 10.0;
    face.normals = face
        .positions
        .iter()
        .map(|p| if p[0] < 0.0 { sun.as_vec3().to_array() } else { across.as_vec3().to_array() })
        .collect();
    let picture = draw(&at_origin(vec![face]), &state(), &view(65, 65, Samples::One));
    // In the middle 45° between both.
    assert_near(picture.at(32, 32), [0.3 + 0.7 * std::f64::consts::FRAC_1_SQRT_2; 3], 1e-3);
}

/// A wall at 1 m whose texture coordinates run from 0 to `repeats` over the 90° view, from its upper left.
fn textured_wall(texture: usize, repeats: f32) -> Mesh {
    let mut mesh = wall(1.0, [1.0; 4]);
    let uv = mesh.positions.iter().map(|p| [(p[0] + 1.0) / 2.0 * repeats, (1.0 - p[1]) / 2.0 * repeats]);
    mesh.texcoords = vec![uv.collect()];
    mesh.material.base_texture = Some(texture_use(content(texture)));
    mesh
}

#[test]
fn textures_are_magnified_as_the_file_asks_and_averaged_when_small() {
    let mut wall = textured_wall(100, 1.0);
    wall.material.base_texture.as_mut().unwrap().magnify = Filter::Nearest;
    let mut store = at_origin(vec![wall.clone()]);
    checker(&mut store, 100, 4, [255; 4], [0, 0, 0, 255]);
    let picture = draw(&store, &state(), &view(64, 64, Samples::One));
    for (i, pixel) in picture.linear.iter().enumerate() {
        let light = (i % 64 / 16 + i / 64 / 16) % 2 == 0;
        assert_eq!(pixel[0], if light { 1.0 } else { 0.0 }, "pixel {i}");
    }
    // Linear: half-way between the centres of two texels both count half; at a texel's centre only it does.
    wall.material.base_texture.as_mut().unwrap().magnify = Filter::Linear;
    let mut store = at_origin(vec![wall]);
    checker(&mut store, 100, 4, [255; 4], [0, 0, 0, 255]);
    let picture = draw(&store, &state(), &view(64, 64, Samples::One));
    assert_near(picture.at(7, 7), [1.0 - 2.0 / 32.0 + 2.0 / 1024.0; 3], 1e-3);
    assert_near(picture.at(15, 7), [0.5 + 1.0 / 32.0; 3], 0.01);
    // 64 × 64 texels on 4 × 4 pixels: the mean.
    let mut store = at_origin(vec![textured_wall(100, 1.0)]);
    checker(&mut store, 100, 64, [255; 4], [0, 0, 0, 255]);
    let picture = draw(&store, &state(), &view(4, 4, Samples::Four));
    for pixel in picture.linear {
        assert_near(pixel, [0.5; 3], 1e-3);
    }
}

#[test]
fn masks_are_tested_per_sample() {
    // Nearest texels of 16 pixels each, every other one a hole; shifted by half a pixel, so that pixels are cut in half.
    let behind = wall(2.0, [0.25, 0.25, 0.25, 1.0]);
    let mut wall = textured_wall(100, 1.0);
    wall.material.alpha = Alpha::Mask { cutoff: 0.5 };
    let usage = wall.material.base_texture.as_mut().unwrap();
    usage.magnify = Filter::Nearest;
    usage.transform[0][2] = 0.5 / 64.0;
    for samples in ALL_SAMPLES {
        let mut store = at_origin(vec![wall.clone(), behind.clone()]);
        checker(&mut store, 100, 4, [255; 4], [255, 255, 255, 127]);
        let picture = draw(&store, &state(), &view(64, 64, samples));
        assert_eq!(picture.at(3, 3), [1.0; 3], "{samples:?}");
        assert_eq!(picture.at(20, 3), [0.25; 3], "{samples:?}");
        if samples != Samples::One {
            assert_eq!(picture.at(15, 3), [0.625; 3], "{samples:?}");
        }
    }
}

#[test]
fn visibility_fades_by_distance_and_ends_at_its_range() {
    let mut state = state();
    state.environment.visibility_m = Some(100.0);
    state.environment.fog = Some([0.5, 0.25, 0.125]);
    let view = view(64, 64, Samples::Four);
    for distance in [1.0, 30.0, 70.0] {
        let picture = draw(&at_origin(vec![wall(distance, [1.0; 4])]), &state, &view);
        let (x, y) = (40, 20);
        let [rx, ry] = [(f64::from(x) + 0.5) / 32.0 - 1.0, 1.0 - (f64::from(y) + 0.5) / 32.0];
        let kept = libm::exp(libm::log(0.02) / 100.0 * distance * (1.0 + rx * rx + ry * ry).sqrt());
        let expected = [0.5, 0.25, 0.125].map(|fog| kept + fog * (1.0 - kept));
        assert_near(picture.at(x as usize, y as usize), expected, 1e-5);
    }
    // At 80 m ahead the wall ends where the ray is 100 m long: a disc of tangent 3/4.
    let picture = draw(&at_origin(vec![wall(80.0, [1.0; 4])]), &state, &view);
    for (i, pixel) in picture.linear.iter().enumerate() {
        let [rx, ry] = [(i % 64) as f64, (i / 64) as f64].map(|c| (c + 0.5) / 32.0 - 1.0);
        let radius = (rx * rx + ry * ry).sqrt();
        if radius < 0.72 {
            assert!(pixel[0] > 0.5, "inside at {i}: {pixel:?}");
        } else if radius > 0.78 {
            assert_eq!(*pixel, [0.0; 3], "outside at {i}");
        }
    }
    let picture = draw(&at_origin(vec![wall(101.0, [1.0; 4])]), &state, &view);
    assert!(picture.linear.iter().all(|c| *c == [0.0; 3]), "nothing is drawn beyond the range");
}

/// The airport's clouds had dotted lines along the diagonals of their quads: of textured layers only those pixels were shaded
/// that one of the two triangles fills.
#[test]
fn a_textured_pane_has_no_seam_along_its_diagonal() {
    for samples in ALL_SAMPLES {
        let mut pane = wall(2.0, [1.0, 1.0, 1.0, 0.5]);
        pane.material.alpha = Alpha::Blend;
        pane.material.base_texture = Some(texture_use(content(100)));
        pane.texcoords = vec![pane.positions.iter().map(|p| [p[0], p[1]]).collect()];
        let mut store = at_origin(vec![wall(3.0, [0.25, 0.25, 0.25, 1.0]), pane]);
        checker(&mut store, 100, 4, [255; 4], [255; 4]);
        let picture = draw(&store, &state(), &view(40, 40, samples));
        for colour in &picture.linear {
            assert_near(*colour, [0.625; 3], 1e-6);
        }
    }
}
