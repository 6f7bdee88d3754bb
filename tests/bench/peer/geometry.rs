//! A scene as llvmpipe likes it best: everything in world space in one vertex buffer, cut into batches that are culled,
//! sorted and drawn as pieces.
//!
//! llvmpipe transforms vertices in the calling thread and pays for every draw call, so instances cost more than the
//! memory that baking them takes. Opaque batches are filled with neighbours of the file's order until they have
//! [`TRIANGLES_PER_BATCH`]; translucent ones hold one primitive of one object, because they are sorted.

use crate::gl::{State, Vertex};
use glam::{DAffine3, DMat3, DVec3};
use proto::ids::{ContentId, SubobjectId};
use proto::scene::{Alpha, Mesh, SceneTable};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use thiserror::Error;

/// Triangles that close an opaque batch. Processor time of `llvmpipe.py` hardly depends on it (from 256 to 4096 by less
/// than the spread of its measurements), but for `city`, where small batches cost a tenth more.
const TRIANGLES_PER_BATCH: usize = 4096;
/// A piece of so many triangles closes its batch too, so that it has its own place in the order from front to back. Batches
/// of neighbours alone put all of `overdraw` into one, and hidden walls then cost a sixth more processor time. Large enough
/// for the many small things of `city` and `dense` to stay together.
const TRIANGLES_OF_ITS_OWN: usize = 100;

/// What the peer does not draw. It is there to be timed on the benchmark's scenes, which have none of it.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Unsupported {
    /// A material with something that the peer's shaders don't know.
    #[error("subobject {subobject} has {what}, which the peer does not draw")]
    Material {
        /// Whose.
        subobject: SubobjectId,
        /// What it is.
        what: &'static str,
    },
    /// Models that merge or have versions.
    #[error("the scene has models that merge layers or have versions, which the peer does not draw")]
    Models,
    /// The table names what isn't there: the caller's mistake.
    #[error("subobject {subobject} names a mesh or an object that is not there")]
    Missing {
        /// Which row.
        subobject: SubobjectId,
    },
    /// More than 32 bits count.
    #[error("the scene has more vertices than the peer counts")]
    TooMany,
}

/// A stretch of the indices that is drawn whole or not at all.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Batch {
    pub(crate) indices: Range<u32>,
    /// Encloses it; world, m.
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    pub(crate) state: State,
}

/// A scene in world space.
#[derive(Clone, Debug, Default)]
pub(crate) struct Baked {
    pub(crate) vertices: Vec<Vertex>,
    pub(crate) indices: Vec<u32>,
    /// By layer, then in the order of the file: a pass for each state.
    pub(crate) passes: Vec<(State, Vec<Batch>)>,
    /// In the order of the file.
    pub(crate) translucent: Vec<Batch>,
}

/// Bakes a scene where its table puts it.
pub(crate) fn bake(table: &SceneTable, meshes: &BTreeMap<ContentId, Arc<Mesh>>) -> Result<Baked, Unsupported> {
    if !table.models.is_empty() {
        return Err(Unsupported::Models);
    }
    // By state: (primitive, mesh, transformation) in the order of the file.
    type Piece<'a> = (u32, &'a Mesh, DAffine3);
    let mut opaque: BTreeMap<(i32, bool), Vec<Piece<'_>>> = BTreeMap::new();
    let mut translucent: BTreeMap<u32, (State, Vec<Piece<'_>>)> = BTreeMap::new();
    for (row, number) in table.subobjects.iter().zip(0..) {
        let subobject = SubobjectId(number);
        let missing = Unsupported::Missing { subobject };
        let mesh = meshes.get(&row.mesh).ok_or_else(|| missing.clone())?;
        let object = table.objects.get(row.object.0 as usize).ok_or(missing)?;
        let blend = is_blended(mesh, subobject)?;
        let double_sided = mesh.material.double_sided;
        let piece = (row.primitive, mesh.as_ref(), object.transform);
        if blend {
            let state = State { double_sided, layer: row.layer, blend };
            translucent.entry(row.primitive).or_insert_with(|| (state, Vec::new())).1.push(piece);
        } else {
            opaque.entry((row.layer, double_sided)).or_default().push(piece);
        }
    }
    let mut baked = Baked::default();
    for ((layer, double_sided), pieces) in opaque {
        let state = State { double_sided, layer, blend: false };
        let mut batches = Vec::new();
        let mut start = baked.indices.len();
        for (k, (_, mesh, transform)) in pieces.iter().enumerate() {
            baked.add(mesh, transform)?;
            let is_full = baked.indices.len() - start >= 3 * TRIANGLES_PER_BATCH;
            if is_full || mesh.triangles.len() >= TRIANGLES_OF_ITS_OWN || k + 1 == pieces.len() {
                batches.push(baked.batch(start, state)?);
                start = baked.indices.len();
            }
        }
        baked.passes.push((state, batches));
    }
    for (state, pieces) in translucent.into_values() {
        let start = baked.indices.len();
        for (_, mesh, transform) in pieces {
            baked.add(mesh, &transform)?;
        }
        let batch = baked.batch(start, state)?;
        baked.translucent.push(batch);
    }
    Ok(baked)
}

/// Whether a mesh's saturation counts; refused if the mesh has anything beyond plain colours.
fn is_blended(mesh: &Mesh, subobject: SubobjectId) -> Result<bool, Unsupported> {
    let material = &mesh.material;
    let refused = |what| Err(Unsupported::Material { subobject, what });
    if material.base_texture.is_some() || material.emissive_texture.is_some() {
        return refused("a texture");
    }
    if material.emissive != [0.0; 3] {
        return refused("an emissive colour");
    }
    if material.unlit {
        return refused("an unlit material");
    }
    match material.alpha {
        Alpha::Opaque => Ok(false),
        Alpha::Blend => Ok(true),
        Alpha::Mask { .. } => refused("a cut-out material"),
    }
}

impl Baked {
    fn add(&mut self, mesh: &Mesh, transform: &DAffine3) -> Result<(), Unsupported> {
        // A mirror turns the faces round, and a face's winding is that in its mesh (glTF 2.0, 3.7.4).
        let is_mirrored = transform.matrix3.determinant() < 0.0;
        let normal_matrix = transform.matrix3.inverse().transpose();
        let color = |i: usize| {
            let own = mesh.colors.get(i).copied().unwrap_or([1.0; 4]);
            let base = mesh.material.base_color;
            std::array::from_fn(|k| (own[k] * base[k] * 65535.0).clamp(0.0, 65535.0).round() as u16)
        };
        let vertex = |i: usize, normal: DVec3| Vertex {
            position: transform.transform_point3(mesh.position(i)).as_vec3().to_array(),
            normal: normal.as_vec3().to_array(),
            color: color(i),
        };
        let normals: Vec<DVec3> = mesh.normals.iter().map(|n| world_normal(&normal_matrix, *n)).collect();
        // Corners whose normal is the face's own can't be shared; all others are.
        let mut shared: Vec<Option<u32>> = vec![None; mesh.positions.len()];
        for triangle in &mesh.triangles {
            let corners = triangle.map(|i| i as usize);
            let [a, b, c] = corners.map(|i| transform.transform_point3(mesh.position(i)));
            let own = (b - a).cross(c - a).normalize_or_zero() * if is_mirrored { -1.0 } else { 1.0 };
            let mut placed = [0; 3];
            for (place, i) in placed.iter_mut().zip(corners) {
                let normal = normals.get(i).copied().filter(|n| *n != DVec3::ZERO);
                let next = u32::try_from(self.vertices.len()).map_err(|_| Unsupported::TooMany)?;
                *place = match (normal, shared[i]) {
                    (Some(_), Some(known)) => known,
                    (normal, _) => {
                        self.vertices.push(vertex(i, normal.unwrap_or(own)));
                        shared[i] = normal.map(|_| next);
                        next
                    }
                };
            }
            if is_mirrored {
                placed.swap(1, 2);
            }
            self.indices.extend(placed);
        }
        Ok(())
    }

    /// What was added since there were `start` indices, as one batch.
    fn batch(&self, start: usize, state: State) -> Result<Batch, Unsupported> {
        let count = |n: usize| u32::try_from(n).map_err(|_| Unsupported::TooMany);
        let points = || {
            let own = self.indices[start..].iter();
            own.map(|&i| DVec3::from_array(self.vertices[i as usize].position.map(f64::from)))
        };
        let (min, max) = points().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), p| (a.min(p), b.max(p)));
        let centre = if min.x <= max.x { (min + max) / 2.0 } else { DVec3::ZERO };
        let radius = points().map(|p| p.distance(centre)).fold(0.0, f64::max);
        Ok(Batch { indices: count(start)?..count(self.indices.len())?, centre, radius, state })
    }
}

fn world_normal(matrix: &DMat3, normal: [f32; 3]) -> DVec3 {
    (*matrix * DVec3::from_array(normal.map(f64::from))).normalize_or_zero()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::ids::ObjectId;
    use proto::scene::{Box3, Material, ObjectRow, Sphere, SubobjectRow, TextureUse, Wrap};

    fn triangle(material: Material) -> Mesh {
        Mesh {
            origin: DVec3::X,
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            normals: Vec::new(),
            colors: Vec::new(),
            texcoords: Vec::new(),
            triangles: vec![[0, 1, 2]],
            face_numbers: vec![0],
            material,
            sphere: Sphere { centre: DVec3::ZERO, radius: 3.0 },
            bounds: Box3 { min: DVec3::ZERO, max: DVec3::ONE },
        }
    }

    /// Each mesh in an object of its own, moved along by `step`.
    fn scene(meshes: Vec<(Mesh, i32)>, step: DAffine3) -> (SceneTable, BTreeMap<ContentId, Arc<Mesh>>) {
        let mut table = SceneTable::default();
        let mut all = BTreeMap::new();
        let mut transform = DAffine3::IDENTITY;
        for (k, (mesh, layer)) in meshes.into_iter().enumerate() {
            let (number, id) = (k as u32, ContentId([k as u8; 16]));
            all.insert(id, Arc::new(mesh));
            table.objects.push(ObjectRow { transform });
            let (object, part_of, planes) = (ObjectId(number), None, None);
            table.subobjects.push(SubobjectRow { object, mesh: id, primitive: number, layer, part_of, planes });
            transform = step * transform;
        }
        (table, all)
    }

    fn glass() -> Material {
        Material { alpha: Alpha::Blend, base_color: [1.0, 0.5, 0.0, 0.25], ..Material::default() }
    }

    #[test]
    fn opaque_neighbours_share_a_batch_and_layers_and_glass_do_not() {
        let plain = || triangle(Material::default());
        let meshes = vec![(plain(), 0), (triangle(glass()), 0), (plain(), 1), (plain(), 0), (triangle(glass()), 0)];
        let (table, meshes) = scene(meshes, DAffine3::from_translation(DVec3::X * 10.0));
        let baked = bake(&table, &meshes).unwrap();
        let counts: Vec<_> = baked.passes.iter().map(|(state, batches)| (state.layer, batches.len())).collect();
        assert_eq!(counts, [(0, 1), (1, 1)]);
        assert_eq!(baked.passes[0].1[0].indices, 0..6, "two triangles of layer 0");
        assert_eq!(baked.translucent.len(), 2, "glass is sorted by object");
        let batch = &baked.passes[0].1[0];
        assert!(batch.centre.x > 10.0 && batch.radius < 17.0, "{batch:?}");
        let last = baked.vertices[baked.indices[baked.translucent[1].indices.start as usize] as usize];
        assert_eq!(last.position, [41.0, 0.0, 0.0], "the mesh's origin and the object's place are added");
        assert_eq!(last.color, [65535, 32768, 0, 16384]);
    }

    #[test]
    fn a_large_piece_ends_its_batch() {
        let mut large = triangle(Material::default());
        large.triangles = vec![[0, 1, 2]; TRIANGLES_OF_ITS_OWN];
        let small = || (triangle(Material::default()), 0);
        let (table, meshes) = scene(vec![(large, 0), small(), small()], DAffine3::IDENTITY);
        let baked = bake(&table, &meshes).unwrap();
        let ranges: Vec<_> = baked.passes[0].1.iter().map(|batch| batch.indices.len() / 3).collect();
        assert_eq!(ranges, [TRIANGLES_OF_ITS_OWN, 2]);
    }

    #[test]
    fn a_face_without_normals_has_its_own_also_in_a_mirror() {
        let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        let plain = || triangle(Material::default());
        let (table, meshes) = scene(vec![(plain(), 0), (plain(), 0)], mirror);
        let baked = bake(&table, &meshes).unwrap();
        for face in baked.indices.chunks(3) {
            let [a, b, c] = [0, 1, 2].map(|k| baked.vertices[face[k] as usize]);
            let [p, q, r] = [a, b, c].map(|v| DVec3::from_array(v.position.map(f64::from)));
            assert_eq!(a.normal, [0.0, 0.0, 1.0]);
            assert!((q - p).cross(r - p).z > 0.0, "seen from the same side as in the file");
        }
    }

    #[test]
    fn corners_with_normals_are_shared() {
        let mut quad = triangle(Material::default());
        quad.positions.push([1.0, 1.0, 0.0]);
        quad.normals = vec![[0.0, 0.0, 1.0]; 4];
        quad.triangles.push([1, 3, 2]);
        let (table, meshes) = scene(vec![(quad, 0)], DAffine3::IDENTITY);
        let baked = bake(&table, &meshes).unwrap();
        assert_eq!((baked.vertices.len(), baked.indices.len()), (4, 6));
    }

    #[test]
    fn what_the_peer_does_not_draw_is_refused_by_name() {
        let texture = TextureUse {
            texture: ContentId([0; 16]),
            set: 0,
            transform: proto::scene::TRANSFORM_IDENTITY,
            wrap_u: Wrap::Clamp,
            wrap_v: Wrap::Clamp,
            magnify: proto::scene::Filter::Linear,
        };
        for (material, said) in [
            (Material { base_texture: Some(texture), ..Material::default() }, "a texture"),
            (Material { unlit: true, ..Material::default() }, "unlit"),
            (Material { emissive: [1.0; 3], ..Material::default() }, "emissive"),
            (Material { alpha: Alpha::Mask { cutoff: 0.5 }, ..Material::default() }, "cut-out"),
        ] {
            let (table, meshes) = scene(vec![(triangle(material), 0)], DAffine3::IDENTITY);
            let error = bake(&table, &meshes).unwrap_err().to_string();
            assert!(error.contains(said), "{error}");
        }
    }
}
