//! The torture set of proof.md, as far as it concerns pixels: each case a test by its name, with its expected outcome; the measured
//! error is printed (`cargo test -p cyclorama-channel torture -- --nocapture | grep '^torture'`).
//!
//! Every picture is drawn with `oracle::draw`, which asserts that no pixel is missing and each is a finite number.

mod coverage;
mod cut;
mod depth;
mod drift;
mod faces;
mod numbers;
mod space;

use crate::oracle::*;
use crate::store::SceneStore;
use glam::{DAffine3, DVec3};
use proto::frame::FrameState;
use proto::scene::Mesh;
use proto::view::View;

/// One line of the table.
fn report(case: &str, expected: &str, measured: &str) {
    println!("torture | {case} | {expected} | {measured} |");
}

/// A picture against another: pixels that differ by more than 1e-6 of full scale, and the largest difference.
#[derive(Clone, Copy, Debug, Default)]
struct Comparison {
    pixels: usize,
    unlike: usize,
    largest: f64,
}

impl Comparison {
    fn of(drawn: &Picture, expected: &[[f64; 3]]) -> Self {
        let mut comparison = Self::default();
        comparison.add(drawn, expected);
        comparison
    }

    fn add(&mut self, drawn: &Picture, expected: &[[f64; 3]]) {
        assert_eq!(drawn.linear.len(), expected.len(), "pictures of one size");
        for (a, b) in drawn.linear.iter().zip(expected) {
            let by = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max);
            self.pixels += 1;
            self.unlike += usize::from(by > 1e-6);
            self.largest = self.largest.max(by);
        }
    }
}

impl std::fmt::Display for Comparison {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {} pixels differ, at most by {:.1e}", self.unlike, self.pixels, self.largest)
    }
}

fn as_f64(picture: &Picture) -> Vec<[f64; 3]> {
    picture.linear.iter().map(|c| c.map(f64::from)).collect()
}

/// A double-sided mesh of one face.
fn mesh_of_face(face: &OracleFace) -> Mesh {
    let mut mesh = mesh_of(&[face.corners], face.color);
    mesh.material.double_sided = true;
    mesh
}

/// Each face an object of its own; corners as f32, which [`mesh_of`] makes of them.
fn store_of_faces(faces: &[OracleFace]) -> SceneStore {
    store_of(faces.iter().map(|face| (mesh_of_face(face), DAffine3::IDENTITY)).collect())
}

/// Draws faces given in the eye's frame and compares with the sampler.
fn against_the_sampler(view: &View, faces: &[OracleFace]) -> Comparison {
    Comparison::of(&draw(&store_of_faces(faces), &state(), view), &sample_by_force(view, faces))
}

/// The faces of a mesh as they come to the eye, for the sampler.
fn seen_faces(state: &FrameState, view: &View, mesh: &Mesh, transform: &DAffine3) -> Vec<OracleFace> {
    let color = mesh.material.base_color;
    corners_at_eye(state, view, mesh, transform).into_iter().map(|corners| OracleFace { corners, color }).collect()
}

/// A point whose coordinates are f32.
fn snapped(p: DVec3) -> DVec3 {
    p.as_vec3().as_dvec3()
}

fn random_vector(random: &mut Random) -> DVec3 {
    DVec3::new(random.signed(), random.signed(), random.signed())
}

fn random_color(random: &mut Random, alpha: f32) -> [f32; 4] {
    [random.unit() as f32, random.unit() as f32, random.unit() as f32, alpha]
}
