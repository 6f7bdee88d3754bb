//! Vertices to the screen and normals to the world, eight at a time.
//!
//! Per vertex, in f64 and in one order of operations for every subobject, so that pieces of one surface agree on shared
//! vertices to the bit: `linear · (origin + p) + (translation − eye)`, rotated to view axes, projected, rounded to 1/256
//! pixel. The scalar twin is `transform::view_point` with [`Camera::project_sub`]; clipping uses it, so the two must give the same
//! bits, and a test holds them to it. What is outside of something is told by bits of a code per vertex; mostly none of eight
//! has any, and then nothing is done about it.

use super::camera::{Camera, GUARD_BITS};
use super::transform::Item;
use crate::samples::SUBPIXELS;
use crate::simd::{each3, each4};
use fearless_simd::{Simd, f64x8, mask64x8, prelude::*};

/// Coordinates beyond this, m, are taken for nonsense: their squares would leave f64's range. The face is dropped.
const COORDINATE_MAX: f64 = 1e100;

/// Code bit: behind the near plane (bits 0 to 3: beyond the left, right, lower, upper side of the view). A face is out of the view
/// if all of its vertices are outside of one plane: true in space, behind the eye as well.
const NEAR: u16 = 1 << 4;
/// Code bit: farther along the line of sight than the range of visibility. Rejects like a side.
pub const PAST: u16 = 1 << 5;
/// Code bit: farther from the eye than the range of visibility.
pub const BEYOND: u16 = 1 << 6;
/// Code bit: behind the near plane or beyond the guard band; faces with such a vertex are cut.
pub const CUT: u16 = 1 << 7;
/// Code bit: not a number, or out of all range.
pub const NOT_FINITE: u16 = 1 << 8;

/// Lanes: vertices that are worked on at once.
const LANES: usize = 8;

/// Adding this to a whole number below 2³¹ leaves the number in the low 32 bits, in two's complement.
const TO_INTEGER: f64 = 6_755_399_441_055_744.0; // 1.5 · 2⁵²

/// A subobject's vertices on the screen. Arrays are as long as the mesh's padded ones.
#[derive(Debug, Default)]
pub struct Vertices {
    /// Screen position, sub; 0 where the code says that there is none.
    pub x: Vec<i32>,
    /// Likewise.
    pub y: Vec<i32>,
    /// Inverse distance 1/w, 1/m.
    pub q: Vec<f64>,
    /// What the vertex is outside of.
    pub codes: Vec<u16>,
}

type Vector<S> = [f64x8<S>; 3];

/// `x_axis · v.x + y_axis · v.y + z_axis · v.z`, in glam's order.
#[inline(always)]
fn rotate<S: Simd>(columns: &[Vector<S>; 3], v: Vector<S>) -> Vector<S> {
    // Not with a closure: see `to_sub`.
    let ([ax, ay, az], [bx, by, bz], [cx, cy, cz], [x, y, z]) = (columns[0], columns[1], columns[2], v);
    [ax * x + bx * y + cx * z, ay * x + by * y + cy * z, az * x + bz * y + cz * z]
}

#[inline(always)]
fn columns<S: Simd>(simd: S, m: &glam::DMat3) -> [Vector<S>; 3] {
    each3([m.x_axis, m.y_axis, m.z_axis], |c| each3(c.to_array(), |n| f64x8::splat(simd, n)))
}

/// Eight f32 as f64.
#[inline(always)]
fn wide<S: Simd>(simd: S, from: &[f32]) -> f64x8<S> {
    let from: &[f32; LANES] = from.try_into().expect("eight lanes");
    let mut wide = [0.0; LANES];
    for (to, from) in wide.iter_mut().zip(from) {
        *to = f64::from(*from);
    }
    f64x8::simd_from(simd, wide)
}

/// Pixels rounded to sub-pixels, within the guard band. Not a closure: called twice, it would be a function without the level's
/// instructions, and each of its operations a call.
#[inline(always)]
fn to_sub<S: Simd>(simd: S, pixels: f64x8<S>) -> f64x8<S> {
    let limit = f64x8::splat(simd, f64::from(1i32 << GUARD_BITS));
    let low = f64x8::splat(simd, -f64::from(1i32 << GUARD_BITS));
    let c = (pixels * f64::from(SUBPIXELS) + 0.5).floor();
    let c = c.simd_gt(limit).select(limit, c);
    c.simd_lt(low).select(low, c)
}

#[inline(always)]
fn whole_numbers<S: Simd>(v: f64x8<S>, to: &mut [i32]) {
    let shifted: [f64; LANES] = (v + TO_INTEGER).into();
    let to: &mut [i32; LANES] = to.try_into().expect("eight lanes");
    for (to, n) in to.iter_mut().zip(shifted) {
        *to = n.to_bits() as u32 as i32;
    }
}

impl Vertices {
    /// Fills the arrays with the vertices of a subobject.
    #[inline(always)]
    pub fn transform<S: Simd>(&mut self, simd: S, camera: &Camera, visibility_m: f64, item: &Item<'_>) {
        let [px, py, pz] = item.stored.positions();
        let count = px.len();
        self.x.resize(count, 0);
        self.y.resize(count, 0);
        self.q.resize(count, 0.0);
        self.codes.resize(count, 0);
        let splat = |n: f64| f64x8::splat(simd, n);
        let origin = each3(item.stored.mesh.origin.to_array(), splat);
        let linear = columns(simd, &item.linear);
        let to_view = columns(simd, camera.to_view());
        let relative = each3(item.relative.to_array(), splat);
        let tangents = camera.tangents;
        let [left, right, bottom, top] = each4([tangents.left, tangents.right, tangents.bottom, tangents.top], splat);
        let guard = camera.guard;
        let (guard_left, guard_right) = (splat(guard.left), splat(guard.right));
        let (guard_bottom, guard_top) = (splat(guard.bottom), splat(guard.top));
        let [span_x, span_y] = camera.spans();
        let (span_x, span_y) = (splat(span_x), splat(span_y));
        let (width, height) = (splat(f64::from(camera.width)), splat(f64::from(camera.height)));
        let near = splat(camera.near);
        let visibility = splat(visibility_m);
        let range_squared = splat(visibility_m * visibility_m);
        let zero = splat(0.0);
        for at in (0..count).step_by(LANES) {
            let end = at + LANES;
            let p = [wide(simd, &px[at..end]), wide(simd, &py[at..end]), wide(simd, &pz[at..end])];
            let p = each3([0, 1, 2], |k| origin[k] + p[k]);
            let turned = rotate(&linear, p);
            let v = rotate(&to_view, each3([0, 1, 2], |k| turned[k] + relative[k]));
            let (x, y, w) = (v[0], v[1], zero - v[2]);
            // A NaN fails the comparison.
            let most = COORDINATE_MAX;
            let usable = x.abs().simd_lt(most) & y.abs().simd_lt(most) & w.abs().simd_lt(most);
            let behind = w.simd_lt(near);
            let cut = behind
                | (x - guard_left * w).simd_lt(zero)
                | (guard_right * w - x).simd_lt(zero)
                | (y - guard_bottom * w).simd_lt(zero)
                | (guard_top * w - y).simd_lt(zero);
            let beside = [x.simd_lt(left * w), x.simd_gt(right * w), y.simd_lt(bottom * w), y.simd_gt(top * w)];
            let beyond = (x * x + y * y + w * w).simd_gt(range_squared);
            let sx = to_sub(simd, (x / w - left) / span_x * width);
            let sy = to_sub(simd, (top - y / w) / span_y * height);
            let q = splat(1.0) / w;
            let codes: &mut [u16; LANES] = (&mut self.codes[at..end]).try_into().expect("eight lanes");
            let none = usable & !cut;
            let outside = beside[0] | beside[1] | beside[2] | beside[3] | beyond | !none;
            if outside.any_true() {
                // −0 is what whole numbers of unprojected vertices would be taken from otherwise: NaN has no whole number.
                let (sx, sy) = (none.select(sx, zero), none.select(sy, zero));
                whole_numbers(sx, &mut self.x[at..end]);
                whole_numbers(sy, &mut self.y[at..end]);
                none.select(q, zero).store_slice(&mut self.q[at..end]);
                let past = w.simd_gt(visibility);
                let [a, b, c, d] = beside;
                *codes = gather_codes(usable, [a, b, c, d, behind, past, beyond, cut]);
            } else {
                whole_numbers(sx, &mut self.x[at..end]);
                whole_numbers(sy, &mut self.y[at..end]);
                q.store_slice(&mut self.q[at..end]);
                *codes = [0; LANES];
            }
        }
    }
}

/// Bit k of lane i's code is lane i of mask k; what isn't usable has one bit of its own alone.
#[inline(always)]
fn gather_codes<S: Simd>(usable: mask64x8<S>, masks: [mask64x8<S>; 8]) -> [u16; LANES] {
    const _: () =
        assert!(NEAR == 1 << 4 && PAST == 1 << 5 && BEYOND == 1 << 6 && CUT == 1 << 7, "the order of the masks");
    let [a, b, c, d, e, f, g, h] = masks;
    let (low, high) = (each4([a, b, c, d], |m| m.to_bitmask()), each4([e, f, g, h], |m| m.to_bitmask()));
    let masks = [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]];
    let usable = usable.to_bitmask();
    std::array::from_fn(|lane| {
        if usable >> lane & 1 == 0 {
            return NOT_FINITE;
        }
        masks.iter().enumerate().fold(0, |code, (k, m)| code | ((m >> lane & 1) as u16) << k)
    })
}

/// Appends the unit normals of a subobject's vertices, world axes; 0 where a vertex has none or it can't be told.
#[inline(always)]
pub fn transform_normals<S: Simd>(simd: S, item: &Item<'_>, out: &mut Vec<[f32; 4]>) {
    let [nx, ny, nz] = item.stored.normals();
    let matrix = columns(simd, &item.normals_scaled());
    let first = out.len();
    out.resize(first + nx.len(), [0.0; 4]);
    let zero = f64x8::splat(simd, 0.0);
    for (at, to) in (0..nx.len()).step_by(LANES).zip(out[first..].chunks_exact_mut(LANES)) {
        let end = at + LANES;
        let n = rotate(&matrix, [wide(simd, &nx[at..end]), wide(simd, &ny[at..end]), wide(simd, &nz[at..end])]);
        let squared = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        let length = squared.sqrt();
        let exists = squared.simd_gt(1e-30);
        let [x, y, z]: [[f64; LANES]; 3] = each3(n, |c| exists.select(c / length, zero).into());
        for (lane, to) in to.iter_mut().enumerate() {
            *to = [x[lane] as f32, y[lane] as f32, z[lane] as f32, 0.0];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::transform::view_point;
    use crate::oracle::{Random, everything, mesh_of, state, store_of, view};
    use crate::pipeline::items_of;
    use crate::simd::{at_level, every_level};
    use glam::{DAffine3, DMat3, DQuat, DVec3};
    use proto::view::{Pose, Samples};

    #[test]
    fn eight_at_a_time_give_the_bits_of_the_scalar_twin_at_every_level() {
        let mut random = Random(0x5E7);
        let mut projected = 0;
        for round in 0..60 {
            let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
            let reach = [1.0, 100.0, 1e7][round % 3];
            let faces: Vec<[DVec3; 3]> = (0..9).map(|_| [0; 3].map(|_| vector() * reach)).collect();
            let turned = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, vector().normalize()));
            let transform =
                DAffine3 { matrix3: turned * DMat3::from_diagonal(vector()), translation: vector() * reach };
            let store = store_of(vec![(mesh_of(&faces, [1.0; 4]), transform)]);
            let mut state = state();
            let orientation = DQuat::from_rotation_arc(DVec3::NEG_Z, vector().normalize());
            state.eye = Pose { position: transform.translation - vector() * reach, orientation };
            let camera = Camera::new(&state, &view(640, 480, Samples::One));
            let mut items = Vec::new();
            items_of(&store, &camera, &everything(&store), &mut items).unwrap();
            let mut first: Option<Vertices> = None;
            for level in every_level() {
                let mut vertices = Vertices::default();
                at_level!(level, simd => vertices.transform(simd, &camera, reach, &items[0]));
                for i in 0..items[0].stored.mesh.positions.len() {
                    if vertices.codes[i] & (CUT | NOT_FINITE) == 0 {
                        let point = view_point(&camera, &items[0], i);
                        assert_eq!([vertices.x[i], vertices.y[i]], camera.project_sub(point), "{level:?}");
                        assert_eq!(vertices.q[i].to_bits(), (1.0 / point.w).to_bits(), "{level:?}");
                        projected += 1;
                    }
                }
                let first = first.get_or_insert_with(|| Vertices {
                    x: vertices.x.clone(),
                    y: vertices.y.clone(),
                    q: vertices.q.clone(),
                    codes: vertices.codes.clone(),
                });
                assert_eq!(
                    (&first.x, &first.y, &first.codes),
                    (&vertices.x, &vertices.y, &vertices.codes),
                    "{level:?}"
                );
            }
        }
        assert!(projected > 1000, "{projected} vertices were compared");
    }
}
