//! What the tests compare with: small scenes made by hand, and an independent brute-force sampler.
//!
//! The sampler shares nothing with the pipeline but the sample points: per sample it asks every face, in i128, whether it
//! covers the point, sorts all that do by their depth, and mixes them. It knows whole, unlit, untextured faces.

use crate::geometry::camera::Camera;
use crate::pipeline::{Renderer, TilePictures};
use crate::samples::Pattern;
use crate::simd::SimdLevel;
use crate::store::SceneStore;
use glam::{DAffine3, DVec3};
use proto::debug::DebugPicture;
use proto::frame::{Background, Environment, FrameState, VersionWeights};
use proto::ids::{ContentId, Epoch, FrameNumber, ModelId, ObjectId, SubobjectId};
use proto::scene::{
    Alpha, Box3, Filter, Material, Mesh, ObjectRow, SceneTable, Sphere, SubobjectRow, TRANSFORM_IDENTITY, TextureUse,
    Wrap,
};
use proto::share::Part;
use proto::view::{Pose, Samples, Tangents, View};
use std::num::NonZeroUsize;

/// A mesh of separate triangles, unlit and single-sided, translucent if alpha is below 1.
pub(crate) fn mesh_of(triangles: &[[DVec3; 3]], color: [f32; 4]) -> Mesh {
    let corners: Vec<DVec3> = triangles.iter().flatten().copied().collect();
    let min = corners.iter().copied().reduce(DVec3::min).unwrap_or_default();
    let max = corners.iter().copied().reduce(DVec3::max).unwrap_or_default();
    Mesh {
        origin: DVec3::ZERO,
        positions: corners.iter().map(|p| p.as_vec3().to_array()).collect(),
        normals: vec![],
        colors: vec![],
        texcoords: vec![],
        triangles: (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        face_numbers: (0..triangles.len() as u32).collect(),
        material: Material {
            base_color: color,
            unlit: true,
            alpha: if color[3] < 1.0 { Alpha::Blend } else { Alpha::Opaque },
            ..Material::default()
        },
        sphere: Sphere { centre: (min + max) / 2.0, radius: (max - min).length() / 2.0 },
        bounds: Box3 { min, max },
    }
}

/// A rectangle from `a` along `u` and `v`, front towards u × v.
pub(crate) fn rectangle(a: DVec3, u: DVec3, v: DVec3) -> [[DVec3; 3]; 2] {
    [[a, a + u, a + u + v], [a, a + u + v, a + v]]
}

/// A table with one object for each mesh.
pub(crate) fn place(meshes: &[(ContentId, DAffine3)]) -> SceneTable {
    SceneTable {
        objects: meshes.iter().map(|(_, transform)| ObjectRow { transform: *transform }).collect(),
        subobjects: meshes
            .iter()
            .enumerate()
            .map(|(i, (mesh, _))| SubobjectRow {
                object: ObjectId(i as u32),
                mesh: *mesh,
                primitive: i as u32,
                layer: 0,
                part_of: None,
                planes: None,
            })
            .collect(),
        ..SceneTable::default()
    }
}

/// A plain use of a texture.
pub(crate) fn texture_use(texture: ContentId) -> TextureUse {
    TextureUse {
        texture,
        set: 0,
        transform: TRANSFORM_IDENTITY,
        wrap_u: Wrap::Repeat,
        wrap_v: Wrap::Repeat,
        magnify: Filter::Linear,
    }
}

/// The name of content number `n`.
pub(crate) fn content(n: usize) -> ContentId {
    let mut id = [0; 16];
    id[..8].copy_from_slice(&(n as u64).to_be_bytes());
    ContentId(id)
}

/// A store with these meshes, each an object of its own, in this order.
pub(crate) fn store_of(meshes: Vec<(Mesh, DAffine3)>) -> SceneStore {
    store_with(meshes, |_| ())
}

/// The same with the table changed before it is taken.
pub(crate) fn store_with(meshes: Vec<(Mesh, DAffine3)>, change: impl FnOnce(&mut SceneTable)) -> SceneStore {
    let mut store = SceneStore::new();
    let rows: Vec<_> = meshes.iter().enumerate().map(|(n, (_, transform))| (content(n), *transform)).collect();
    for (n, (mesh, _)) in meshes.into_iter().enumerate() {
        store.insert_mesh(content(n), mesh).unwrap();
    }
    let mut table = place(&rows);
    change(&mut table);
    store.set_table(table).unwrap();
    store
}

/// All of these models' versions with these weights.
pub(crate) fn weights(of: &[(u32, &[f32])]) -> Vec<VersionWeights> {
    of.iter().map(|(model, w)| VersionWeights { model: ModelId(*model), weights: w.to_vec() }).collect()
}

/// A view of 90° in the shorter direction.
pub(crate) fn view(width: u32, height: u32, samples: Samples) -> View {
    let tangents = if width < height {
        let t = f64::from(height) / f64::from(width);
        Tangents { left: -1.0, right: 1.0, bottom: -t, top: t }
    } else {
        let t = f64::from(width) / f64::from(height);
        Tangents { left: -t, right: t, bottom: -1.0, top: 1.0 }
    };
    View { offset: Pose::IDENTITY, tangents, width, height, near: View::NEAR_DEFAULT, samples }
}

/// An eye at the origin looking along −Z, a constant black background.
pub(crate) fn state() -> FrameState {
    FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(0),
        eye: Pose::IDENTITY,
        environment: Environment { background: Background::Constant([0.0; 3]), ..Environment::default() },
        debug: DebugPicture::Off,
    }
}

/// The whole list of a store.
pub(crate) fn everything(store: &SceneStore) -> Vec<SubobjectId> {
    (0..store.subobjects() as u32).map(SubobjectId).collect()
}

/// A whole view, row-major: linear and encoded.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picture {
    pub(crate) width: usize,
    pub(crate) linear: Vec<[f32; 3]>,
    pub(crate) rgb: Vec<[u8; 3]>,
}

impl Picture {
    pub(crate) fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.linear[y * self.width + x]
    }
}

/// Draws by shares and stitches; every pixel must come exactly once.
pub(crate) fn draw_with(
    renderer: &mut Renderer,
    store: &SceneStore,
    state: &FrameState,
    view: &View,
    list: &[SubobjectId],
    parts: &[Part],
) -> Picture {
    let (width, height) = (view.width as usize, view.height as usize);
    let mut picture = Picture { width, linear: vec![[f32::NAN; 3]; width * height], rgb: vec![[0; 3]; width * height] };
    for part in parts {
        let mut out = TilePictures::with_linear();
        renderer.draw(store, state, view, list, part, &mut out).unwrap();
        for (k, tile) in out.tiles.iter().enumerate() {
            let rect = tile.rect(view.width, view.height);
            let (bytes, floats) = (out.tile(k), out.tile_linear(k).unwrap());
            for i in 0..rect.area() {
                let x = (rect.x0 + i as u32 % rect.width()) as usize;
                let y = (rect.y0 + i as u32 / rect.width()) as usize;
                let to = y * width + x;
                assert!(picture.linear[to][0].is_nan(), "pixel ({x}, {y}) came twice");
                picture.linear[to] = [floats[3 * i], floats[3 * i + 1], floats[3 * i + 2]];
                picture.rgb[to] = [bytes[3 * i], bytes[3 * i + 1], bytes[3 * i + 2]];
            }
        }
    }
    let bad = picture.linear.iter().position(|c| !c.iter().all(|c| c.is_finite()));
    assert!(bad.is_none(), "a pixel is missing or not a number: {:?}", bad.map(|at| (at, picture.linear[at])));
    picture
}

/// Draws everything with one thread, with every instruction set of this machine; all must draw the same.
pub(crate) fn draw(store: &SceneStore, state: &FrameState, view: &View) -> Picture {
    let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
    let list = everything(store);
    let picture = draw_with(&mut renderer, store, state, view, &list, &[Part::WHOLE]);
    for level in SimdLevel::all() {
        renderer.set_simd(level);
        let other = draw_with(&mut renderer, store, state, view, &list, &[Part::WHOLE]);
        assert_eq!(other, picture, "{level} draws another picture");
    }
    picture
}

/// A seeded source of numbers (xorshift64*).
#[derive(Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// In 0..n.
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        (self.next() >> 16) % n
    }

    /// In 0.0..1.0.
    pub(crate) fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In −1.0..1.0.
    pub(crate) fn signed(&mut self) -> f64 {
        self.unit() * 2.0 - 1.0
    }
}

/// A face for the sampler: corners in the eye's frame, all in front of the near plane.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OracleFace {
    pub(crate) corners: [DVec3; 3],
    pub(crate) color: [f32; 4],
}

/// Corners on the screen, in 1/256 pixel.
pub(crate) fn on_screen(view: &View, p: DVec3) -> [i128; 2] {
    let t = view.tangents;
    let x = (p.x / -p.z - t.left) / (t.right - t.left) * f64::from(view.width);
    let y = (t.top - p.y / -p.z) / (t.top - t.bottom) * f64::from(view.height);
    [x, y].map(|c| (c * 256.0 + 0.5).floor() as i128)
}

/// Whether a point is in the triangle: strictly inside, or on an edge that is a top or a left one. Either way round.
pub(crate) fn point_in_triangle(corners: [[i128; 2]; 3], [px, py]: [i128; 2]) -> bool {
    let cross = |a: [i128; 2], b: [i128; 2]| (b[0] - a[0]) * (py - a[1]) - (b[1] - a[1]) * (px - a[0]);
    let [a, b, c] = corners;
    let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let run = if area < 0 { [a, c, b] } else { [a, b, c] };
    area != 0
        && (0..3).all(|k| {
            let (from, to) = (run[k], run[(k + 1) % 3]);
            let e = cross(from, to);
            // Clockwise as seen: a left edge goes up, a top edge goes right.
            let is_left = to[1] < from[1];
            let is_top = to[1] == from[1] && to[0] > from[0];
            e > 0 || (e == 0 && (is_left || is_top))
        })
}

/// The corners of a mesh's faces in the eye's frame. The pipeline's own transformation: what is asked of the sampler is what
/// becomes of corners, not where they are.
pub(crate) fn corners_at_eye(state: &FrameState, view: &View, mesh: &Mesh, transform: &DAffine3) -> Vec<[DVec3; 3]> {
    let camera = Camera::new(state, view);
    let relative = camera.relative(transform);
    let at_eye = |v: u32| {
        let p = camera.view_point(transform.matrix3 * mesh.position(v as usize) + relative);
        DVec3::new(p.x, p.y, -p.w)
    };
    mesh.triangles.iter().map(|corners| corners.map(at_eye)).collect()
}

/// The picture of opaque faces of one plane that are painted over each other in that order: depth has no say.
pub(crate) fn paint_by_force(view: &View, faces: &[OracleFace]) -> Vec<[f64; 3]> {
    let pattern = Pattern::of(view.samples);
    let screen: Vec<[[i128; 2]; 3]> = faces.iter().map(|f| f.corners.map(|c| on_screen(view, c))).collect();
    let pixels = (0..view.height).flat_map(|y| (0..view.width).map(move |x| [x, y].map(|c| i128::from(c) * 256)));
    pixels
        .map(|[x, y]| {
            let mut sum = [0.0; 3];
            for [dx, dy] in &pattern.points[..pattern.count] {
                let p = [x + i128::from(*dx), y + i128::from(*dy)];
                let top = (0..faces.len()).rev().find(|k| point_in_triangle(screen[*k], p));
                for (c, sum) in sum.iter_mut().enumerate() {
                    *sum += top.map_or(0.0, |k| f64::from(faces[k].color[c]));
                }
            }
            sum.map(|c| c / pattern.count as f64)
        })
        .collect()
}

/// What a face of the sampler belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OraclePart {
    pub(crate) model: usize,
    pub(crate) version: usize,
}

/// The picture of faces of which some belong to versions of models with weights, `merged` or not: an expectation.
/// Each model shows one version, or none, with its weight as its probability, independently of the others; the formula of
/// picture.md is the mean over all combinations, and this function adds them up one by one.
pub(crate) fn sample_versions_by_force(
    view: &View,
    faces: &[(OracleFace, Option<OraclePart>)],
    models: &[(&[f32], bool)],
) -> Vec<[f64; 3]> {
    let mut sum = vec![[0.0; 3]; (view.width * view.height) as usize];
    let choices: Vec<usize> = models.iter().map(|(weights, _)| weights.len() + 1).collect();
    for combination in 0..choices.iter().product::<usize>() {
        let mut rest = combination;
        let (mut chosen, mut probability) = (Vec::new(), 1.0);
        for ((weights, _), count) in models.iter().zip(&choices) {
            let choice = rest % count;
            rest /= count;
            let total: f64 = weights.iter().copied().map(f64::from).sum();
            probability *= weights.get(choice).map_or((1.0 - total).max(0.0), |w| f64::from(*w));
            chosen.push(choice);
        }
        if probability == 0.0 {
            continue;
        }
        let shown: Vec<(OracleFace, Option<usize>)> = faces
            .iter()
            .filter(|(_, part)| part.is_none_or(|part| chosen[part.model] == part.version))
            .map(|(face, part)| (*face, part.map(|part| part.model).filter(|model| models[*model].1)))
            .collect();
        for (sum, pixel) in sum.iter_mut().zip(sample_merged_by_force(view, &shown)) {
            for (sum, c) in sum.iter_mut().zip(pixel) {
                *sum += c * probability;
            }
        }
    }
    sum
}

/// The picture of `faces`, in the order of the file, on a black background: the mean of the samples, linear.
pub(crate) fn sample_by_force(view: &View, faces: &[OracleFace]) -> Vec<[f64; 3]> {
    let faces: Vec<_> = faces.iter().map(|face| (*face, None)).collect();
    sample_merged_by_force(view, &faces)
}

/// The same where only the nearest translucent fragment of each merged model, named beside the face, counts.
fn sample_merged_by_force(view: &View, faces: &[(OracleFace, Option<usize>)]) -> Vec<[f64; 3]> {
    let (faces, merged): (Vec<OracleFace>, Vec<Option<usize>>) = faces.iter().copied().unzip();
    let pattern = Pattern::of(view.samples);
    let screen: Vec<[[i128; 2]; 3]> = faces.iter().map(|f| f.corners.map(|c| on_screen(view, c))).collect();
    let q_at = |k: usize, p: [i128; 2]| {
        let [a, b, c] = screen[k];
        let cross = |u: [i128; 2], v: [i128; 2]| ((u[0] - p[0]) * (v[1] - p[1]) - (u[1] - p[1]) * (v[0] - p[0])) as f64;
        let parts = [cross(b, c), cross(c, a), cross(a, b)];
        let q = faces[k].corners.map(|c| 1.0 / -c.z);
        (parts[0] * q[0] + parts[1] * q[1] + parts[2] * q[2]) / (parts[0] + parts[1] + parts[2])
    };
    let mut picture = Vec::new();
    for y in 0..view.height {
        for x in 0..view.width {
            let mut sum = [0.0; 3];
            for [dx, dy] in &pattern.points[..pattern.count] {
                let p = [i128::from(x) * 256 + i128::from(*dx), i128::from(y) * 256 + i128::from(*dy)];
                let mut hits: Vec<(f64, usize)> =
                    (0..faces.len()).filter(|k| point_in_triangle(screen[*k], p)).map(|k| (q_at(k, p), k)).collect();
                hits.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.cmp(&a.1)));
                let mut through = 1.0;
                let mut met = Vec::new();
                for (_, k) in hits {
                    if let Some(model) = merged[k].filter(|_| faces[k].color[3] < 1.0) {
                        if met.contains(&model) {
                            continue;
                        }
                        met.push(model);
                    }
                    let [r, g, b, alpha] = faces[k].color.map(f64::from);
                    for (s, c) in sum.iter_mut().zip([r, g, b]) {
                        *s += c * alpha * through;
                    }
                    through *= 1.0 - alpha;
                }
            }
            picture.push(sum.map(|c| c / pattern.count as f64));
        }
    }
    picture
}
