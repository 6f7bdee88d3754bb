//! Mesh primitives of the file: attributes and indices, checked, as triangles.

use super::accessor::{For, at};
use super::error::Fault;
use super::extras::At;
use super::material::Ready;
use super::{Importer, corners, extras};
use crate::scene::split::{Primitive, split};
use crate::scene::{Extras, PieceSource, ShapeIndex};
use gltf::json;
use gltf::json::mesh::{Mode, Semantic};
use gltf::json::validation::Checked;
use proto::scene::TextureUse;

/// Most triangles of a scene, each mesh counted once: some 8 GB of meshes. A small file can name one large buffer many
/// times over, so the file's size is no bound.
const TRIANGLES_MAX: u64 = 1 << 27;

/// A set of texture coordinates that no mesh has ([`proto::scene::Mesh::texcoords`] are at most two): (0, 0) everywhere.
const ABSENT_SET: u32 = 2;

impl Importer<'_> {
    /// The mesh `index` of the file, cut into pieces; `None` if it has no triangles. `place` is the first node that
    /// shows it.
    pub(super) fn shape(&mut self, index: usize, place: &str) -> Result<Option<ShapeIndex>, Fault> {
        if let Some(&shape) = self.shapes.get(&index) {
            return Ok(shape);
        }
        let root = self.data.root;
        let described = at(&root.meshes, index, "mesh", place)?;
        let mesh_name = described.name.as_deref().filter(|name| !name.is_empty());
        let label = || mesh_name.map_or_else(|| format!("mesh {index}"), |name| format!("mesh {name:?}"));
        let whole = extras::read(&described.extras, At::Mesh, &label, &mut self.warnings);
        let mut pieces: Vec<PieceSource> = Vec::new();
        for (number, described) in described.primitives.iter().enumerate() {
            self.watch.on(corners(root, described));
            if let Some((primitive, ready)) = self.primitive(described, place)? {
                self.triangles += primitive.triangles.len() as u64;
                if self.triangles > TRIANGLES_MAX {
                    let (count, limit) = (self.triangles, TRIANGLES_MAX);
                    return Err(Fault::TooMany { place: place.into(), what: "triangles", count, limit });
                }
                let place = || format!("{}, primitive {number}", label());
                let own = extras::read(&described.extras, At::Part, &place, &mut self.warnings);
                let said = Extras {
                    layer: own.layer.or(ready.layer),
                    merged: own.merged.or(ready.merged),
                    ..Extras::default()
                };
                pieces.extend(split(&primitive).into_iter().map(|mesh| PieceSource {
                    mesh,
                    material: ready.entry,
                    primitive: number as u32,
                    extras: said.clone(),
                }));
            }
        }
        let shape = self.parts.add_shape(mesh_name.unwrap_or_default(), whole, pieces);
        self.shapes.insert(index, shape);
        Ok(shape)
    }

    /// A primitive and its material; `None` if it isn't made of triangles.
    fn primitive(
        &mut self,
        described: &json::mesh::Primitive,
        place: &str,
    ) -> Result<Option<(Primitive, Ready)>, Fault> {
        let Checked::Valid(mode) = described.mode else {
            self.warnings.add(format!("{place}: a primitive of unknown mode is left out"));
            return Ok(None);
        };
        if matches!(mode, Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) {
            self.warnings.add("points and lines are left out: only triangles are drawn");
            return Ok(None);
        }
        if described.targets.as_ref().is_some_and(|targets| !targets.is_empty()) {
            self.warnings.add("morph targets are not applied: meshes keep their basic shape");
        }
        let attribute = |semantic| described.attributes.get(&Checked::Valid(semantic)).map(|index| index.value());
        let Some(positions) = attribute(Semantic::Positions) else {
            self.warnings.add(format!("{place}: a primitive without positions is left out"));
            return Ok(None);
        };
        let mut primitive =
            Primitive { positions: self.data.vectors(For { place, accessor: positions })?, ..Primitive::default() };
        let vertices = primitive.positions.len();
        let equal = |name: &str, count: usize| {
            if count == vertices {
                Ok(())
            } else {
                Err(Fault::Length { place: place.into(), attribute: name.into(), count, vertices })
            }
        };

        let corners = match described.indices {
            None => (0..vertices as u32).collect(),
            Some(index) => {
                let who = For { place, accessor: index.value() };
                let corners = self.data.indices(who)?;
                if let Some(element) = corners.iter().position(|&index| index as usize >= vertices) {
                    let (accessor, index) = (who.accessor, corners[element]);
                    return Err(Fault::IndexOutOfRange { place: place.into(), accessor, element, index, vertices });
                }
                corners
            }
        };
        primitive.triangles = triangles(mode, &corners);
        if mode == Mode::Triangles && corners.len() % 3 != 0 {
            self.warnings
                .add(format!("{place}: {} corners are not a multiple of 3, the last are left out", corners.len()));
        }
        if primitive.triangles.is_empty() {
            return Ok(None);
        }

        if let Some(accessor) = attribute(Semantic::Normals) {
            let mut normals = self.data.vectors_raw(For { place, accessor })?;
            equal("NORMAL", normals.len())?;
            let unusable = normals.iter_mut().map(normalise).filter(|usable| !usable).count();
            if unusable > 0 {
                self.warnings.add(format!(
                    "{place}: {unusable} of {vertices} normals are zero or not finite; the faces' own are used there"
                ));
            }
            primitive.normals = normals;
        }
        if let Some(accessor) = attribute(Semantic::Colors(0)) {
            primitive.colors = self.colors(For { place, accessor })?;
            equal("COLOR_0", primitive.colors.len())?;
            if primitive.colors.iter().all(|color| *color == [1.0; 4]) {
                primitive.colors.clear(); // what an empty list means
            }
        }

        let ready = self.material(described.material.map(|index| index.value()), place)?;
        primitive.material = ready.material;
        let mut sets: Vec<u32> = Vec::new();
        let material = &mut primitive.material;
        for usage in [&mut material.base_texture, &mut material.emissive_texture].into_iter().flatten() {
            let TextureUse { set, .. } = *usage;
            let Some(accessor) = attribute(Semantic::TexCoords(set)) else {
                self.warnings.add(format!(
                    "{place}: its material has a texture for TEXCOORD_{set}, which it lacks; (0, 0) is used"
                ));
                usage.set = ABSENT_SET;
                continue;
            };
            usage.set = match sets.iter().position(|&known| known == set) {
                Some(known) => known as u32,
                None => {
                    let coordinates = self.data.vectors(For { place, accessor })?;
                    equal(&format!("TEXCOORD_{set}"), coordinates.len())?;
                    primitive.texcoords.push(coordinates);
                    sets.push(set);
                    sets.len() as u32 - 1
                }
            };
        }
        Ok(Some((primitive, ready)))
    }

    /// Vertex colours with or without alpha, in 0..=1.
    fn colors(&mut self, who: For<'_>) -> Result<Vec<[f32; 4]>, Fault> {
        let (width, plain_integers) = self.data.shape(who)?;
        let mut colors: Vec<[f32; 4]> = if width == 3 {
            self.data.vectors::<3>(who)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()
        } else {
            self.data.vectors(who)?
        };
        let mut clamped = false;
        for channel in colors.iter_mut().flatten() {
            let inside = channel.clamp(0.0, 1.0);
            clamped |= inside != *channel;
            *channel = inside;
        }
        if clamped {
            let why = if plain_integers { " (integers that are not marked as normalised)" } else { "" };
            self.warnings.add(format!("{}: vertex colours outside 0 to 1 are clamped{why}", who.place));
        }
        Ok(colors)
    }
}

/// Makes a vector a unit one; one that can't be becomes zero, and the answer is false.
fn normalise(normal: &mut [f32; 3]) -> bool {
    let vector = glam::DVec3::from_array(normal.map(f64::from));
    let unit = vector.try_normalize().unwrap_or_default();
    *normal = unit.as_vec3().to_array();
    unit != glam::DVec3::ZERO
}

/// The triangles of a list, strip or fan, all counter-clockwise (glTF 2.0, 3.7.2.1).
fn triangles(mode: Mode, corners: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::Triangles => corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
        Mode::TriangleStrip => {
            let turn = |(i, c): (usize, &[u32])| if i % 2 == 0 { [c[0], c[1], c[2]] } else { [c[0], c[2], c[1]] };
            corners.windows(3).enumerate().map(turn).collect()
        }
        Mode::TriangleFan => match corners.split_first() {
            Some((&hub, rim)) => rim.windows(2).map(|c| [c[0], c[1], hub]).collect(),
            None => Vec::new(),
        },
        Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_turn_all_their_triangles_the_same_way() {
        assert_eq!(triangles(Mode::TriangleStrip, &[5, 6, 7, 8]), [[5, 6, 7], [6, 8, 7]]);
        assert_eq!(triangles(Mode::TriangleFan, &[5, 6, 7, 8]), [[6, 7, 5], [7, 8, 5]]);
        assert_eq!(triangles(Mode::Triangles, &[5, 6, 7, 8]), [[5, 6, 7]]);
        assert!(triangles(Mode::TriangleFan, &[]).is_empty());
    }

    #[test]
    fn normals_become_unit_vectors_or_nothing() {
        let mut normal = [0.0, 3.0e-30, 0.0];
        assert!(normalise(&mut normal));
        assert_eq!(normal, [0.0, 1.0, 0.0]);
        for mut broken in [[0.0; 3], [f32::NAN, 1.0, 0.0], [f32::INFINITY, 0.0, 0.0]] {
            assert!(!normalise(&mut broken));
            assert_eq!(broken, [0.0; 3]);
        }
    }
}
