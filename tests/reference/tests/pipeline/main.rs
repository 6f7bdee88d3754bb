//! The pipeline against the reference: the same rounded vertices and the same points give the same coverage to the bit
//! and the same untextured colour to 1/255; true vertices the same wherever a point isn't right beside an edge.
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "tests: what can't go on fails, and figures are shown")]

mod coverage;
mod exact;
mod scenes;
mod table;

use channel::pipeline::{Renderer, TilePictures};
use channel::samples::Pattern;
use channel::store::SceneStore;
use cyclorama_reference as reference;
use glam::{DAffine3, DQuat, DVec3};
use manager::host::camera::{CameraFile, CameraPose};
use manager::scene::{Entities, Scene, builtin, import};
use proto::codec::encode_mesh;
use proto::debug::DebugPicture;
use proto::frame::{Environment, FrameState, Moved, VersionWeights};
use proto::ids::{ContentId, Epoch, FrameNumber, ObjectId, SubobjectId};
use proto::scene::{Alpha, Box3, Material, Mesh, ObjectRow, SceneTable, Sphere, SubobjectRow, Texture};
use proto::view::{Pose, Samples, Tangents, View};
use reference::{Grid, Options, Picture, Report, Shown, Vertices, World, compare};
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const ALL_SAMPLES: [Samples; 5] = [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour];

/// A scene's tables, for both renderers.
#[derive(Default)]
struct Content {
    table: SceneTable,
    meshes: BTreeMap<ContentId, Arc<Mesh>>,
    textures: BTreeMap<ContentId, Arc<Texture>>,
    moved: Vec<Moved>,
    weights: Vec<VersionWeights>,
}

impl Content {
    fn of(scene: &Scene) -> Self {
        Self {
            table: scene.table.clone(),
            meshes: scene.meshes.all().unwrap(),
            textures: scene.textures.all().unwrap(),
            ..Self::default()
        }
    }

    /// Adds a mesh as an object of its own.
    fn add(&mut self, mesh: Mesh, transform: DAffine3) {
        let id = ContentId::of(&encode_mesh(&mesh));
        let number = self.table.objects.len() as u32;
        self.meshes.insert(id, Arc::new(mesh));
        self.table.objects.push(ObjectRow { transform });
        self.table.subobjects.push(SubobjectRow {
            object: ObjectId(number),
            mesh: id,
            primitive: number,
            layer: 0,
            part_of: None,
            planes: None,
        });
    }

    fn store(&self) -> SceneStore {
        let mut store = SceneStore::new();
        for (id, texture) in &self.textures {
            store.insert_texture(*id, texture.as_ref().clone()).unwrap();
        }
        for (id, mesh) in &self.meshes {
            store.insert_mesh(*id, mesh.as_ref().clone()).unwrap();
        }
        store.set_table(self.table.clone()).unwrap();
        store.set_moved(&self.moved).unwrap();
        store.set_weights(&self.weights).unwrap();
        store
    }

    fn world(&self) -> World<'_> {
        World::of_scene(&self.table, &self.meshes, &self.textures, &self.moved, &self.weights).unwrap()
    }

    /// The pipeline's picture, linear and 8-bit, row-major.
    fn draw(&self, state: &FrameState, view: &View) -> (Vec<f32>, Vec<u8>) {
        let list: Vec<SubobjectId> = (0..self.table.subobjects.len() as u32).map(SubobjectId).collect();
        let mut renderer = Renderer::new(NonZeroUsize::MIN).unwrap();
        let mut out = TilePictures::with_linear();
        let stats = renderer.draw(&self.store(), state, view, &list, &proto::share::Part::WHOLE, &mut out).unwrap();
        if stats.pixels_exact_by_points > 0 {
            println!("{} of {} exact pixels by points", stats.pixels_exact_by_points, stats.pixels_exact);
        }
        let pixels = (view.width * view.height) as usize;
        let (mut linear, mut bytes) = (vec![0.0; pixels * 3], vec![0; pixels * 3]);
        for (k, tile) in out.tiles.iter().enumerate() {
            let rect = tile.rect(view.width, view.height);
            let (from_linear, from_bytes) = (out.tile_linear(k).unwrap(), out.tile(k));
            for y in rect.y0..rect.y1 {
                let to = (y * view.width + rect.x0) as usize * 3;
                let from = ((y - rect.y0) * rect.width()) as usize * 3;
                let length = rect.width() as usize * 3;
                linear[to..to + length].copy_from_slice(&from_linear[from..from + length]);
                bytes[to..to + length].copy_from_slice(&from_bytes[from..from + length]);
            }
        }
        (linear, bytes)
    }

    /// The reference's, with the pipeline's points and grid.
    fn reference(&self, state: &FrameState, view: &View) -> Picture {
        reference::sample(&self.world(), state, view, &like_pipeline(view.samples))
    }
}

fn points(samples: Samples) -> Vec<[f64; 2]> {
    let pattern = Pattern::of(samples);
    pattern.points[..pattern.count].iter().map(|p| p.map(|c| f64::from(c) / 256.0)).collect()
}

fn like_pipeline(samples: Samples) -> Options {
    Options::like(Vertices::Rounded(Grid::PIPELINE), &points(samples))
}

fn state(eye: Pose) -> FrameState {
    FrameState {
        frame: FrameNumber(0),
        epoch: Epoch(1),
        eye,
        environment: Environment::default(),
        debug: DebugPicture::Off,
    }
}

fn view(width: u32, height: u32, tangents: Tangents, samples: Samples) -> View {
    View { offset: Pose::IDENTITY, tangents, width, height, near: View::NEAR_DEFAULT, samples }
}

/// The folder of real models, or `None` with a loud word.
fn data() -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("CYCLORAMA_DATA").map_or(default, PathBuf::from);
    if folder.join("models").is_dir() {
        return Some(folder);
    }
    println!("SKIPPED: no models at {}; set CYCLORAMA_DATA", folder.display());
    None
}

/// Numbers that look random and are the same every time (`SplitMix64`).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    fn below(&mut self, n: u32) -> u32 {
        (self.unit() * f64::from(n)) as u32
    }

    fn vector(&mut self, size: f64) -> DVec3 {
        DVec3::new(self.between(-size, size), self.between(-size, size), self.between(-size, size))
    }
}

/// Triangles of one material, three points each.
fn mesh(points: &[DVec3], material: Material) -> Mesh {
    let count = points.len() as u32 / 3;
    let reach = points.iter().map(|p| p.length()).fold(0.0, f64::max) + 1.0;
    Mesh {
        origin: DVec3::ZERO,
        positions: points.iter().map(|p| p.as_vec3().to_array()).collect(),
        normals: Vec::new(),
        colors: Vec::new(),
        texcoords: Vec::new(),
        triangles: (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        face_numbers: (0..count).collect(),
        material,
        sphere: Sphere { centre: DVec3::ZERO, radius: reach },
        bounds: Box3 { min: DVec3::splat(-reach), max: DVec3::splat(reach) },
    }
}

/// Faces of every size, opaque, translucent, lit and not, single- and double-sided, some behind the eye.
fn random_content(random: &mut Random, faces: u32) -> Content {
    let mut content = Content::default();
    for _ in 0..faces {
        let size = [0.03, 0.3, 3.0, 40.0][random.below(4) as usize];
        let centre = DVec3::new(random.between(-4.0, 4.0), random.between(-3.0, 3.0), random.between(-9.0, -0.5));
        let points: [DVec3; 3] = std::array::from_fn(|_| centre + random.vector(size));
        let base_color = [random.unit(), random.unit(), random.unit(), random.unit()].map(|c| c as f32);
        let material = Material {
            base_color,
            alpha: if random.below(2) == 0 { Alpha::Opaque } else { Alpha::Blend },
            double_sided: random.below(2) == 0,
            unlit: random.below(2) == 0,
            ..Material::default()
        };
        let mut mesh = mesh(&points, material);
        if random.below(2) == 0 {
            mesh.normals = (0..3).map(|_| random.vector(1.0).normalize().as_vec3().to_array()).collect();
        }
        if random.below(2) == 0 {
            mesh.colors = (0..3).map(|_| [0; 4].map(|_| random.unit() as f32)).collect();
        }
        let turn = DQuat::from_axis_angle(random.vector(1.0).normalize(), random.between(0.0, 0.1));
        let scale = match random.below(4) {
            0 => DVec3::new(1.0, 0.5, 2.0),
            1 => DVec3::new(-1.0, 1.0, 1.0),
            _ => DVec3::ONE,
        };
        content.add(mesh, DAffine3::from_scale_rotation_translation(scale, turn, DVec3::ZERO));
    }
    content
}

/// One pose of a scene's camera: the content with entities where the pose puts them, the frame and the lens.
fn posed(scene: &Scene, pose: &CameraPose) -> (Content, FrameState) {
    let mut content = Content::of(scene);
    let mut entities = Entities::new(scene);
    for entity in &pose.entities {
        let node = scene.node_by_name(&entity.node).unwrap();
        let at = Pose::checked(DVec3::from_array(entity.position), DQuat::from_array(entity.orientation)).unwrap();
        entities.set(scene, node, at);
    }
    entities.moved(&mut content.moved);
    (content, state(pose.pose().unwrap()))
}

fn orbit(scene: &Scene) -> CameraPose {
    CameraFile::orbit(scene.sphere).poses[0].clone()
}

fn airport() -> (Scene, CameraFile) {
    let built = builtin::build("airport").unwrap();
    (import::load_glb(&built.glb, built.name).unwrap(), built.camera)
}

fn report(content: &Content, state: &FrameState, view: &View) -> Report {
    let (linear, _) = content.draw(state, view);
    compare(Shown::Linear(&linear), &content.reference(state, view))
}
