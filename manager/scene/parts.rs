//! What a scene is made of, as an importer or a test hands it over, and why parts may not fit together.

use super::bounds;
use super::bvh::Bvh;
use super::database::{MaterialEntry, Piece, Shape, ShapeIndex};
use super::extras::Extras;
use glam::{DAffine3, DQuat};
use proto::codec::{encode_mesh, encode_texture};
use proto::ids::ContentId;
use proto::scene::{LightKind, Mesh, Sphere, Texture};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;
use thiserror::Error;

/// A node as an importer hands it over.
#[derive(Clone, Debug, Default)]
pub struct NodeSource {
    /// Name, or empty.
    pub name: String,
    /// Index of the parent in the same list; smaller than the node's own, so that the list is depth-first.
    pub parent: Option<u32>,
    /// This node's space → its parent's.
    pub local: DAffine3,
    /// The rotation in it, a unit quaternion.
    pub rotation: DQuat,
    /// What the node shows.
    pub shape: Option<ShapeIndex>,
    /// What its extras say, without what it inherits.
    pub extras: Extras,
    /// If it begins a level-of-detail model: of how many versions, at least 2; otherwise 0.
    pub levels: u32,
    /// If it is the root of a version of the nearest model that begins at or above it: which, 0 the finest.
    pub version: Option<u32>,
    /// What shines from it.
    pub light: Option<LightSource>,
}

/// A light as it stands in its node: at the origin, shining along −Z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSource {
    /// Kind and shape.
    pub kind: LightKind,
    /// Colour times intensity.
    pub intensity: [f32; 3],
}

/// A piece of a mesh and what the database must know beside its geometry.
#[derive(Clone, Debug)]
pub struct PieceSource {
    /// The geometry.
    pub mesh: Mesh,
    /// Index of its material in [`Parts::materials`].
    pub material: u32,
    /// Which primitive of the mesh it is a part of, counted from 0; all pieces of one stand together.
    pub primitive: u32,
    /// What primitive and material say, together.
    pub extras: Extras,
}

impl PieceSource {
    /// Pieces of a mesh's only primitive, about which nothing special is said.
    pub fn plain(pieces: Vec<Mesh>, material: u32) -> Vec<Self> {
        let plain = |mesh| Self { mesh, material, primitive: 0, extras: Extras::default() };
        pieces.into_iter().map(plain).collect()
    }
}

/// What a scene is made of.
#[derive(Clone, Debug, Default)]
pub struct Parts {
    /// Name of the scene.
    pub name: String,
    /// All nodes, depth-first: each follows its parent or one of its parent's descendants.
    pub nodes: Vec<NodeSource>,
    /// Shapes, as [`Parts::add_shape`] numbered them.
    pub shapes: Vec<Shape>,
    /// Materials, as [`Parts::add_shape`] was told.
    pub materials: Vec<MaterialEntry>,
    /// Geometry, by content.
    pub meshes: BTreeMap<ContentId, Arc<Mesh>>,
    /// Textures, by content.
    pub textures: BTreeMap<ContentId, Arc<Texture>>,
    /// Warnings.
    pub warnings: Vec<String>,
}

/// Why parts don't make a scene. The file's fault.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum AssembleError {
    /// A node's transformation, or what it places, is beyond the numbers' range.
    #[error(
        "{node} lies beyond the range of numbers (|coordinate| < {limit:e} m); check its transformation and those above it"
    )]
    OutOfRange {
        /// The node, `node "name"` or `node 12`.
        node: String,
        /// Largest usable coordinate.
        limit: f64,
    },
    /// A model below a model.
    #[error(
        "{node} {how} inside {outer}, which is merged or has levels of detail itself; take one of the marks away, or move it out"
    )]
    NestedModel {
        /// The node, `node "name"` or `node 12`.
        node: String,
        /// `is merged` or `has levels of detail`.
        how: &'static str,
        /// The node that begins the outer model.
        outer: String,
    },
    /// Two nodes with one entity number.
    #[error("{node} has the entity number {number}, which {other} has already; give it another one")]
    EntityTwice {
        /// The second node.
        node: String,
        /// The first node.
        other: String,
        /// The number.
        number: u64,
    },
    /// Too much of something.
    #[error("{count} {what}, at most {limit} are possible; split the scene")]
    TooMany {
        /// Objects or subobjects.
        what: &'static str,
        /// How many there would be.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
}

/// Largest world coordinate, m. Far beyond the universe, yet its sixth power is still a number, so that no culling
/// formula can overflow.
pub const COORDINATE_MAX: f64 = 1e40;

impl Parts {
    /// Stores `texture` and returns its name.
    pub fn add_texture(&mut self, texture: Texture) -> ContentId {
        let id = ContentId::of(&encode_texture(&texture));
        self.textures.entry(id).or_insert_with(|| Arc::new(texture));
        id
    }

    /// Stores a mesh of the file that was cut into `pieces`; `None` if there are none. `extras` are the mesh's own.
    pub fn add_shape(&mut self, name: &str, extras: Extras, pieces: Vec<PieceSource>) -> Option<ShapeIndex> {
        let named: Vec<(ContentId, PieceSource)> =
            pieces.into_par_iter().map(|piece| (ContentId::of(&encode_mesh(&piece.mesh)), piece)).collect();
        let rows: Vec<Piece> = named
            .iter()
            .map(|(id, PieceSource { mesh, material, primitive, extras: own })| Piece {
                mesh: *id,
                sphere: mesh.sphere,
                bounds: mesh.bounds,
                triangles: mesh.triangles.len() as u32,
                vertices: mesh.positions.len() as u32,
                material: *material,
                primitive: *primitive,
                layer: own.layer.or(extras.layer),
                merged: own.merged.or(extras.merged) == Some(true),
            })
            .collect();
        let around = rows.iter().map(|piece| piece.bounds).reduce(bounds::box_union)?;
        let spheres: Vec<Sphere> = rows.iter().map(|piece| piece.sphere).collect();
        for (id, piece) in named {
            self.meshes.entry(id).or_insert_with(|| Arc::new(piece.mesh));
        }
        self.shapes.push(Shape {
            name: name.to_owned(),
            extras,
            pieces: rows,
            sphere: bounds::ball_of_balls(spheres.iter()),
            bounds: around,
            tree: Bvh::build(&spheres),
        });
        Some(ShapeIndex(self.shapes.len() as u32 - 1))
    }
}
