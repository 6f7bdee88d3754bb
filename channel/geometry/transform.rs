//! The geometry stage: a run of the list's subobjects in, set-up triangles out, in the order of the list.
//!
//! Per vertex, in f64 and in one order of operations for every subobject, so that pieces of one surface agree on shared
//! vertices to the bit: `linear · (origin + p) + (translation − eye)`, rotated to view axes, projected, rounded to 1/256
//! pixel. Per face: dropped if it is wholly outside a side of the view, cut if it crosses the near plane, dropped if
//! it faces away (by the sign of its rounded area; a mirrored object's faces run the other way round), has no area or no
//! sample inside.

use super::camera::{Camera, ViewPoint};
use super::clip::{CORNERS_MAX, ClippedFace};
use super::coarse::{self, Coarse};
use super::faces::{Corners, LANES, Sieve, Waiting};
use super::fine;
use super::plane::{FacePlanes, LastPlane, cofactors};
use super::setup::{ClipRecord, Flags, Plane, Triangle, WHOLE_FACE, area_twice};
use super::vertices::{BEYOND, CUT, NOT_FINITE, Vertices};
use crate::samples::Pattern;
use crate::simd::each3;
use crate::store::{Found, Presence, StoredMesh};
use crate::texture::MipTexture;
use crate::translucency::models::Member;
use fearless_simd::Simd;
use glam::{DMat3, DVec3};
use proto::scene::Alpha;

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
    /// Its level of detail, 0 the finest, or [`NO_LEVEL`](crate::debug::NO_LEVEL): for debug pictures.
    pub level: u8,
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
            level: found.level,
            planes: found.planes,
            base_texture: None,
            emissive_texture: None,
        })
    }

    /// [`Item::normals`] with a largest element of 1, so that no product leaves f32's range; zero if it has no scale.
    pub fn normals_scaled(&self) -> DMat3 {
        let largest =
            self.normals.to_cols_array().into_iter().fold(0.0, |m: f64, n| if n.abs() > m { n.abs() } else { m });
        if largest > 0.0 && largest.is_finite() { self.normals * (1.0 / largest) } else { DMat3::ZERO }
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
    /// Subobjects left out by their boxes: behind faces that cover their tiles, or in other boards' tiles.
    pub hidden_subobjects: u64,
    /// Faces of these.
    pub hidden: u64,
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
        self.hidden_subobjects += other.hidden_subobjects;
        self.hidden += other.hidden;
    }
}

/// No normals were transformed.
const NO_NORMALS: u32 = u32::MAX;

/// The triangles of a run of subobjects. Made empty and filled by [`GeometryRun::fill`]; used again frame by frame.
#[derive(Debug, Default)]
pub struct GeometryRun {
    /// Set-up triangles in the order of list and mesh; `item` counts from the list's beginning, `clip` within the run.
    pub triangles: Vec<Triangle>,
    /// Records of the pieces of cut faces.
    pub clips: Vec<ClipRecord>,
    /// Unit normals of vertices, world axes, the fourth number 0; all 0 where a vertex has none.
    normals: Vec<[f32; 4]>,
    /// Where an item's begin, from the run's first item on.
    first_normals: Vec<u32>,
    /// Number of the run's first item in the list.
    first_item: usize,
    /// What became of the faces.
    pub counts: GeometryCounts,
    /// Whether back faces of single-sided surfaces become triangles, to be left out by the raster stage.
    pub keeps_back: bool,
    /// How vertices are put on the screen.
    pub coarse: Coarse,
    vertices: Vertices,
}

impl GeometryRun {
    /// Transforms and sets up `items`, the first of which is number `first_item` of the list, but not those that are hidden.
    /// `visibility_m` is the range beyond which nothing is drawn, infinite if there is none.
    #[inline(always)]
    pub fn fill<S: Simd>(
        &mut self,
        simd: S,
        camera: &Camera,
        pattern: &Pattern,
        visibility_m: f64,
        items: &[Item<'_>],
        first_item: usize,
        is_hidden: impl Fn(&Item<'_>) -> bool,
    ) {
        self.triangles.clear();
        self.clips.clear();
        self.normals.clear();
        self.first_normals.clear();
        self.first_item = first_item;
        self.counts = GeometryCounts::default();
        for (i, item) in items.iter().enumerate() {
            if is_hidden(item) {
                let faces = item.stored.mesh.triangles.len() as u64;
                self.counts.faces_in += faces;
                self.counts.hidden += faces;
                self.counts.hidden_subobjects += 1;
                self.first_normals.push(NO_NORMALS);
                continue;
            }
            self.vertices.transform(simd, camera, visibility_m, item);
            if self.coarse != Coarse::default() {
                coarse::apply(simd, self.coarse, camera, item, &mut self.vertices);
            }
            let before = self.triangles.len();
            self.set_up(simd, camera, pattern, item, (first_item + i) as u32);
            let stored = item.stored;
            let wanted = self.triangles.len() != before && stored.has_normals() && !stored.mesh.material.unlit;
            let first = if wanted { self.normals.len() as u32 } else { NO_NORMALS };
            self.first_normals.push(first);
            if wanted {
                super::vertices::transform_normals(simd, item, &mut self.normals);
            }
        }
    }

    /// The transformed normals of an item's vertices, if there are any.
    #[inline(always)]
    pub fn normals_of(&self, item: usize) -> Option<&[[f32; 4]]> {
        let first = self.first_normals[item - self.first_item];
        (first != NO_NORMALS).then(|| &self.normals[first as usize..])
    }

    /// What decides which of an item's faces are drawn.
    fn sieve(&self, camera: &Camera, pattern: &Pattern, item: &Item<'_>) -> Sieve {
        let double_sided = item.stored.mesh.material.double_sided;
        Sieve {
            size: [camera.width as i32, camera.height as i32],
            samples: [pattern.low, pattern.high()],
            mirrored: item.mirrored,
            keeps_back: double_sided || self.keeps_back,
            flags: if item.part.is_some() { Flags::PART } else { 0 }
                | if item.cutoff().is_some() { Flags::CUT_OUT } else { 0 },
            back: if double_sided { 0 } else { Flags::BACK },
        }
    }

    /// The faces of an item whose vertices are transformed.
    #[inline(always)]
    fn set_up<S: Simd>(&mut self, simd: S, camera: &Camera, pattern: &Pattern, item: &Item<'_>, number: u32) {
        let mesh = &item.stored.mesh;
        self.counts.faces_in += mesh.triangles.len() as u64;
        let sieve = self.sieve(camera, pattern, item);
        let mut last_plane = None;
        if pattern.is_exact() {
            for face in 0..mesh.triangles.len() as u32 {
                self.set_up_one(camera, pattern, item, &sieve, [number, face], &mut last_plane);
            }
            return;
        }
        let mut corners = Corners::default();
        let mut waiting = Waiting::default();
        for (chunk, faces) in mesh.triangles.chunks(LANES).enumerate() {
            let outside = corners.gather(&self.vertices, faces);
            let sorted = corners.sort(simd, &sieve, faces.len(), outside);
            let mut rest = sorted.drawn | sorted.single;
            self.counts.backface += u64::from(sorted.backface.count_ones());
            self.counts.no_sample +=
                faces.len() as u64 - u64::from(rest.count_ones()) - u64::from(sorted.backface.count_ones());
            while rest != 0 {
                let lane = rest.trailing_zeros() as usize;
                rest &= rest - 1;
                let face = (chunk * LANES + lane) as u32;
                if sorted.single >> lane & 1 != 0 {
                    // What was met before comes before.
                    self.set_up_waiting(simd, camera, item, number, &mut waiting, &mut last_plane);
                    self.set_up_one(camera, pattern, item, &sieve, [number, face], &mut last_plane);
                    continue;
                }
                let swapped = sorted.swapped >> lane & 1 != 0;
                let behind = sorted.behind >> lane & 1 != 0;
                let order = if swapped { [0, 2, 1] } else { [0, 1, 2] };
                let q = each3(order, |k| self.vertices.q[faces[lane][k] as usize]);
                let (x, y) = (each3(order, |k| corners.x[k][lane]), each3(order, |k| corners.y[k][lane]));
                if waiting.put(x, y, q, face, sieve.flags_of(swapped, behind)) {
                    self.set_up_waiting(simd, camera, item, number, &mut waiting, &mut last_plane);
                }
            }
        }
        self.set_up_waiting(simd, camera, item, number, &mut waiting, &mut last_plane);
    }

    /// The faces that wait become triangles.
    #[inline(always)]
    fn set_up_waiting<S: Simd>(
        &mut self,
        simd: S,
        camera: &Camera,
        item: &Item<'_>,
        number: u32,
        waiting: &mut Waiting,
        last_plane: &mut LastPlane,
    ) {
        if waiting.count == 0 {
            return;
        }
        let planes = &waiting.planes;
        let [dx, dy] = planes.slopes(simd);
        for i in 0..waiting.count {
            let (x, y) = (each3(planes.x, |c| c[i]), each3(planes.y, |c| c[i]));
            let face = waiting.faces[i];
            let own = Plane { q: planes.q[0][i], dx: dx[i], dy: dy[i], x: x[0], y: y[0] };
            let shared = item.planes.as_ref().and_then(|p| p.of_face(camera, face as usize, last_plane));
            let flags = waiting.flags[i] | if shared.is_some() { Flags::SHARED_PLANE } else { 0 };
            let plane = shared.unwrap_or(own);
            self.triangles.push(Triangle::new(x, y, &plane, number, face, WHOLE_FACE, Flags(flags)));
        }
        waiting.count = 0;
    }

    /// One face in general: the twin of what is done for sixteen at once.
    #[inline(never)]
    fn set_up_one(
        &mut self,
        camera: &Camera,
        pattern: &Pattern,
        item: &Item<'_>,
        sieve: &Sieve,
        [number, face]: [u32; 2],
        last_plane: &mut LastPlane,
    ) {
        let corners = &item.stored.mesh.triangles[face as usize];
        let v = each3(*corners, |c| c as usize);
        let codes = each3(v, |k| self.vertices.codes[k]);
        let any = codes[0] | codes[1] | codes[2];
        let mut seed = sieve.flags;
        if any != 0 {
            if any & NOT_FINITE != 0 {
                self.counts.not_finite += 1;
                return;
            }
            // A face may have all vertices beyond the range of visibility and its middle within: BEYOND doesn't reject,
            // but all past the plane at that distance do.
            if codes[0] & codes[1] & codes[2] & !(BEYOND | CUT) != 0 {
                self.counts.off_screen += 1;
                return;
            }
            if any & BEYOND != 0 {
                seed |= Flags::BEYOND;
            }
        }
        let sieve = &Sieve { flags: seed, ..*sieve };
        let shared_plane = |last_plane: &mut LastPlane| {
            item.planes.as_ref().and_then(|p| p.of_face(camera, face as usize, last_plane))
        };
        if any & CUT != 0 {
            self.counts.clipped += 1;
            let shared = shared_plane(last_plane);
            self.set_up_clipped(camera, item, sieve, pattern.is_exact(), shared, [number, face], corners);
            return;
        }
        let x = each3(v, |k| self.vertices.x[k]);
        let y = each3(v, |k| self.vertices.y[k]);
        let area = area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]);
        let is_doubtful = pattern.is_exact() && fine::is_doubtful(x, y, area);
        let turn = if is_doubtful { fine::turn(camera, item, v) } else { area };
        let Some(mut flags) = self.side(turn, sieve) else { return };
        let (x, y) = if is_doubtful { fine::with_area(x, y) } else { (x, y) };
        if is_doubtful {
            let area = area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]);
            flags = flags & !Flags::SWAPPED | if area < 0 { Flags::SWAPPED } else { 0 };
        }
        if sieve.misses(x, y) {
            self.counts.no_sample += 1;
            return;
        }
        let order = if flags & Flags::SWAPPED != 0 { [0, 2, 1] } else { [0, 1, 2] };
        let (x, y, v) = (each3(order, |k| x[k]), each3(order, |k| y[k]), each3(order, |k| v[k]));
        let q = each3(v, |k| self.vertices.q[k]);
        let shared = shared_plane(last_plane);
        let plane = shared.unwrap_or_else(|| Plane::through(x, y, q));
        flags |= if shared.is_some() { Flags::SHARED_PLANE } else { 0 };
        self.triangles.push(Triangle::new(x, y, &plane, number, face, WHOLE_FACE, Flags(flags)));
    }

    /// The flags of a face of that rounded area; `None`, and counted, if it is not to be drawn. On a screen whose y runs
    /// downwards a counter-clockwise face, seen from its front, has a negative area.
    fn side(&mut self, area: i64, sieve: &Sieve) -> Option<u8> {
        if area == 0 {
            self.counts.no_sample += 1;
            return None;
        }
        let behind = (area < 0) == sieve.mirrored;
        if behind && !sieve.keeps_back {
            self.counts.backface += 1;
            return None;
        }
        Some(sieve.flags_of(area < 0, behind))
    }

    /// What crosses the near plane or leaves the guard band: cut, then set up piece by piece.
    #[inline(never)]
    fn set_up_clipped(
        &mut self,
        camera: &Camera,
        item: &Item<'_>,
        sieve: &Sieve,
        is_exact: bool,
        shared: Option<Plane>,
        [number, face]: [u32; 2],
        vertices: &[u32; 3],
    ) {
        let points = vertices.map(|v| view_point(camera, item, v as usize));
        let Some(clipped) = ClippedFace::new(camera, points) else {
            self.counts.off_screen += 1;
            return;
        };
        let corners = clipped.corners();
        let count = corners.len();
        let sub: [[i32; 2]; CORNERS_MAX] =
            std::array::from_fn(|k| corners.get(k).map_or([0; 2], |c| camera.project_sub(c.point)));
        let fan = |apex: usize| (1..count - 1).map(move |k| [apex, (apex + k) % count, (apex + k + 1) % count]);
        let area_of = |[a, b, c]: [usize; 3]| area_twice(sub[a], sub[b], sub[c]);
        // The whole polygon faces one way, and its pieces with it. Rounding may have dented a corner of it by a
        // sub-pixel: take the first fan without a piece turned over.
        let area: i64 = if is_exact { fine::turn_of_cut(camera, &clipped) } else { fan(0).map(area_of).sum() };
        let Some(side) = self.side(area, sieve) else { return };
        let swapped = side & Flags::SWAPPED != 0;
        let is_good = |piece: [usize; 3]| if swapped { area_of(piece) <= 0 } else { area_of(piece) >= 0 };
        let apex = (0..count).find(|apex| fan(*apex).all(is_good)).unwrap_or(0);
        let flags = Flags(side | if shared.is_some() { Flags::SHARED_PLANE } else { 0 });

        let first = self.triangles.len();
        for [a, b, c] in fan(apex) {
            let mut order = if swapped { [a, c, b] } else { [a, b, c] };
            let (mut x, mut y) = (order.map(|k| sub[k][0]), order.map(|k| sub[k][1]));
            let mut flags = flags;
            if is_exact && area_of(order) <= 0 {
                // A piece that is thinner than rounding: what its area is, its true corners say.
                (x, y) = fine::with_area(x, y);
                if area_twice([x[0], y[0]], [x[1], y[1]], [x[2], y[2]]) < 0 {
                    (order, x, y) = ([order[0], order[2], order[1]], [x[0], x[2], x[1]], [y[0], y[2], y[1]]);
                    flags.0 ^= Flags::SWAPPED;
                }
            } else if area_of(order) <= 0 {
                continue;
            }
            if sieve.misses(x, y) {
                continue;
            }
            let plane = shared.unwrap_or_else(|| Plane::through(x, y, order.map(|k| 1.0 / corners[k].point.w)));
            let clip = self.clips.len() as u32;
            let before = (self.triangles.len() - first) as u8;
            self.clips.push(ClipRecord { weights: order.map(|k| corners[k].weights), before, pieces: 0 });
            self.triangles.push(Triangle::new(x, y, &plane, number, face, clip, flags));
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

/// A vertex in view axes: the scalar twin of [`Vertices::transform`], the same operations in the same order.
pub(crate) fn view_point(camera: &Camera, item: &Item<'_>, vertex: usize) -> ViewPoint {
    camera.view_point(item.linear * item.stored.mesh.position(vertex) + item.relative)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle::{Random, everything, mesh_of, state, store_of, view};
    use crate::pipeline::items_of;
    use crate::simd::{at_level, every_level};
    use glam::DAffine3;
    use proto::view::Samples;

    /// The triangles of the run's items when each face goes by itself.
    fn one_by_one(run: &mut GeometryRun, camera: &Camera, pattern: &Pattern, items: &[Item<'_>]) -> Vec<Triangle> {
        run.triangles.clear();
        run.counts = GeometryCounts::default();
        for (number, item) in items.iter().enumerate() {
            at_level!(every_level()[0], simd => run.vertices.transform(simd, camera, 60.0, item));
            let sieve = run.sieve(camera, pattern, item);
            run.counts.faces_in += item.stored.mesh.triangles.len() as u64;
            for face in 0..item.stored.mesh.triangles.len() as u32 {
                run.set_up_one(camera, pattern, item, &sieve, [number as u32, face], &mut None);
            }
        }
        std::mem::take(&mut run.triangles)
    }

    #[test]
    fn sixteen_at_once_become_what_they_become_one_by_one_at_every_level() {
        let mut random = Random(0x16FA);
        let (mut seen, mut kinds) = (0, [0; 5]);
        for round in 0..80 {
            let mut placed = Vec::new();
            for k in 0..4 {
                let faces: Vec<[DVec3; 3]> = (0..random.below(70))
                    .map(|_| {
                        // From splinters to what fills the view, on both sides of the near plane and of the range of visibility.
                        let size = libm::exp10(random.unit() * 5.0 - 3.0);
                        let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
                        let at = vector() * DVec3::new(20.0, 15.0, 40.0) - DVec3::Z * 30.0;
                        let mut corners = [0; 3].map(|_| at + vector() * size);
                        if random.below(10) == 0 {
                            corners[2] = corners[random.below(2) as usize];
                        }
                        corners
                    })
                    .collect();
                let mut mesh = mesh_of(&faces, [1.0; 4]);
                mesh.material.double_sided = k % 2 == 0;
                let mirror = if random.below(2) == 0 { 1.0 } else { -1.0 };
                placed.push((mesh, DAffine3::from_scale(DVec3::new(mirror, 1.0, 1.0))));
            }
            let store = store_of(placed);
            let camera = Camera::new(&state(), &view(320, 240, Samples::One));
            let pattern = Pattern::of([Samples::One, Samples::Four, Samples::SixtyFour][round % 3]);
            let mut items = Vec::new();
            items_of(&store, &camera, &everything(&store), &mut items).unwrap();
            let mut run = GeometryRun { keeps_back: round % 4 == 0, ..GeometryRun::default() };
            let expected = one_by_one(&mut run, &camera, pattern, &items);
            let counts = run.counts;
            for level in every_level() {
                at_level!(level, simd => run.fill(simd, &camera, pattern, 60.0, &items, 0, |_| false));
                assert!(run.triangles == expected, "{level:?}, round {round}");
                assert_eq!(run.counts, counts, "{level:?}, round {round}");
            }
            seen += expected.len();
            let met = [counts.off_screen, counts.backface, counts.no_sample, counts.clipped, counts.faces_in];
            kinds = std::array::from_fn(|k| kinds[k] + met[k]);
        }
        assert!(seen > 1000 && kinds.iter().all(|count| *count > 50), "{seen}, {kinds:?}");
    }
}
