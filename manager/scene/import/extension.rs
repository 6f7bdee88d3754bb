//! Which extensions of glTF are understood, and what to do about the others.
//!
//! A file lists what it uses and what it can't be shown without. What is required and not understood ends the import,
//! with the command of a well-known tool that turns the file into a plain one; what is merely used is left out, with one
//! warning each, because a scene without clear coat is better than none.

use super::Warnings;
use super::error::Fault;
use gltf::json::Root;

/// Understood in full.
const SUPPORTED: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "MSFT_lod",
];

/// Whose absence does not change the picture.
const HARMLESS: &[&str] = &["FB_ngon_encoding", "KHR_xmp", "KHR_xmp_json_ld"];

const DRACO: &str = "unpack it with: npx @gltf-transform/cli copy in.glb out.glb";
const REMEDIES: &[(&str, &str)] = &[
    ("KHR_draco_mesh_compression", DRACO),
    ("EXT_meshopt_compression", DRACO),
    ("KHR_meshopt_compression", DRACO),
    ("KHR_texture_basisu", "convert its pictures with: npx @gltf-transform/cli ktxdecompress in.glb out.glb"),
    ("EXT_texture_webp", "convert its pictures with: npx @gltf-transform/cli png in.glb out.glb"),
    ("EXT_texture_avif", "convert its pictures with: npx @gltf-transform/cli png in.glb out.glb"),
    ("KHR_materials_pbrSpecularGlossiness", "convert it with: npx @gltf-transform/cli metalrough in.glb out.glb"),
];

/// Refuses required extensions that are not understood, and warns of the others.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Result<(), Fault> {
    for name in &root.extensions_required {
        if !SUPPORTED.contains(&name.as_str()) && !HARMLESS.contains(&name.as_str()) {
            let known = REMEDIES.iter().find(|(known, _)| known == name);
            let remedy = known.map_or("export the scene without it", |(_, remedy)| remedy);
            return Err(Fault::Extension { name: name.clone(), remedy: remedy.into() });
        }
    }
    for name in &root.extensions_used {
        match name.as_str() {
            name if SUPPORTED.contains(&name) || HARMLESS.contains(&name) => {}
            name => warnings.add(format!("the extension {name} is not supported and left out")),
        }
    }
    Ok(())
}

/// What to do about textures that only an unsupported extension has.
pub(super) fn texture_remedy(name: &str) -> &'static str {
    REMEDIES.iter().find(|(known, _)| *known == name).map_or("convert its pictures to PNG", |(_, remedy)| remedy)
}
