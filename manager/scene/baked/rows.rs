//! The rows of a baked file's tables: plain little-endian records, each with the way from and to what the scene holds.
//!
//! Numbers keep their bits. What a row names by number (a shape, a mesh, a texture) is checked by `open`, which knows how many there
//! are; here only what one row says by itself.

use crate::scene::bvh::Branch;
use crate::scene::{Extras, LightSource, NodeSource, ShapeIndex};
use bytemuck::{Pod, Zeroable};
use glam::{DAffine3, DQuat, DVec3};
use proto::scene::{Alpha, Box3, Filter, LightKind, Material, NO_PLANE, PlaneRow as Plane, Sphere, TextureUse, Wrap};

/// No parent, no shape, no light, no texture, no version.
pub(super) const NONE: u32 = u32::MAX;

/// A row's number that may be absent.
pub(super) fn some(number: u32) -> Option<u32> {
    (number != NONE).then_some(number)
}

/// What a modeller said; bits of `flags`: two each for merged, surface, cue, static (0: nothing, 1: no, 2: yes), then one each for
/// layer, critical radius, entity.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct ExtrasRow {
    critical_radius: f64,
    entity: u64,
    layer: i32,
    flags: u32,
}

const LAYER: u32 = 1 << 8;
const RADIUS: u32 = 1 << 9;
const ENTITY: u32 = 1 << 10;

impl ExtrasRow {
    /// Names of levels are left out: the importer has followed them already.
    pub(super) fn of(extras: &Extras) -> Self {
        let word = |said: Option<bool>| said.map_or(0, |yes| 1 + u32::from(yes));
        let Extras { layer, merged, surface, critical_radius, cue, is_static, levels: _, entity } = extras;
        let mut flags = word(*merged) | word(*surface) << 2 | word(*cue) << 4 | word(*is_static) << 6;
        for (bit, is_there) in
            [(LAYER, layer.is_some()), (RADIUS, critical_radius.is_some()), (ENTITY, entity.is_some())]
        {
            flags |= if is_there { bit } else { 0 };
        }
        Self {
            critical_radius: critical_radius.unwrap_or(0.0),
            entity: entity.unwrap_or(0),
            layer: layer.unwrap_or(0),
            flags,
        }
    }

    pub(super) fn extras(&self) -> Result<Extras, String> {
        let word = |at: u32| match self.flags >> at & 3 {
            0 => Ok(None),
            1 => Ok(Some(false)),
            2 => Ok(Some(true)),
            _ => Err(unknown("flags", self.flags)),
        };
        if self.flags >= ENTITY << 1 {
            return Err(unknown("flags", self.flags));
        }
        let has = |bit| self.flags & bit != 0;
        let critical_radius = has(RADIUS).then_some(self.critical_radius);
        if critical_radius.is_some_and(|radius| !(radius > 0.0 && radius.is_finite())) {
            return Err(format!("a critical radius of {} m", self.critical_radius));
        }
        Ok(Extras {
            layer: has(LAYER).then_some(self.layer),
            merged: word(0)?,
            surface: word(2)?,
            cue: word(4)?,
            is_static: word(6)?,
            critical_radius,
            levels: None,
            entity: has(ENTITY).then_some(self.entity),
        })
    }
}

/// A node as the importer handed it over; its name is in the text.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct NodeRow {
    local: [f64; 12],
    rotation: [f64; 4],
    extras: ExtrasRow,
    parent: u32,
    shape: u32,
    light: u32,
    levels: u32,
    version: u32,
    zero: u32,
}

impl NodeRow {
    /// `light` is the number of its light.
    pub(super) fn of(node: &NodeSource, light: Option<u32>) -> Self {
        Self {
            local: node.local.to_cols_array(),
            rotation: node.rotation.to_array(),
            extras: ExtrasRow::of(&node.extras),
            parent: node.parent.unwrap_or(NONE),
            shape: node.shape.map_or(NONE, |shape| shape.0),
            light: light.unwrap_or(NONE),
            levels: node.levels,
            version: node.version.unwrap_or(NONE),
            zero: 0,
        }
    }

    /// The node, but for its name and light, and the number of its light.
    pub(super) fn node(&self) -> Result<(NodeSource, Option<u32>), String> {
        let rotation = DQuat::from_array(self.rotation);
        // The importer's are of unit length but for rounding. NaN is in no range.
        if !(0.99..1.01).contains(&rotation.length_squared()) {
            return Err(format!("the rotation {:?} is not a unit quaternion", self.rotation));
        }
        let node = NodeSource {
            name: String::new(),
            parent: some(self.parent),
            local: DAffine3::from_cols_array(&self.local),
            rotation,
            shape: some(self.shape).map(ShapeIndex),
            extras: self.extras.extras()?,
            levels: self.levels,
            version: some(self.version),
            light: None,
        };
        Ok((node, some(self.light)))
    }
}

/// A ball and a box.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct BoundsRow {
    centre: [f64; 3],
    radius: f64,
    min: [f64; 3],
    max: [f64; 3],
}

impl BoundsRow {
    pub(super) fn of(sphere: Sphere, bounds: Box3) -> Self {
        Self {
            centre: sphere.centre.to_array(),
            radius: sphere.radius,
            min: bounds.min.to_array(),
            max: bounds.max.to_array(),
        }
    }

    pub(super) fn bounds(&self) -> Result<(Sphere, Box3), String> {
        let sphere = ball(self.centre, self.radius)?;
        let bounds = Box3 { min: DVec3::from_array(self.min), max: DVec3::from_array(self.max) };
        let is_box = bounds.min.is_finite() && bounds.max.is_finite() && bounds.min.cmple(bounds.max).all();
        if is_box { Ok((sphere, bounds)) } else { Err(format!("{:?} to {:?} is no box", self.min, self.max)) }
    }
}

fn ball(centre: [f64; 3], radius: f64) -> Result<Sphere, String> {
    let sphere = Sphere { centre: DVec3::from_array(centre), radius };
    let is_ball = sphere.centre.is_finite() && radius.is_finite() && radius >= 0.0;
    if is_ball { Ok(sphere) } else { Err(format!("radius {radius} about {centre:?} is no ball")) }
}

/// A mesh of the file; it has the next so many pieces, and its tree the next so many branches and items.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct ShapeRow {
    pub bounds: BoundsRow,
    pub extras: ExtrasRow,
    pub pieces: u32,
    pub branches: u32,
    pub items: u32,
    pub zero: u32,
}

/// A piece of a mesh; `flags`: 1 merged, 2 has a layer. Its counts are in the index of meshes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct PieceRow {
    pub bounds: BoundsRow,
    /// Row of the index of meshes.
    pub mesh: u32,
    pub material: u32,
    pub primitive: u32,
    layer: i32,
    flags: u32,
    zero: u32,
}

impl PieceRow {
    pub(super) fn of(piece: &crate::scene::Piece, mesh: u32) -> Self {
        Self {
            bounds: BoundsRow::of(piece.sphere, piece.bounds),
            mesh,
            material: piece.material,
            primitive: piece.primitive,
            layer: piece.layer.unwrap_or(0),
            flags: u32::from(piece.merged) | u32::from(piece.layer.is_some()) << 1,
            zero: 0,
        }
    }

    /// Layer, and whether it is merged.
    pub(super) fn marks(&self) -> Result<(Option<i32>, bool), String> {
        match self.flags {
            0..4 => Ok(((self.flags & 2 != 0).then_some(self.layer), self.flags & 1 != 0)),
            flags => Err(unknown("flags", flags)),
        }
    }
}

/// A use of a texture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct TextureRow {
    /// Row of the index of textures, or [`NONE`].
    pub texture: u32,
    set: u32,
    transform: [[f32; 3]; 2],
    /// Wrap along u, then 8 bits on along v, then 16 bits on the filter.
    modes: u32,
}

const WRAPS: [Wrap; 3] = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
const FILTERS: [Filter; 2] = [Filter::Linear, Filter::Nearest];

fn place<T: PartialEq>(all: &[T], value: &T) -> u32 {
    all.iter().position(|other| other == value).expect("the list has every value of the enumeration") as u32
}

impl TextureRow {
    pub(super) fn of(usage: Option<TextureUse>, row: impl Fn(&TextureUse) -> u32) -> Self {
        let Some(usage) = usage else { return Self { texture: NONE, ..Zeroable::zeroed() } };
        let modes =
            place(&WRAPS, &usage.wrap_u) | place(&WRAPS, &usage.wrap_v) << 8 | place(&FILTERS, &usage.magnify) << 16;
        Self { texture: row(&usage), set: usage.set, transform: usage.transform, modes }
    }

    /// The use, `id` says what texture a row is.
    pub(super) fn usage(
        &self,
        id: impl Fn(u32) -> Result<proto::ids::ContentId, String>,
    ) -> Result<Option<TextureUse>, String> {
        let Some(row) = some(self.texture) else { return Ok(None) };
        let wrap = |at: u32| WRAPS.get((self.modes >> at & 0xff) as usize).copied();
        let magnify = FILTERS.get((self.modes >> 16) as usize).copied();
        let (Some(wrap_u), Some(wrap_v), Some(magnify)) = (wrap(0), wrap(8), magnify) else {
            return Err(unknown("ways to read a texture", self.modes));
        };
        finite(self.transform.as_flattened(), "texture transformation")?;
        Ok(Some(TextureUse { texture: id(row)?, set: self.set, transform: self.transform, wrap_u, wrap_v, magnify }))
    }
}

/// A material; its name is in the text. `flags`: 1 double-sided, 2 unlit.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct MaterialRow {
    base_color: [f32; 4],
    emissive: [f32; 3],
    cutoff: f32,
    base_texture: TextureRow,
    emissive_texture: TextureRow,
    alpha: u32,
    flags: u32,
}

impl MaterialRow {
    pub(super) fn of(material: &Material, row: impl Fn(&TextureUse) -> u32) -> Self {
        let (alpha, cutoff) = match material.alpha {
            Alpha::Opaque => (0, 0.0),
            Alpha::Mask { cutoff } => (1, cutoff),
            Alpha::Blend => (2, 0.0),
        };
        Self {
            base_color: material.base_color,
            emissive: material.emissive,
            cutoff,
            base_texture: TextureRow::of(material.base_texture, &row),
            emissive_texture: TextureRow::of(material.emissive_texture, &row),
            alpha,
            flags: u32::from(material.double_sided) | u32::from(material.unlit) << 1,
        }
    }

    pub(super) fn material(
        &self,
        id: impl Fn(u32) -> Result<proto::ids::ContentId, String>,
    ) -> Result<Material, String> {
        let alpha = match self.alpha {
            0 => Alpha::Opaque,
            1 => Alpha::Mask { cutoff: self.cutoff },
            2 => Alpha::Blend,
            other => return Err(unknown("alpha mode", other)),
        };
        if self.flags >= 4 {
            return Err(unknown("flags", self.flags));
        }
        finite(&self.base_color, "base colour")?;
        finite(&self.emissive, "emissive colour")?;
        finite(&[self.cutoff], "alpha cut-off")?;
        Ok(Material {
            base_color: self.base_color,
            base_texture: self.base_texture.usage(&id)?,
            emissive: self.emissive,
            emissive_texture: self.emissive_texture.usage(&id)?,
            alpha,
            double_sided: self.flags & 1 != 0,
            unlit: self.flags & 2 != 0,
        })
    }
}

/// A light. Its range is infinite if it has none.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct LightRow {
    intensity: [f32; 3],
    kind: u32,
    range: f64,
    cones: [f32; 2],
}

impl LightRow {
    pub(super) fn of(light: &LightSource) -> Self {
        let (kind, range, cones) = match light.kind {
            LightKind::Directional => (0, None, [0.0; 2]),
            LightKind::Point { range } => (1, range, [0.0; 2]),
            LightKind::Spot { range, inner_cos, outer_cos } => (2, range, [inner_cos, outer_cos]),
        };
        Self { intensity: light.intensity, kind, range: range.unwrap_or(f64::INFINITY), cones }
    }

    pub(super) fn light(&self) -> Result<LightSource, String> {
        finite(&self.intensity, "light's intensity")?;
        finite(&self.cones, "light's cone")?;
        if self.range.is_nan() || self.range <= 0.0 {
            return Err(format!("a light's range of {} m", self.range));
        }
        let range = Some(self.range).filter(|range| range.is_finite());
        let [inner_cos, outer_cos] = self.cones;
        let kind = match self.kind {
            0 => LightKind::Directional,
            1 => LightKind::Point { range },
            2 => LightKind::Spot { range, inner_cos, outer_cos },
            other => return Err(unknown("kind of light", other)),
        };
        Ok(LightSource { kind, intensity: self.intensity })
    }
}

/// A branch of a culling tree.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct BranchRow {
    centre: [f64; 3],
    radius: f64,
    first: u32,
    end: u32,
    next: u32,
    zero: u32,
}

impl BranchRow {
    pub(super) fn of(branch: &Branch) -> Self {
        let Branch { ball, first, end, next } = *branch;
        Self { centre: ball.centre.to_array(), radius: ball.radius, first, end, next, zero: 0 }
    }

    pub(super) fn branch(&self) -> Result<Branch, String> {
        Ok(Branch { ball: ball(self.centre, self.radius)?, first: self.first, end: self.end, next: self.next })
    }
}

/// A plane that faces share.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct PlaneRow {
    normal: [f64; 3],
    offset: f64,
    pub object: u32,
    zero: u32,
}

impl PlaneRow {
    pub(super) fn of(plane: &Plane) -> Self {
        Self { normal: plane.normal.to_array(), offset: plane.offset, object: plane.object.0, zero: 0 }
    }

    pub(super) fn plane(&self) -> Result<Plane, String> {
        let normal = DVec3::from_array(self.normal);
        if !(normal.is_finite() && self.offset.is_finite()) {
            return Err("a plane with a number that is not finite".into());
        }
        Ok(Plane { object: proto::ids::ObjectId(self.object), normal, offset: self.offset })
    }
}

/// A mesh or texture: its name, the length of its payload, and its size (vertices and triangles, or width and height). Payloads stand
/// one behind the other in the order of this index, so none can overlap another.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct ContentRow {
    pub id: [u8; 16],
    pub length: u32,
    pub size: [u32; 2],
}

fn finite(numbers: &[f32], what: &str) -> Result<(), String> {
    if numbers.iter().all(|number| number.is_finite()) { Ok(()) } else { Err(format!("the {what} is not finite")) }
}

fn unknown(what: &str, value: u32) -> String {
    format!("unknown {what} {value:#x}")
}

// The layout is the file format: another one is another version of it.
const _: () = {
    assert!(size_of::<NodeRow>() == 176, "nodes");
    assert!(size_of::<ShapeRow>() == 120, "shapes");
    assert!(size_of::<PieceRow>() == 104, "pieces");
    assert!(size_of::<MaterialRow>() == 112, "materials");
    assert!(size_of::<LightRow>() == 32, "lights");
    assert!(size_of::<BranchRow>() == 48, "branches");
    assert!(size_of::<PlaneRow>() == 40, "planes");
    assert!(size_of::<ContentRow>() == 28, "contents");
    assert!(NO_PLANE == NONE, "both mean that there is none");
};
