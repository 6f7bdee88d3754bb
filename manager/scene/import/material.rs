//! Materials of the file, as far as picture.md knows them: base colour, emission, alpha, sidedness, unlit.
//!
//! Metalness, roughness, normal maps and occlusion have no place in the picture's formula and are not read, nor are
//! the images that only they use. Each material and each image is made once, when a drawn primitive first asks for it.

use super::accessor::at;
use super::error::Fault;
use super::extras::At;
use super::{Importer, extras, picture};
use crate::scene::{Extras, MaterialEntry};
use glam::DQuat;
use gltf::json;
use gltf::json::material::AlphaMode;
use gltf::json::texture::{MagFilter, WrappingMode};
use gltf::json::validation::Checked;
use proto::scene::{Alpha, Filter, Material, TRANSFORM_IDENTITY, TextureUse, Wrap};

/// A material, ready to be given to primitives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ready {
    /// Texture uses name the file's sets of texture coordinates: `set` is the n of `TEXCOORD_n`.
    pub(super) material: Material,
    /// Its place in the scene's list of materials.
    pub(super) entry: u32,
    /// The coplanar layer that its extras say.
    pub(super) layer: Option<i32>,
    /// Whether its extras mark it as merged.
    pub(super) merged: Option<bool>,
}

fn label(described: &json::Material, index: usize) -> String {
    match &described.name {
        Some(name) if !name.is_empty() => format!("material {name:?}"),
        _ => format!("material {index}"),
    }
}

impl Importer<'_> {
    /// The material `index` of the file, or the default one.
    pub(super) fn material(&mut self, index: Option<usize>, place: &str) -> Result<Ready, Fault> {
        if let Some(&ready) = self.materials.get(&index) {
            return Ok(ready);
        }
        let (name, material, said) = match index {
            None => ("(default)".to_owned(), Material::default(), Extras::default()),
            Some(index) => {
                let described = at(&self.data.root.materials, index, "material", place)?;
                let said = extras::read(&described.extras, At::Part, &|| label(described, index), &mut self.warnings);
                (described.name.clone().unwrap_or_default(), self.convert(described, index)?, said)
            }
        };
        let entry = self.parts.materials.len() as u32;
        let ready = Ready { material, entry, layer: said.layer, merged: said.merged };
        self.parts.materials.push(MaterialEntry { name, material });
        self.materials.insert(index, ready);
        Ok(ready)
    }

    fn convert(&mut self, described: &json::Material, index: usize) -> Result<Material, Fault> {
        let label = label(described, index);
        let fault = |what: &str| Fault::Material { material: label.clone(), what: what.into() };
        let pbr = &described.pbr_metallic_roughness;
        let extensions = described.extensions.as_ref();
        let unlit = extensions.is_some_and(|all| all.unlit.is_some());

        let base_color = pbr.base_color_factor.0;
        if base_color.iter().any(|number| !number.is_finite()) {
            return Err(fault("its base colour is not a finite number"));
        }
        let clamped = base_color.map(|number| number.clamp(0.0, 1.0));
        if clamped != base_color {
            self.warnings.add(format!("{label}: its base colour was outside 0 to 1 and is clamped"));
        }
        let strength = extensions.and_then(|all| all.emissive_strength.as_ref()).map_or(1.0, |s| s.emissive_strength.0);
        let emissive = described.emissive_factor.0.map(|number| number * strength);
        if emissive.iter().any(|number| !number.is_finite()) {
            return Err(fault("its emissive colour is not a finite number"));
        }
        let alpha = match described.alpha_mode {
            Checked::Valid(AlphaMode::Opaque) => Alpha::Opaque,
            Checked::Valid(AlphaMode::Blend) => Alpha::Blend,
            Checked::Valid(AlphaMode::Mask) => {
                let cutoff = described.alpha_cutoff.unwrap_or_default().0;
                if !cutoff.is_finite() {
                    return Err(fault("its alpha cut-off is not a finite number"));
                }
                Alpha::Mask { cutoff }
            }
            Checked::Invalid => return Err(fault("its alpha mode is unknown")),
        };
        let mut material = Material {
            base_color: clamped,
            base_texture: pbr.base_color_texture.as_ref().map(|info| self.texture(info, &label)).transpose()?,
            alpha,
            double_sided: described.double_sided,
            unlit,
            ..Material::default()
        };
        // An unlit surface shows its base colour and nothing else; one that glows in black doesn't glow.
        if !unlit && emissive.iter().any(|&number| number > 0.0) {
            material.emissive = emissive.map(|number| number.max(0.0));
            material.emissive_texture =
                described.emissive_texture.as_ref().map(|info| self.texture(info, &label)).transpose()?;
        }
        Ok(material)
    }

    fn texture(&mut self, info: &json::texture::Info, label: &str) -> Result<TextureUse, Fault> {
        let root = self.data.root;
        let described = at(&root.textures, info.index.value(), "texture", label)?;
        if described.source.value() == u32::MAX as usize {
            // gltf-json's mark for "no source": only an extension has the image.
            let mut used = root.extensions_used.iter();
            let extension = used.find(|name| name.contains("texture_") && *name != "KHR_texture_transform");
            let name = extension.cloned().unwrap_or_else(|| "an unnamed extension".into());
            let remedy = super::extension::texture_remedy(&name).into();
            return Err(Fault::Extension { name, remedy });
        }
        let image = described.source.value();
        let texture = match self.textures.get(&image) {
            Some(&id) => id,
            None => {
                let id = self.parts.add_texture(picture::load(&self.data, image, self.folder, label)?);
                self.textures.insert(image, id);
                self.watch.on(super::PICTURE_CORNERS);
                id
            }
        };
        let sampler = match described.sampler {
            Some(index) => at(&root.samplers, index.value(), "sampler", label)?.clone(),
            None => json::texture::Sampler::default(),
        };
        let mut set = info.tex_coord;
        let mut transform = TRANSFORM_IDENTITY;
        if let Some(moved) = info.extensions.as_ref().and_then(|all| all.texture_transform.as_ref()) {
            set = moved.tex_coord.unwrap_or(set);
            transform = matrix(moved.offset.0, moved.rotation.0, moved.scale.0);
            if transform.iter().flatten().any(|number| !number.is_finite()) {
                let what = "a texture's transformation is not a finite number".into();
                return Err(Fault::Material { material: label.into(), what });
            }
        }
        let mut wrap = |mode: Checked<WrappingMode>| match mode {
            Checked::Valid(WrappingMode::Repeat) => Wrap::Repeat,
            Checked::Valid(WrappingMode::MirroredRepeat) => Wrap::Mirror,
            Checked::Valid(WrappingMode::ClampToEdge) => Wrap::Clamp,
            Checked::Invalid => {
                self.warnings.add(format!("{label}: an unknown wrap mode is taken as repeat"));
                Wrap::Repeat
            }
        };
        Ok(TextureUse {
            texture,
            set,
            transform,
            wrap_u: wrap(sampler.wrap_s),
            wrap_v: wrap(sampler.wrap_t),
            magnify: match sampler.mag_filter {
                Some(Checked::Valid(MagFilter::Nearest)) => Filter::Nearest,
                _ => Filter::Linear,
            },
        })
    }
}

/// `KHR_texture_transform` as a matrix: offset · rotation · scale.
///
/// The rotation is counter-clockwise as seen on the image, where v points down: the inverse of the matrix that the
/// extension's sample shader has, which contradicts the text and the test model (KhronosGroup/glTF issue 1563); all
/// widespread viewers do it this way round.
fn matrix(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> [[f32; 3]; 2] {
    // Sine and cosine by way of glam: its libm gives the same bits on every machine.
    let half = DQuat::from_rotation_z(f64::from(rotation));
    let (sin, cos) = (2.0 * half.z * half.w, half.w * half.w - half.z * half.z);
    let [su, sv] = scale.map(f64::from);
    [[(cos * su) as f32, (sin * sv) as f32, offset[0]], [(-sin * su) as f32, (cos * sv) as f32, offset[1]]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_of_texture_coordinates_is_counter_clockwise_on_the_image() {
        let [u, v] = matrix([0.25, 0.5], std::f32::consts::FRAC_PI_2, [2.0, 3.0]);
        let apply = |row: [f32; 3], p: [f32; 2]| row[0] * p[0] + row[1] * p[1] + row[2];
        // (1, 0) scaled to (2, 0); v points down, so counter-clockwise leads to (0, −2).
        assert!((apply(u, [1.0, 0.0]) - 0.25).abs() < 1e-6);
        assert!((apply(v, [1.0, 0.0]) - (0.5 - 2.0)).abs() < 1e-6);
        assert!((apply(u, [0.0, 1.0]) - (0.25 + 3.0)).abs() < 1e-6);
        assert!((apply(v, [0.0, 1.0]) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn no_transformation_is_the_identity_to_the_bit() {
        assert_eq!(matrix([0.0; 2], 0.0, [1.0; 2]), TRANSFORM_IDENTITY);
    }
}
