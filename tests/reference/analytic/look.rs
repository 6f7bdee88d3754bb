//! Light, air, sky and textures.

use super::*;
use crate::compare::Shown;
use crate::{Options, Picture, compare, difference_picture, sample};
use proto::ids::ContentId;
use proto::scene::{Filter, TRANSFORM_IDENTITY, Texture, TextureUse, Wrap};

fn lit(meshes: &[Mesh], state: &FrameState) -> Picture {
    sample(&world(meshes), state, &view(), &Options::truth(4, 4))
}

fn sun_from(direction: DVec3) -> FrameState {
    let environment = Environment { sun_direction: direction, ..state([0.0; 3]).environment };
    FrameState { environment, ..state([0.0; 3]) }
}

#[test]
fn light_is_ambient_and_the_suns_cosine() {
    let material = Material { base_color: [0.5, 1.0, 0.25, 1.0], emissive: [0.0, 0.0, 0.125], ..Material::default() };
    let meshes = [mesh(&wall(5.0), material)];
    for (direction, light) in [(DVec3::Z, 1.0), (DVec3::NEG_Z, 0.3), (DVec3::new(0.6, 0.0, 0.8), 0.3 + 0.7 * 0.8)] {
        let want = [0.5 * light, light, 0.25 * light + 0.125];
        assert_close(lit(&meshes, &sun_from(direction)).at(3, 3), want, 1e-7);
    }
}

#[test]
fn a_double_sided_face_has_the_opposite_normal_from_behind() {
    let mut points = wall(5.0);
    points.swap(1, 2);
    points.swap(4, 5);
    let single = [mesh(&points, Material::default())];
    assert_close(lit(&single, &sun_from(DVec3::Z)).at(3, 3), [0.0; 3], 0.0);
    let double = [mesh(&points, Material { double_sided: true, ..Material::default() })];
    assert_close(lit(&double, &sun_from(DVec3::Z)).at(3, 3), [1.0; 3], 1e-7);
    // Mirroring turns the winding round, but not what is front: glTF has clockwise faces in a mirrored object.
    for (meshes, want) in [(&single, 0.0), (&[mesh(&wall(5.0), Material::default())], 1.0)] {
        let mut mirrored = world(meshes);
        mirrored.instances[0].transform = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let picture = sample(&mirrored, &sun_from(DVec3::Z), &view(), &Options::truth(4, 4));
        assert_close(picture.at(3, 3), [want; 3], 1e-7);
    }
}

#[test]
fn normals_are_made_unit_then_mixed_then_made_unit() {
    let mut one = mesh(&wall(5.0), Material::default());
    // Twice as long a normal doesn't count twice; a zero one is the face's own.
    one.normals = vec![[0.0, 3.0, 4.0]; 6];
    assert_close(lit(&[one.clone()], &sun_from(DVec3::Z)).at(3, 3), [0.3 + 0.7 * 0.8; 3], 1e-7);
    one.normals = vec![[0.0; 3]; 6];
    assert_close(lit(&[one], &sun_from(DVec3::Z)).at(3, 3), [1.0; 3], 1e-7);
}

#[test]
fn at_the_range_of_visibility_98_per_cent_is_fog_and_beyond_is_nothing() {
    let meshes = [mesh(&wall(100.0), paint([1.0; 3]))];
    let view = View { tangents: Tangents { left: -1e-3, right: 1e-3, bottom: -1e-3, top: 1e-3 }, ..view() };
    for (range, want) in
        [(100.001, 0.02 + 0.5 * 0.98), (99.9, 0.25), (200.0, 0.02f64.sqrt() + 0.5 * (1.0 - 0.02f64.sqrt()))]
    {
        let environment = Environment {
            visibility_m: Some(range),
            fog: Some([0.5; 3]),
            background: Background::Constant([0.25; 3]),
            ..Environment::default()
        };
        let state = FrameState { environment, ..state([0.0; 3]) };
        let picture = sample(&world(&meshes), &state, &view, &Options::truth(4, 4));
        assert_close(picture.at(4, 4), [want; 3], 1e-4);
    }
}

#[test]
fn the_sky_goes_from_horizon_to_zenith_by_elevation() {
    let sky = FrameState { environment: Environment::default(), ..state([0.0; 3]) };
    let picture = sample(&World::default(), &sky, &view(), &Options::truth(1, 1));
    assert_close(picture.at(4, 6), [0.6, 0.7, 0.8], 1e-15);
    // The centre of pixel (4, 2) has X = 0.125, Y = 0.375 at Z = −1.
    let elevation = (0.375 / f64::sqrt(0.125f64.powi(2) + 0.375f64.powi(2) + 1.0)).asin().to_degrees() / 30.0;
    let want = [0.6 - 0.45 * elevation, 0.7 - 0.4 * elevation, 0.8 - 0.2 * elevation];
    assert_close(picture.at(4, 2), want, 1e-12);
    assert_close(picture.at(4, 0), [0.15, 0.3, 0.6], 1e-12);
}

/// A wall with a texture whose texels are that many pixels wide.
fn textured(
    texels: &[[u8; 4]],
    width: u32,
    pixels_per_texel: f64,
    change: impl Fn(&mut TextureUse),
) -> (Mesh, Texture) {
    let texture = Texture { width, height: texels.len() as u32 / width, texels: texels.to_vec() };
    let mut used = TextureUse {
        texture: ContentId([0; 16]),
        set: 0,
        transform: TRANSFORM_IDENTITY,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Repeat,
        magnify: Filter::Linear,
    };
    change(&mut used);
    let mut mesh = mesh(&wall(4.0), Material { base_texture: Some(used), ..paint([1.0; 3]) });
    // On the screen, texel 0 begins at pixel 0; the wall runs from −8 to 16.
    let (w, h) = (f64::from(texture.width) * pixels_per_texel, f64::from(texture.height) * pixels_per_texel);
    let places = [[-8.0, 16.0], [16.0, 16.0], [16.0, -8.0], [-8.0, 16.0], [16.0, -8.0], [-8.0, -8.0]];
    mesh.texcoords = vec![places.iter().map(|[x, y]| [(x / w) as f32, (y / h) as f32]).collect()];
    (mesh, texture)
}

fn seen(mesh: &Mesh, texture: &Texture, filtering: crate::Filtering) -> Picture {
    let mut world = world(std::slice::from_ref(mesh));
    world.textures.insert(ContentId([0; 16]), texture);
    sample(&world, &state([0.0; 3]), &view(), &Options { filtering, ..Options::truth(1, 1) })
}

const ON: [u8; 4] = [255; 4];
const OFF: [u8; 4] = [0, 0, 0, 255];

#[test]
fn a_reduced_chessboard_is_linear_grey() {
    let (mesh, texture) = textured(&[ON, OFF, OFF, ON], 2, 1.0 / 16.0, |_| {});
    let picture = seen(&mesh, &texture, crate::Filtering::TRUTH);
    assert_close(picture.at(3, 4), [0.5; 3], 4e-3);
    assert!((picture.kinds[30].texels_per_pixel - 16.0).abs() < 1e-3);
    assert_close(seen(&mesh, &texture, crate::Filtering::Averaged(4)).at(3, 4), [0.5; 3], 0.1);
}

#[test]
fn magnified_texels_are_mixed_or_not_and_wrapped_as_asked() {
    let row = [[255, 0, 0, 255], [0, 255, 0, 255]];
    // Two pixels a texel: pixel centres lie a quarter and three quarters through each texel.
    let point = crate::Filtering::Point;
    let (mesh, texture) = textured(&row, 2, 2.0, |_| {});
    let picture = seen(&mesh, &texture, point);
    assert_close(picture.at(0, 0), [0.75, 0.25, 0.0], 1e-6);
    assert_close(picture.at(1, 0), [0.75, 0.25, 0.0], 1e-6);
    assert_close(picture.at(3, 0), [0.25, 0.75, 0.0], 1e-6);
    let (mesh, texture) = textured(&row, 2, 2.0, |used| used.magnify = Filter::Nearest);
    assert_close(seen(&mesh, &texture, point).at(1, 0), [1.0, 0.0, 0.0], 1e-12);
    let clamp = |used: &mut TextureUse| used.wrap_u = Wrap::Clamp;
    let (mesh, texture) = textured(&row, 2, 2.0, clamp);
    assert_close(seen(&mesh, &texture, point).at(0, 0), [1.0, 0.0, 0.0], 1e-6);
    assert_close(seen(&mesh, &texture, point).at(7, 0), [0.0, 1.0, 0.0], 1e-6);
    let mirror = |used: &mut TextureUse| (used.wrap_u, used.magnify) = (Wrap::Mirror, Filter::Nearest);
    let (mesh, texture) = textured(&row, 2, 2.0, mirror);
    let picture = seen(&mesh, &texture, point);
    let reds: Vec<f64> = (0..8).map(|x| picture.at(x, 0)[0]).collect();
    assert_eq!(reds, [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]);
}

#[test]
fn a_mask_is_asked_at_every_point() {
    // Alpha rises from 0 to 1 over texels 8 pixels wide: it is a half in the middle of pixel columns 7 and 8.
    let texels = [[255, 255, 255, 0], [255, 255, 255, 255]];
    let (mut mesh, texture) = textured(&texels, 2, 8.0, |used| used.wrap_u = Wrap::Clamp);
    mesh.material.alpha = Alpha::Mask { cutoff: 0.1875 };
    // Alpha is 0 up to x = 4, then rises by 1/8 a pixel: the cut-off is crossed at x = 5.5.
    let mut world = world(std::slice::from_ref(&mesh));
    world.textures.insert(ContentId([0; 16]), &texture);
    let picture = sample(&world, &state([0.0; 3]), &view(), &Options::truth(64, 64));
    let shown: Vec<f64> = (0..8).map(|x| picture.at(x, 0)[0]).collect();
    assert_eq!(shown, [0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0]);
}

#[test]
fn comparing_a_picture_with_itself_finds_rounding_only() {
    let meshes = [mesh(&rectangle(1.3, 1.0, 5.3, 7.0, 4.0), paint([1.0, 0.5, 0.1]))];
    let picture = lit(&meshes, &state([0.2, 0.3, 0.4]));
    let bytes = picture.to_bytes();
    let report = compare(Shown::Bytes(&bytes), &picture);
    assert!(report.all.max_255 <= 0.5 && report.all.pixels == 64, "{report}");
    assert_eq!(report.edges.pixels + report.interior.pixels, 64);
    let mut wrong = bytes.clone();
    wrong[(3 * 8 + 3) * 3] -= 10;
    let report = compare(Shown::Bytes(&wrong), &picture);
    assert!((report.all.max_255 - 10.0).abs() <= 0.5 && report.all.worst == [3, 3], "{report}");
    assert!(report.to_string().contains("max"));
    let png = difference_picture(Shown::Bytes(&wrong), &picture, 8.0).unwrap();
    let shown = image::load_from_memory(&png).unwrap().into_rgb8();
    assert_eq!(shown.get_pixel(3, 3).0, [255, 0, 0], "marked");
    let floats: Vec<f32> = picture.linear.iter().flatten().map(|c| *c as f32).collect();
    assert!(compare(Shown::Linear(&floats), &picture).all.max_linear < 1e-7);
}
