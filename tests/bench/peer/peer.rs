//! One frame: cull, sort, draw, wait.

use crate::frustum::{Frustum, runs, view_projection};
use crate::geometry::{Baked, Batch, Unsupported, bake};
use crate::gl::{Context, Format, Geometry, GlError, Program, State, Target};
use glam::DVec3;
use proto::ids::ContentId;
use proto::scene::{Mesh, SceneTable};
use proto::view::{Pose, Tangents};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;
use thiserror::Error;

/// Lighting per vertex: what is timed.
const VERTEX: &str = "#version 330
uniform mat4 view_projection; uniform vec3 sun;
layout(location = 0) in vec3 position; layout(location = 1) in vec3 normal; layout(location = 2) in vec4 rgba;
out vec4 color;
void main() {
    gl_Position = view_projection * vec4(position, 1.0);
    color = vec4(rgba.rgb * (0.3 + 0.7 * max(0.0, dot(normal, sun))), rgba.a);
}";
const FRAGMENT: &str = "#version 330
in vec4 color; out vec4 result;
void main() { result = color; }";

/// Lighting per pixel, as picture.md has it: what errors are told from.
const FINE_VERTEX: &str = "#version 330
uniform mat4 view_projection;
layout(location = 0) in vec3 position; layout(location = 1) in vec3 normal; layout(location = 2) in vec4 rgba;
out vec3 toward; out vec4 base;
void main() {
    gl_Position = view_projection * vec4(position, 1.0);
    toward = normal; base = rgba;
}";
const FINE_FRAGMENT: &str = "#version 330
uniform vec3 sun;
in vec3 toward; in vec4 base; out vec4 result;
void main() {
    vec3 n = normalize(gl_FrontFacing ? toward : -toward);
    result = vec4(base.rgb * (0.3 + 0.7 * max(0.0, dot(n, sun))), base.a);
}";

/// What is looked at, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Look {
    /// Width and height of the picture, pixels.
    pub size: [u32; 2],
    /// Samples of a pixel; 0: no multisampling.
    pub samples: u32,
    /// Of the view, world frame.
    pub pose: Pose,
    /// Its window.
    pub tangents: Tangents,
    /// Its near plane, m.
    pub near: f64,
    /// Unit vector towards the sun, world frame. It gives 0.7 of the light and its surroundings 0.3.
    pub sun: DVec3,
    /// Behind everything, linear RGB.
    pub background: [f32; 3],
}

/// What a frame took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drawn {
    /// Until the finished picture was in memory.
    pub ms: f64,
    /// Triangles given to the driver.
    pub triangles: u64,
}

/// Why there is no peer, or no frame.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PeerError {
    /// The machine or the driver.
    #[error(transparent)]
    Gl(#[from] GlError),
    /// The scene.
    #[error(transparent)]
    Unsupported(#[from] Unsupported),
}

/// A scene in llvmpipe's hands.
#[derive(Debug)]
pub struct Peer {
    context: Context,
    geometry: Geometry,
    passes: Vec<(State, Vec<Batch>)>,
    translucent: Vec<Batch>,
    timed: Program,
    fine: Program,
    /// By size and samples; made when first asked for.
    targets: BTreeMap<([u32; 2], u32), Target>,
    order: Vec<(f64, usize)>,
}

impl Peer {
    /// Takes a scene in. A process can do this once; see [`GlError::Twice`].
    ///
    /// # Errors
    /// When there is no llvmpipe, or the scene has what the peer doesn't draw.
    pub fn new(table: &SceneTable, meshes: &BTreeMap<ContentId, Arc<Mesh>>) -> Result<Self, PeerError> {
        let Baked { vertices, indices, passes, translucent } = bake(table, meshes)?;
        let context = Context::new()?;
        let geometry = context.geometry(&vertices, &indices)?;
        let timed = context.program(VERTEX, FRAGMENT)?;
        let fine = context.program(FINE_VERTEX, FINE_FRAGMENT)?;
        let (targets, order) = (BTreeMap::new(), Vec::new());
        Ok(Self { context, geometry, passes, translucent, timed, fine, targets, order })
    }

    /// The driver's name.
    pub fn renderer(&self) -> &str {
        &self.context.renderer
    }

    /// Most samples of a pixel that it offers.
    pub fn samples_max(&self) -> u32 {
        self.context.samples_max
    }

    /// Draws a frame of 8 bits a channel and says how long that took, from culling to the finished picture in memory.
    ///
    /// # Errors
    /// [`GlError`]
    pub fn draw(&mut self, look: &Look) -> Result<Drawn, PeerError> {
        let kind = (look.size, look.samples);
        if !self.targets.contains_key(&kind) {
            let target = self.context.target(look.size, look.samples, Format::Rgba8)?;
            self.targets.insert(kind, target);
        }
        let target = &self.targets[&kind];
        let started = Instant::now();
        let scene = (&self.passes[..], &self.translucent[..]);
        let triangles = frame(&self.context, target, &self.timed, &self.geometry, scene, look, &mut self.order);
        let ms = started.elapsed().as_secs_f64() * 1e3;
        self.context.check()?;
        Ok(Drawn { ms, triangles })
    }

    /// The best picture that it can make of this look: linear RGB floats, row-major, `width × height × 3`.
    ///
    /// # Errors
    /// [`GlError`]
    pub fn picture(&mut self, look: &Look) -> Result<Vec<f32>, PeerError> {
        let target = self.context.target(look.size, look.samples, Format::Rgba32F)?;
        let scene = (&self.passes[..], &self.translucent[..]);
        frame(&self.context, &target, &self.fine, &self.geometry, scene, look, &mut self.order);
        Ok(self.context.read(&target)?)
    }
}

/// Draws one frame; the number of triangles given to the driver.
fn frame(
    context: &Context,
    target: &Target,
    program: &Program,
    geometry: &Geometry,
    (passes, translucent): (&[(State, Vec<Batch>)], &[Batch]),
    look: &Look,
    order: &mut Vec<(f64, usize)>,
) -> u64 {
    let matrix = view_projection(look.pose, &look.tangents, look.near).as_mat4();
    let frustum = Frustum::new(look.pose, &look.tangents, look.near);
    let mut indices = 0;
    let mut draw = |range: std::ops::Range<u32>| {
        indices += u64::from(range.end - range.start);
        context.draw(geometry, range);
    };
    context.begin(target, program, look.background);
    context.look(program, &matrix.to_cols_array(), look.sun.as_vec3().to_array());
    for (state, batches) in passes {
        frustum.nearest_first(batches, order);
        context.state(*state);
        runs(batches, order).for_each(&mut draw);
    }
    frustum.nearest_first(translucent, order);
    for (_, k) in order.iter().rev() {
        context.state(translucent[*k].state);
        draw(translucent[*k].indices.clone());
    }
    context.end(target);
    indices / 3
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::ids::ObjectId;
    use proto::scene::{Box3, Material, ObjectRow, Sphere, SubobjectRow};

    /// A square metre of one colour in the plane z = `z`, `layer` above others there.
    fn square(color: [f32; 4], z: f32) -> Mesh {
        let material = Material { base_color: color, ..Material::default() };
        Mesh {
            origin: DVec3::ZERO,
            positions: vec![[-0.5, -0.5, z], [0.5, -0.5, z], [0.5, 0.5, z], [-0.5, 0.5, z]],
            normals: Vec::new(),
            colors: Vec::new(),
            texcoords: Vec::new(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            face_numbers: vec![0, 1],
            material,
            sphere: Sphere { centre: DVec3::ZERO, radius: 9.0 },
            bounds: Box3 { min: DVec3::ZERO, max: DVec3::ONE },
        }
    }

    /// Needs llvmpipe; the one test of this process that makes a context.
    #[test]
    fn a_picture_has_the_formulas_colors_at_the_right_places() {
        let meshes = [(square([1.0, 0.0, 0.0, 1.0], -1.0), 0), (square([0.0, 1.0, 0.0, 1.0], -1.0), 1)];
        let mut table = SceneTable::default();
        table.objects.push(ObjectRow { transform: glam::DAffine3::IDENTITY });
        // A smaller square over the first, in the same plane one layer higher, to the left of the middle and above it.
        let up_left = glam::DAffine3::from_scale_rotation_translation(
            DVec3::new(0.25, 0.25, 1.0),
            glam::DQuat::IDENTITY,
            DVec3::new(-0.25, 0.25, 0.0),
        );
        table.objects.push(ObjectRow { transform: up_left });
        let mut all = BTreeMap::new();
        for (k, (mesh, layer)) in meshes.into_iter().enumerate() {
            let (mesh_id, number) = (ContentId([k as u8; 16]), k as u32);
            let (object, part_of, planes) = (ObjectId(number), None, None);
            table.subobjects.push(SubobjectRow { object, mesh: mesh_id, primitive: number, layer, part_of, planes });
            all.insert(mesh_id, Arc::new(mesh));
        }
        let mut peer = match Peer::new(&table, &all) {
            Ok(peer) => peer,
            // The suite must pass on machines without Mesa.
            Err(error) => return println!("not drawn here: {error}"),
        };
        for samples in [0, 4] {
            let look = Look {
                size: [64, 64],
                samples,
                pose: Pose::IDENTITY,
                tangents: Tangents { left: -1.0, right: 1.0, bottom: -1.0, top: 1.0 },
                near: 0.1,
                sun: DVec3::Z,
                background: [0.1, 0.2, 0.3],
            };
            let drawn = peer.draw(&look).unwrap();
            assert!(drawn.triangles == 4 && drawn.ms > 0.0, "{drawn:?}");
            let picture = peer.picture(&look).unwrap();
            let pixel = |x: usize, y: usize| &picture[(y * 64 + x) * 3..][..3];
            let near = |a: &[f32], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
            assert!(near(pixel(2, 2), [0.1, 0.2, 0.3]), "background {:?}", pixel(2, 2));
            assert!(near(pixel(40, 40), [1.0, 0.0, 0.0]), "lower right {:?}", pixel(40, 40));
            assert!(near(pixel(24, 24), [0.0, 1.0, 0.0]), "upper left, one layer higher {:?}", pixel(24, 24));
        }
    }
}
