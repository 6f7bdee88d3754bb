//! The host's side: camera files and pose packets, each turned into the same poses.

pub mod camera;
pub mod native;
