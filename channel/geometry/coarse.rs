//! Cheaper ways to put vertices on the screen, so that a benchmark can say what the exact one costs and what it is worth. No rig uses them.

use super::camera::{Camera, GUARD_BITS};
use super::transform::Item;
use super::vertices::{CUT, Vertices};
use crate::samples::{SUBPIXEL_BITS, SUBPIXELS};
use crate::simd::each3;
use fearless_simd::{Simd, f32x8, prelude::*};

/// How vertices are put on the screen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coarse {
    /// Whole vertices are rounded to 2^−bits pixel, bits being at most [`SUBPIXEL_BITS`]; those of cut faces as ever.
    pub bits: u32,
    /// In f32 instead of f64, from the mesh's axes to the screen by one matrix.
    pub narrow: bool,
}

impl Default for Coarse {
    /// As every rig has it.
    fn default() -> Self {
        Self { bits: SUBPIXEL_BITS, narrow: false }
    }
}

/// Does to a subobject's transformed vertices what is asked for.
#[inline(always)]
pub fn apply<S: Simd>(simd: S, coarse: Coarse, camera: &Camera, item: &Item<'_>, vertices: &mut Vertices) {
    if coarse.narrow {
        narrow(simd, camera, item, vertices);
    }
    snap(vertices, coarse.bits);
}

/// Rounds what was rounded to 1/256 pixel once more.
fn snap(vertices: &mut Vertices, bits: u32) {
    let step = 1 << SUBPIXEL_BITS.saturating_sub(bits);
    if step > 1 {
        for c in vertices.x.iter_mut().chain(&mut vertices.y) {
            *c = (*c + step / 2) & -step;
        }
    }
}

/// Replaces the screen positions and inverse distances of vertices that are projected by those that f32 gives. What each vertex is outside
/// of is left as it was.
#[inline(always)]
fn narrow<S: Simd>(simd: S, camera: &Camera, item: &Item<'_>, vertices: &mut Vertices) {
    const LANES: usize = 8;
    let [px, py, pz] = item.stored.positions();
    let to_view = *camera.to_view();
    let matrix = to_view * item.linear;
    let shift = to_view * (item.linear * item.stored.mesh.origin + item.relative);
    let splat = |n: f64| f32x8::splat(simd, n as f32);
    let [a, b, c] = each3([matrix.x_axis, matrix.y_axis, matrix.z_axis], |c| each3(c.to_array(), splat));
    let d = each3(shift.to_array(), splat);
    let [span_x, span_y] = camera.spans();
    let sub = f64::from(SUBPIXELS);
    let (scale_x, scale_y) =
        (splat(f64::from(camera.width) * sub / span_x), splat(f64::from(camera.height) * sub / span_y));
    let (left, top) = (splat(camera.tangents.left), splat(camera.tangents.top));
    for at in (0..px.len()).step_by(LANES) {
        let end = at + LANES;
        let [x, y, z] = [&px[at..end], &py[at..end], &pz[at..end]];
        let [x, y, z] = [f32x8::from_slice(simd, x), f32x8::from_slice(simd, y), f32x8::from_slice(simd, z)];
        let vx = a[0] * x + b[0] * y + c[0] * z + d[0];
        let vy = a[1] * x + b[1] * y + c[1] * z + d[1];
        let w = f32x8::splat(simd, 0.0) - (a[2] * x + b[2] * y + c[2] * z + d[2]);
        let q = f32x8::splat(simd, 1.0) / w;
        let sx: [f32; LANES] = (((vx * q - left) * scale_x) + 0.5).floor().into();
        let sy: [f32; LANES] = (((top - vy * q) * scale_y) + 0.5).floor().into();
        let q: [f32; LANES] = q.into();
        for i in 0..LANES {
            let limit = 1 << GUARD_BITS;
            // What is cut is projected when it has been cut.
            if vertices.codes[at + i] < CUT {
                vertices.x[at + i] = (sx[i] as i32).clamp(-limit, limit);
                vertices.y[at + i] = (sy[i] as i32).clamp(-limit, limit);
                vertices.q[at + i] = f64::from(q[i]);
            }
        }
    }
}
