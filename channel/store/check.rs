//! What the store demands of what comes from outside: lengths that agree, indices in range, numbers that are finite.

use super::{StoreError, TEXCOORD_SETS_MAX};
use proto::frame::VersionWeights;
use proto::ids::{ContentId, ModelId, ObjectId};
use proto::limits::{LIGHTS_MAX, TRIANGLES_PER_SUBOBJECT_MAX, VERSIONS_MAX};
use proto::scene::{Alpha, LightKind, LightRow, Mesh, ModelRow, NO_PLANE, SceneTable};

/// How far a sum of weights may be from 1 and still mean 1: weights are f32, and versions may be many.
const SUM_TOLERANCE: f64 = 1e-6;

/// A mesh from outside.
pub(super) fn check_mesh(id: ContentId, mesh: &Mesh) -> Result<(), StoreError> {
    let vertices = mesh.positions.len();
    let length = |what, found: usize, optional: bool| {
        if found == vertices || (optional && found == 0) {
            Ok(())
        } else {
            Err(StoreError::VertexArray { mesh: id, what, found, vertices })
        }
    };
    length("normals", mesh.normals.len(), true)?;
    length("colours", mesh.colors.len(), true)?;
    if mesh.texcoords.len() > TEXCOORD_SETS_MAX {
        return Err(StoreError::TexcoordSets { mesh: id, sets: mesh.texcoords.len() });
    }
    for set in &mesh.texcoords {
        length("texture coordinates", set.len(), false)?;
    }
    let triangles = mesh.triangles.len();
    if triangles > TRIANGLES_PER_SUBOBJECT_MAX {
        return Err(StoreError::MeshTooLarge { mesh: id, triangles });
    }
    if mesh.face_numbers.len() != triangles {
        return Err(StoreError::FaceNumbers { mesh: id, found: mesh.face_numbers.len(), triangles });
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(index) = corners.iter().copied().find(|i| *i as usize >= vertices) {
            return Err(StoreError::VertexIndex { mesh: id, triangle, index, vertices });
        }
    }
    let finite = |what, is_finite: bool| if is_finite { Ok(()) } else { Err(StoreError::NotFinite { mesh: id, what }) };
    finite("origin", mesh.origin.is_finite())?;
    finite("positions", all_finite(&mesh.positions))?;
    finite("normals", all_finite(&mesh.normals))?;
    finite("colours", all_finite(&mesh.colors))?;
    finite("texture coordinates", mesh.texcoords.iter().all(|set| all_finite(set)))?;
    let material = &mesh.material;
    finite("base colour", all_finite(&[material.base_color]))?;
    finite("emissive colour", all_finite(&[material.emissive]))?;
    for usage in [material.base_texture, material.emissive_texture].into_iter().flatten() {
        finite("texture transformation", all_finite(&usage.transform))?;
    }
    if let Alpha::Mask { cutoff } = material.alpha {
        finite("alpha cut-off", cutoff.is_finite())?;
    }
    Ok(())
}

fn all_finite<const N: usize>(numbers: &[[f32; N]]) -> bool {
    numbers.as_flattened().iter().all(|x| x.is_finite())
}

/// The tables of a scene.
pub(super) fn check_table(table: &SceneTable) -> Result<(), StoreError> {
    let objects = table.objects.len();
    for (i, row) in table.objects.iter().enumerate() {
        if !row.transform.is_finite() {
            return Err(StoreError::TransformNotFinite { object: ObjectId(i as u32) });
        }
    }
    for (i, row) in table.models.iter().enumerate() {
        if row.versions == 0 || row.versions as usize > VERSIONS_MAX {
            return Err(StoreError::Versions { model: ModelId(i as u32), versions: row.versions });
        }
    }
    for (plane, row) in table.planes.iter().enumerate() {
        if row.object.0 as usize >= objects || !row.normal.is_finite() || !row.offset.is_finite() {
            return Err(StoreError::Plane { plane });
        }
    }
    let planes = table.planes.len();
    if let Some(plane) = table.face_planes.iter().copied().find(|p| *p != NO_PLANE && *p as usize >= planes) {
        return Err(StoreError::FacePlane { plane, planes });
    }
    if table.lights.len() > LIGHTS_MAX {
        return Err(StoreError::Lights { lights: table.lights.len() });
    }
    if let Some(light) = table.lights.iter().position(|light| !shines(light)) {
        return Err(StoreError::Light { light });
    }
    for (subobject, row) in table.subobjects.iter().enumerate() {
        if row.object.0 as usize >= objects {
            return Err(StoreError::ObjectOutOfRange { subobject, object: row.object, objects });
        }
        if let Some(part) = row.part_of {
            let model = table.models.get(part.model.0 as usize);
            if model.is_none_or(|model| part.version >= model.versions) {
                return Err(StoreError::PartOutOfRange { subobject, model: part.model, version: part.version });
            }
        }
        let found = table.face_planes.len();
        if let Some(begin) = row.planes.filter(|begin| *begin as usize > found) {
            return Err(StoreError::FacePlanes { subobject, begin, found });
        }
    }
    Ok(())
}

/// Whether a light can be computed with.
fn shines(light: &LightRow) -> bool {
    let in_range = |range: Option<f64>| range.is_none_or(|range| range.is_finite() && range > 0.0);
    light.intensity.iter().all(|c| c.is_finite())
        && light.position.is_finite()
        && light.direction.is_finite()
        && match light.kind {
            LightKind::Directional => true,
            LightKind::Point { range } => in_range(range),
            LightKind::Spot { range, inner_cos, outer_cos } => {
                in_range(range) && inner_cos.is_finite() && outer_cos.is_finite()
            }
        }
}

/// One weight per version of a model, their sum made 1 if only rounding keeps it from that.
pub(super) fn check_weights(models: &[ModelRow], row: &VersionWeights) -> Result<Vec<f64>, StoreError> {
    let model = row.model;
    let versions = match models.get(model.0 as usize) {
        Some(found) => found.versions as usize,
        None => return Err(StoreError::WeightsOutOfRange { model, models: models.len() }),
    };
    let mut weights: Vec<f64> = row.weights.iter().copied().map(f64::from).collect();
    let sum: f64 = weights.iter().sum();
    // A NaN is in no range.
    if weights.len() > versions || !weights.iter().all(|w| (0.0..=1.0).contains(w)) || sum > 1.0 + SUM_TOLERANCE {
        return Err(StoreError::Weights { model });
    }
    if (sum - 1.0).abs() <= SUM_TOLERANCE {
        weights.iter_mut().for_each(|w| *w /= sum);
    }
    weights.resize(versions, 0.0);
    Ok(weights)
}
