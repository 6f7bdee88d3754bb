//! The geometry stage: a run of the list's subobjects in, set-up triangles out, in the order of the list.
//!
//! Per vertex, in f64 and in one order of operations for every subobject, so that pieces of one surface agree on shared
//! vertices to the bit: `linear · (origin + p) + (translation − eye)`, rotated to view axes, projected, rounded to 1/256
//! pixel. Per face: dropped if it is wholly outside a side of the view, cut if it crosses the near plane, dropped if
//! it faces away (by the sign of its rounded area; a mirrored object's faces run the other way round), has no area or no
//! sample inside.

use super::camera::{Camera, ViewPoint};
use super::clip::{ClippedFace, outside};
use super::plane::{FacePlanes, cofactors};
use super::setup::{ClipRecord, Flags, Plane, Triangle, WHOLE_FACE, area_twice};
use crate::samples::Pattern;
use crate::store::{Found, Presence, StoredMesh};
use crate::texture::MipTexture;
use crate::translucency::models::Member;
use glam::{DMat3, DVec3};
use proto::scene::Alpha;

/// Coordinates beyond this, m, are taken for nonsense: their squares would leave f64's range. The face is dropped.
const COORDINATE_MAX: f64 = 1e100;

/// One subobject of a frame's list, ready to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct Item<'a> {
    /// Place of its (layer, primitive) in the file: where faces coincide the larger wins.
    pub rank: u32,
    /// Its geometry and material.
    pub stored: &'a StoredMesh,
    /// Mesh axes → world axes.
    pub linear: DMat3,
    /// The mesh's origin of axes relative to the view's eye, world axes, m.
    pub relative: DVec3,
    /// Whether the transformation turns left into right.
    pub mirrored: bool,
    /// Normals from mesh axes to world axes; lengths mean nothing.
    pub normals: DMat3,
    /// What its fragments belong to, if they aren't each a layer of their own.
    pub part: Option<Member<'a>>,
    /// Whether all of its faces are fragments, opaque ones as well: its model is in transition.
    pub in_transition: bool,
    /// The planes of the faces that lie over others.
    pub planes: Option<FacePlanes<'a>>,
    /// The base colour's texture.
    pub base_texture: Option<&'a MipTexture>,
    /// The emissive colour's texture.
    pub emissive_texture: Option<&'a MipTexture>,
}

impl<'a> Item<'a> {
    /// A subobject without its textures; `None` if nothing of it is shown.
    pub(crate) fn new(found: &Found<'a>, camera: &Camera) -> Option<Self> {
        let is_blend = matches!(found.stored.mesh.material.alpha, Alpha::Blend);
        let (part, in_transition) = match found.presence {
            Presence::Absent => return None,
            Presence::Ordinary => (None, false),
            Presence::Merged(part) => (is_blend.then_some(part), false),
            Presence::InTransition(part) => (Some(part), true),
        };
        let linear = found.transform.matrix3;
        let mirrored = linear.determinant() < 0.0;
        // The inverse transpose is the matrix of cofactors divided by the determinant. Only its direction counts, so that
        // the determinant's sign is enough, and a flattened object still has normals.
        let sign = if mirrored { -1.0 } else { 1.0 };
        Some(Self {
            rank: found.rank,
            stored: found.stored,
            linear,
            relative: camera.relative(found.transform),
            mirrored,
            normals: cofactors(&linear) * sign,
            part,
            in_transition,
            planes: found.planes,
            base_texture: None,
            emissive_texture: None,
        })
    }

    /// Whether its faces are kept as fragments: they are translucent, or its model is in transition.
    #[inline]
    pub fn is_fragments(&self) -> bool {
        self.in_transition || self.is_translucent()
    }

    /// Whether its alpha is a saturation.
    #[inline]
    pub fn is_translucent(&self) -> bool {
        matches!(self.stored.mesh.material.alpha, Alpha::Blend)
    }

    /// The cut-off, if its faces exist only where alpha reaches one.
    #[inline]
    pub fn cutoff(&self) -> Option<f32> {
        match self.stored.mesh.material.alpha {
            Alpha::Mask { cutoff } => Some(cutoff),
            Alpha::Opaque | Alpha::Blend => None,
        }
    }
}

/// What became of the faces of a run of subobjects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GeometryCounts {
    /// Faces of the meshes.
    pub faces_in: u64,
    /// Dropped: a vertex is not a number or out of all range.
    pub not_finite: u64,
    /// Dropped: wholly beside the view, behind the near plane or beyond visibility.
    pub off_screen: u64,
    /// Dropped: a single-sided face seen from behind.
    pub backface: u64,
    /// Dropped: no area, or no sample within its extent.
    pub no_sample: u64,
    /// Cut at the near plane or the guard band.
    pub clipped: u64,
}

impl GeometryCounts {
    /// Adds another run's counts.
    pub fn add(&mut self, other: &Self) {
        self.faces_in += other.faces_in;
        self.not_finite += other.not_finite;
        self.off_screen += other.off_screen;
        self.backface += other.backface;
        self.no_sample += other.no_sample;
        self.clipped += other.clipped;
    }
}

/// A vertex on its way to the screen.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    point: ViewPoint,
    sub: [i32; 2],
    /// 1/w; 0 where the vertex can't be projected.
    q: f64,
    /// Bits of [`outside`]: not zero if a face with this vertex must be cut.
    cut: u8,
    /// Bits of [`beside`].
    beside: u8,
}

const NOT_FINITE: u8 = 1 << 6;
const BEYOND: u8 = 1 << 5;

/// Sides of the view (bits 0 to 3) and near plane (bit 4) that a point is outside of, and [`BEYOND`] visibility. A face is out of
/// the view if all of its vertices are outside of one plane: true in space, behind the eye as well.
#[inline]
fn beside(camera: &Camera, p: ViewPoint, range_squared: f64) -> u8 {
    let t = &camera.tangents;
    u8::from(p.x < t.left * p.w)
        | u8::from(p.x > t.right * p.w) << 1
        | u8::from(p.y < t.bottom * p.w) << 2
        | u8::from(p.y > t.top * p.w) << 3
        | u8::from(p.w < camera.near) << 4
        | if p.x * p.x + p.y * p.y + p.w * p.w > range_squared { BEYOND } else { 0 }
}

/// The triangles of a run of subobjects. Made empty and filled by [`GeometryRun::fill`]; used again frame by frame.
#[derive(Debug, Default)]
pub struct GeometryRun {
    /// Set-up triangles in the order of list and mesh; `item` counts from the list's beginning, `clip` within the run.
    pub triangles: Vec<Triangle>,
    /// Records of the pieces of cut faces.
    pub clips: Vec<ClipRecord>,
    /// What became of the faces.
    pub counts: GeometryCounts,
    vertices: Vec<Vertex>,
}

impl GeometryRun {
    /// Transforms and sets up `items`, the first of which is number `first_item` of the list. `visibility_m` is the range
    /// beyond which nothing is drawn, infinite if there is none.
    pub fn fill(
        &mut self,
        camera: &Camera,
        pattern: &Pattern,
        visibility_m: f64,
        items: &[Item<'_>],
        first_item: usize,
    ) {
        self.triangles.clear();
        self.clips.clear();
        self.counts = GeometryCounts::default();
        for (i, item) in items.iter().enumerate() {
            self.transform(camera, visibility_m, item);
            self.set_up(camera, pattern, visibility_m, item, (first_item + i) as u32);
        }
    }

    fn transform(&mut self, camera: &Camera, visibility_m: f64, item: &Item<'_>) {
        let mesh = &item.stored.mesh;
        let range_squared = visibility_m * visibility_m;
        self.vertices.clear();
        self.vertices.extend((0..mesh.positions.len()).map(|i| {
            let point = camera.view_point(item.linear * mesh.position(i) + item.relative);
            // A NaN fails the comparison.
            let usable =
                point.x.abs() < COORDINATE_MAX && point.y.abs() < COORDINATE_MAX && point.w.abs() < COORDINATE_MAX;
            if !usable {
                return Vertex { point, sub: [0; 2], q: 0.0, cut: 0, beside: NOT_FINITE };
            }
            let cut = outside(camera, point);
            let beside = beside(camera, point, range_squared);
            if cut == 0 {
                Vertex { point, sub: camera.project_sub(point), q: 1.0 / point.w, cut, beside }
            } else {
                Vertex { point, sub: [0; 2], q: 0.0, cut, beside }
            }
        }));
    }

    fn set_up(&mut self, camera: &Camera, pattern: &Pattern, visibility_m: f64, item: &Item<'_>, number: u32) {
        let mesh = &item.stored.mesh;
        let double_sided = mesh.material.double_sided;
        let mut last_plane = None;
        let part = if item.part.is_some() { Flags::PART } else { 0 };
        self.counts.faces_in += mesh.triangles.len() as u64;
        for (face, corners) in mesh.triangles.iter().enumerate() {
            let v = corners.map(|c| self.vertices[c as usize]);
            let any = v[0].beside | v[1].beside | v[2].beside;
            if any & NOT_FINITE != 0 {
                self.counts.not_finite += 1;
                continue;
            }
            // A face may have all vertices beyond the range of visibility and its middle within: BEYOND doesn't reject.
            if v[0].beside & v[1].beside & v[2].beside & !BEYOND != 0 {
                self.counts.off_screen += 1;
                continue;
            }
            let seed = Triangle {
                x: [0; 3],
                y: [0; 3],
                plane: Plane::default(),
                q: [0.0; 3],
                order: u64::from(item.rank) << 32 | u64::from(mesh.face_numbers[face]),
                item: number,
                face: face as u32,
                clip: WHOLE_FACE,
                flags: Flags(part | if any & BEYOND != 0 { Flags::BEYOND } else { 0 }),
            };
            if v[0].cut | v[1].cut | v[2].cut == 0 {
                if v.iter().all(|v| v.point.w > visibility_m) {
                    self.counts.off_screen += 1;
                    continue;
                }
                let area = area_twice(v[0].sub, v[1].sub, v[2].sub);
                let Some(flags) = self.side(area, item.mirrored, double_sided) else { continue };
                let order = if flags & Flags::SWAPPED != 0 { [0, 2, 1] } else { [0, 1, 2] };
                let triangle = Triangle { flags: Flags(seed.flags.0 | flags), ..seed };
                let corners = order.map(|k| (v[k].sub, v[k].q));
                let shared = item.planes.as_ref().and_then(|planes| planes.of_face(camera, face, &mut last_plane));
                if let Some(triangle) = placed(camera, pattern, triangle, corners, shared) {
                    self.triangles.push(triangle);
                } else {
                    self.counts.no_sample += 1;
                }
            } else {
                self.counts.clipped += 1;
                let shared = item.planes.as_ref().and_then(|planes| planes.of_face(camera, face, &mut last_plane));
                self.set_up_clipped(camera, pattern, item, shared, seed, v.map(|v| v.point));
            }
        }
    }

    /// How a face of that rounded area is to be drawn; `None`, and counted, if not at all. On a screen whose y runs
    /// downwards a counter-clockwise face, seen from its front, has a negative area.
    fn side(&mut self, area: i64, mirrored: bool, double_sided: bool) -> Option<u8> {
        if area == 0 {
            self.counts.no_sample += 1;
            return None;
        }
        let front = (area < 0) != mirrored;
        if !front && !double_sided {
            self.counts.backface += 1;
            return None;
        }
        Some(if area < 0 { Flags::SWAPPED } else { 0 } | if front { 0 } else { Flags::BEHIND })
    }

    fn set_up_clipped(
        &mut self,
        camera: &Camera,
        pattern: &Pattern,
        item: &Item<'_>,
        shared: Option<Plane>,
        seed: Triangle,
        points: [ViewPoint; 3],
    ) {
        let Some(clipped) = ClippedFace::new(camera, points) else {
            self.counts.off_screen += 1;
            return;
        };
        let corners = clipped.corners();
        let count = corners.len();
        let sub: Vec<[i32; 2]> = corners.iter().map(|c| camera.project_sub(c.point)).collect();
        let fan = |apex: usize| (1..count - 1).map(move |k| [apex, (apex + k) % count, (apex + k + 1) % count]);
        let area_of = |[a, b, c]: [usize; 3]| area_twice(sub[a], sub[b], sub[c]);
        // The whole polygon faces one way, and its pieces with it. Rounding may have dented a corner of it by a
        // sub-pixel: take the first fan without a piece turned over.
        let area: i64 = fan(0).map(area_of).sum();
        let Some(flags) = self.side(area, item.mirrored, item.stored.mesh.material.double_sided) else { return };
        let swapped = flags & Flags::SWAPPED != 0;
        let is_good = |piece: [usize; 3]| if swapped { area_of(piece) <= 0 } else { area_of(piece) >= 0 };
        let apex = (0..count).find(|apex| fan(*apex).all(is_good)).unwrap_or(0);

        let first = self.triangles.len();
        for [a, b, c] in fan(apex) {
            let order = if swapped { [a, c, b] } else { [a, b, c] };
            if area_of(order) <= 0 {
                continue;
            }
            let triangle = Triangle { flags: Flags(seed.flags.0 | flags), clip: self.clips.len() as u32, ..seed };
            let corners = order.map(|k| (sub[k], 1.0 / corners[k].point.w));
            let placed = placed(camera, pattern, triangle, corners, shared);
            if let Some(triangle) = placed {
                let before = (self.triangles.len() - first) as u8;
                self.clips.push(ClipRecord { weights: order.map(|k| clipped.corners()[k].weights), before, pieces: 0 });
                self.triangles.push(triangle);
            }
        }
        let pieces = self.triangles.len() - first;
        if pieces == 0 {
            self.counts.no_sample += 1;
        }
        let records = self.clips.len();
        for record in &mut self.clips[records - pieces..] {
            record.pieces = pieces as u8;
        }
    }
}

/// A triangle with its corners (positive area) and its plane, `shared` if it lies over others; `None` if no pixel of the view has a sample in its extent.
#[inline]
fn placed(
    camera: &Camera,
    pattern: &Pattern,
    mut triangle: Triangle,
    corners: [([i32; 2], f64); 3],
    shared: Option<Plane>,
) -> Option<Triangle> {
    triangle.x = corners.map(|(sub, _)| sub[0]);
    triangle.y = corners.map(|(sub, _)| sub[1]);
    let [[x0, x1], [y0, y1]] = triangle.pixels(pattern.low, pattern.high());
    if x0.max(0) > x1.min(camera.width as i32 - 1) || y0.max(0) > y1.min(camera.height as i32 - 1) {
        return None;
    }
    triangle.q = corners.map(|(_, q)| q);
    triangle.plane = shared.unwrap_or_else(|| Triangle::plane_through(triangle.x, triangle.y, triangle.q));
    Some(triangle)
}
