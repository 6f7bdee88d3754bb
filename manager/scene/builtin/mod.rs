//! The scenes that the program brings along, made by it when asked for: no downloaded asset, the same bytes everywhere.
//!
//! A scene is code that calls the small toolbox here (`shapes` for geometry, `paint` for textures, `random` for
//! chance) and hands the result to the [glTF writer](super::glb); it then takes the same way into the system as any
//! file. Each comes with a camera path that shows it.

mod airport;
mod bench;
mod paint;
mod random;
mod shapes;

use crate::host::camera::CameraFile;

/// A scene and a flight through it.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltIn {
    /// The scene's name on the command line.
    pub name: &'static str,
    /// The scene as binary glTF.
    pub glb: Vec<u8>,
    /// The flight.
    pub camera: CameraFile,
}

/// The names that [`build`] knows.
pub fn names() -> &'static [&'static str] {
    const NAMES: [&str; 1 + bench::NAMES.len()] = {
        let mut all = ["airport"; 1 + bench::NAMES.len()];
        let mut i = 0;
        while i < bench::NAMES.len() {
            all[1 + i] = bench::NAMES[i];
            i += 1;
        }
        all
    };
    &NAMES
}

/// Makes the scene of that name; a fraction of a second, for `dense` a second.
pub fn build(name: &str) -> Option<BuiltIn> {
    match name {
        "airport" => Some(airport::build()),
        name => bench::build(name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_built_and_no_other() {
        for name in names() {
            assert_eq!(build(name).map(|scene| scene.name), Some(*name));
        }
        assert_eq!(build("no such place"), None);
    }
}
