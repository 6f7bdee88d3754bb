//! A face prepared for shading in general: textures, vertex colours, fading, lights of the scene.
//!
//! Attributes are interpolated perspectively: the barycentric numerators are edge functions of the rounded vertices, exact
//! integers, times the corners' inverse distances, divided by their sum. Texture gradients come from the same planes,
//! analytically, so that a pixel's footprint in a texture depends on nothing but the pixel and the face. What a face needs for this is
//! prepared once per tile and kept in a small cache. Faces that need none of it are shaded by [`super::tile`].

use crate::frame::Frame;
use crate::geometry::setup::{FARTHEST, Flags, Plane, Triangle};
use crate::geometry::transform::Item;
use crate::raster::coverage::Edges;
use crate::samples::SUBPIXELS;
use crate::simd::{each2, each3, each4};
use crate::texture::{Footprint, MipTexture, detail};
use glam::DVec3;
use proto::scene::{Mesh, TextureUse};

/// Faces that the cache has room for; a power of two.
const CACHE_FACES: usize = 256;

/// No face is cached here.
const NOBODY: u32 = u32::MAX;

/// Faces prepared for shading; direct-mapped by triangle number. One per thread, cleared tile by tile.
#[derive(Debug)]
pub struct FaceCache {
    numbers: Vec<u32>,
    faces: Vec<Face>,
}

impl FaceCache {
    /// An empty cache.
    pub fn new() -> Self {
        Self { numbers: vec![NOBODY; CACHE_FACES], faces: vec![Face::default(); CACHE_FACES] }
    }

    /// Forgets all faces: triangle numbers mean others in the next frame.
    pub fn clear(&mut self) {
        self.numbers.fill(NOBODY);
    }

    #[inline]
    pub(super) fn of(&mut self, frame: &Frame<'_>, number: u32) -> &Face {
        let place = number as usize % CACHE_FACES;
        if self.numbers[place] != number {
            self.faces[place] = Face::new(frame, number);
            self.numbers[place] = number;
        }
        &self.faces[place]
    }
}

impl Default for FaceCache {
    fn default() -> Self {
        Self::new()
    }
}

/// A triangle prepared for shading.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Face {
    x: [i32; 3],
    y: [i32; 3],
    q: [f64; 3],
    pub(super) edges: Edges,
    /// Inverse distance.
    plane: Plane,
    /// Index into the frame's list.
    item: u32,
    /// Linear RGBA where there is nothing to interpolate: the colour everywhere on the face, before fading.
    pub(super) constant: Option<[f32; 4]>,
    /// Transformed coordinates of the base and the emissive texture at the corners, if the material has them.
    uv: [Option<[[f64; 2]; 3]>; 2],
    /// Change of [`Place::sum`] per sub-pixel, to the right and downwards.
    sum_steps: [f64; 2],
    /// Likewise of u and v times that sum, for both textures.
    uv_steps: [[[f64; 2]; 2]; 2],
    /// Base colour factor times vertex colour, at the corners.
    base: [[f32; 4]; 3],
    /// Whether these differ.
    is_coloured: bool,
    emissive: [f32; 3],
    /// Unit vectors, world axes, turned towards the eye's side; all equal on a flat face.
    normals: [DVec3; 3],
    /// Whether these differ.
    is_smooth: bool,
    unlit: bool,
}

/// A place on a face.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Barycentric numerators times inverse distances: proportional to the weights of the corners in space.
    parts: [f64; 3],
    /// Their sum; positive on the face.
    sum: f64,
}

impl Place {
    /// Weights of the corners; their sum is 1.
    #[inline]
    fn weights(&self) -> [f64; 3] {
        let scale = 1.0 / self.sum;
        each3(self.parts, |p| p * scale)
    }
}

impl Face {
    fn new(frame: &Frame<'_>, number: u32) -> Self {
        let triangle = frame.triangle(number);
        let item = &frame.items[triangle.item as usize];
        let mesh = &item.stored.mesh;
        let material = &mesh.material;
        let vertices = mesh.triangles[triangle.face as usize].map(|v| v as usize);
        let corners = Corners::of(frame, number);

        let behind = if triangle.flags.has(Flags::BEHIND) { -1.0 } else { 1.0 };
        let normals = corners.mix(vertex_normals(item, vertices).map(|n| (n * behind).to_array())).map(DVec3::from);
        let base = if mesh.colors.is_empty() {
            [material.base_color; 3]
        } else {
            let tinted = |v: usize| std::array::from_fn(|c| f64::from(material.base_color[c] * mesh.colors[v][c]));
            corners.mix(vertices.map(tinted)).map(|c| c.map(|c| c as f32))
        };
        let uv =
            |usage: &Option<TextureUse>| usage.as_ref().map(|u| corners.mix(vertices.map(|v| texcoord(mesh, u, v))));
        let uv = [uv(&material.base_texture), uv(&material.emissive_texture)];
        let steps = part_steps(triangle);
        let uv_steps = uv.map(|uv| {
            let uv = uv.unwrap_or_default();
            let along =
                |step: [f64; 3], axis: usize| step[0] * uv[0][axis] + step[1] * uv[1][axis] + step[2] * uv[2][axis];
            [0, 1].map(|axis| steps.map(|step| along(step, axis)))
        });
        let mut face = Self {
            x: triangle.x,
            y: triangle.y,
            q: triangle.corner_q(),
            edges: Edges::of(triangle),
            plane: triangle.plane(),
            item: triangle.item,
            constant: None,
            uv,
            sum_steps: steps.map(|step| step[0] + step[1] + step[2]),
            uv_steps,
            base,
            is_coloured: base[0] != base[1] || base[0] != base[2],
            emissive: material.emissive,
            normals,
            is_smooth: !material.unlit && (normals[0] != normals[1] || normals[0] != normals[2]),
            unlit: material.unlit,
        };
        let is_lit_alike = face.unlit || frame.lit_alike;
        if is_lit_alike && !face.is_smooth && !face.is_coloured && face.uv.iter().all(Option::is_none) {
            face.constant = Some(face.lit(frame, base[0], face.emissive, normals[0], DVec3::ZERO));
        }
        face
    }

    /// Linear RGB, faded, and alpha at a sub-pixel position on the face, textures averaged over the pixel whose upper
    /// left is `pixel`.
    pub(super) fn colour(&self, frame: &Frame<'_>, x: i32, y: i32, pixel: [i32; 2]) -> [f32; 4] {
        let place = self.place(x, y);
        let mut colour = self.constant.unwrap_or_else(|| {
            let weights = place.weights();
            let mut base = self.base_at(weights);
            let mut emissive = self.emissive;
            if self.uv[0].is_some() {
                let texel = self.averaged(frame, 0, &place, weights, [x, y], pixel);
                base = each4([0, 1, 2, 3], |c| base[c] * texel[c]);
            }
            if self.uv[1].is_some() {
                let texel = self.averaged(frame, 1, &place, weights, [x, y], pixel);
                emissive = each3([0, 1, 2], |c| emissive[c] * texel[c]);
            }
            let normal = if self.is_smooth {
                let [a, b, c] = self.normals;
                unit(a * weights[0] + b * weights[1] + c * weights[2])
            } else {
                self.normals[0]
            };
            let point = if frame.lights.is_empty() {
                DVec3::ZERO
            } else {
                let [rx, ry] = frame.camera.ray(x, y);
                frame.camera.world_axes(DVec3::new(rx, ry, -1.0) / self.inverse_distance(x, y))
            };
            self.lit(frame, base, emissive, normal, point)
        });
        if let Some((per_m, _)) = frame.fade {
            // w = 1/q, and the distance is w times the ray's length.
            let [rx, ry] = frame.camera.ray(x, y);
            let distance = (rx * rx + ry * ry + 1.0).sqrt() / self.inverse_distance(x, y);
            let seen = libm::exp(-per_m * distance) as f32;
            for (c, fog) in colour.iter_mut().zip(frame.fog) {
                *c = *c * seen + fog * (1.0 - seen);
            }
        }
        colour
    }

    /// 1/w at a sub-pixel position on the face; a place beyond its plane's horizon, where rounding may put one, is farther than everything.
    #[inline]
    fn inverse_distance(&self, x: i32, y: i32) -> f64 {
        let q = self.plane.at(x, y);
        if q > FARTHEST { q } else { FARTHEST }
    }

    /// c = base · (ambient + Σ light · max(0, n · d)) + emissive; unlit: c = base. `point` is the place relative to the view's
    /// eye, world axes; of no meaning where light is the same everywhere.
    pub(super) fn lit(
        &self,
        frame: &Frame<'_>,
        base: [f32; 4],
        emissive: [f32; 3],
        normal: DVec3,
        point: DVec3,
    ) -> [f32; 4] {
        let mut colour = base;
        if !self.unlit {
            let environment = frame.environment;
            let slope = normal.dot(environment.sun_direction) as f32;
            let light = environment.ambient + environment.sun * if slope > 0.0 { slope } else { 0.0 };
            let mut light = [light; 3];
            for other in frame.lights {
                let more = other.on(point, normal);
                light = each3([0, 1, 2], |c| light[c] + more[c] as f32);
            }
            for c in 0..3 {
                colour[c] = base[c] * light[c] + emissive[c];
            }
        }
        each4(colour, finite)
    }

    /// Alpha at a sub-pixel position, the base texture read at mip level `level`.
    pub(super) fn alpha(&self, frame: &Frame<'_>, x: i32, y: i32, level: f32) -> f32 {
        let place = self.place(x, y);
        let weights = place.weights();
        let alpha = self.base_at(weights)[3];
        let Some((texture, usage, uv)) = self.texture(frame, 0) else { return alpha };
        let [u, v] = mixed(uv, weights);
        alpha * texture.sample(usage, u, v, level)[3]
    }

    #[inline]
    fn place(&self, x: i32, y: i32) -> Place {
        // The edge opposite of corner k, exactly; at most 2⁵¹, hence exact in f64 as well.
        let numerator = |k: usize| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let (dx, dy) = (i64::from(self.x[j] - self.x[i]), i64::from(self.y[j] - self.y[i]));
            (dx * i64::from(y - self.y[i]) - dy * i64::from(x - self.x[i])) as f64
        };
        let parts = [numerator(0) * self.q[0], numerator(1) * self.q[1], numerator(2) * self.q[2]];
        Place { parts, sum: parts[0] + parts[1] + parts[2] }
    }

    #[inline]
    fn base_at(&self, weights: [f64; 3]) -> [f32; 4] {
        if !self.is_coloured {
            return self.base[0];
        }
        let w = each3(weights, |w| w as f32);
        each4([0, 1, 2, 3], |c| self.base[0][c] * w[0] + self.base[1][c] * w[1] + self.base[2][c] * w[2])
    }

    /// The mip level at which the base texture is read at a sub-pixel position.
    pub(super) fn base_level(&self, frame: &Frame<'_>, x: i32, y: i32) -> f32 {
        let Some((texture, _, uv)) = self.texture(frame, 0) else { return 0.0 };
        let place = self.place(x, y);
        let [du, dv] = self.slopes(0, &place, mixed(uv, place.weights()));
        detail(texture.size(), du, dv)
    }

    /// The base texture (0) or the emissive one (1), if there is one, and its coordinates at the corners.
    #[inline]
    fn texture<'a>(&self, frame: &Frame<'a>, which: usize) -> Option<(&'a MipTexture, &'a TextureUse, [[f64; 2]; 3])> {
        let item = &frame.items[self.item as usize];
        let material = &item.stored.mesh.material;
        let (texture, usage) = match which {
            0 => (item.base_texture, &material.base_texture),
            _ => (item.emissive_texture, &material.emissive_texture),
        };
        Some((texture?, usage.as_ref()?, self.uv[which]?))
    }

    /// What texture `which` shows on the face in a pixel, seen from a sub-pixel position on the face in it.
    fn averaged(
        &self,
        frame: &Frame<'_>,
        which: usize,
        place: &Place,
        weights: [f64; 3],
        [x, y]: [i32; 2],
        pixel: [i32; 2],
    ) -> [f32; 4] {
        let Some((texture, usage, uv)) = self.texture(frame, which) else { return [1.0; 4] };
        let at = mixed(uv, weights);
        let [du, dv] = self.slopes(which, place, at);
        let part = |sub: i32| f64::from(sub) * (1.0 / f64::from(SUBPIXELS));
        let footprint = Footprint { at, place: [part(x - pixel[0]), part(y - pixel[1])], du, dv };
        let covered = |counts: [u32; 2]| self.edges.cells(pixel[0], pixel[1], counts);
        let is_full = self.edges.covers_square(pixel[0], pixel[1], SUBPIXELS);
        texture.average(usage, &footprint, (!is_full).then_some(covered))
    }

    /// Change of u and of v per pixel, to the right and downwards, at a place with coordinates `at`: u = U/S with U and S affine
    /// on the screen, so du = (dU − u dS)/S.
    #[inline]
    fn slopes(&self, which: usize, place: &Place, at: [f64; 2]) -> [[f64; 2]; 2] {
        let scale = f64::from(SUBPIXELS) / place.sum;
        each2([0, 1], |axis| {
            each2([0, 1], |direction| {
                (self.uv_steps[which][axis][direction] - at[axis] * self.sum_steps[direction]) * scale
            })
        })
    }
}

/// The mean of the corners' coordinates with these weights.
#[inline]
fn mixed(uv: [[f64; 2]; 3], weights: [f64; 3]) -> [f64; 2] {
    each2([0, 1], |axis| uv[0][axis] * weights[0] + uv[1][axis] * weights[1] + uv[2][axis] * weights[2])
}

/// Change of a corner's part (see [`Place`]) per sub-pixel, to the right and downwards, for each corner.
fn part_steps(triangle: &Triangle) -> [[f64; 3]; 2] {
    let (x, y, q) = (triangle.x, triangle.y, triangle.corner_q());
    [
        std::array::from_fn(|k| f64::from(y[(k + 1) % 3] - y[(k + 2) % 3]) * q[k]),
        std::array::from_fn(|k| f64::from(x[(k + 2) % 3] - x[(k + 1) % 3]) * q[k]),
    ]
}

/// How a triangle's corners lie on its face.
enum Corners<'a> {
    Whole([usize; 3]),
    Piece(&'a [[f64; 3]; 3]),
}

impl<'a> Corners<'a> {
    fn of(frame: &Frame<'a>, number: u32) -> Self {
        match frame.clip(number) {
            None => Self::Whole(if frame.triangle(number).flags.has(Flags::SWAPPED) { [0, 2, 1] } else { [0, 1, 2] }),
            Some(record) => Self::Piece(&record.weights),
        }
    }

    /// The face's attribute at the triangle's corners.
    fn mix<const N: usize>(&self, of_face: [[f64; N]; 3]) -> [[f64; N]; 3] {
        match self {
            Self::Whole(order) => order.map(|k| of_face[k]),
            Self::Piece(weights) => weights
                .map(|w| std::array::from_fn(|c| of_face[0][c] * w[0] + of_face[1][c] * w[1] + of_face[2][c] * w[2])),
        }
    }
}

/// Unit normals of a face's vertices, world axes, towards its front. Vertices without one take the face's own.
fn vertex_normals(item: &Item<'_>, vertices: [usize; 3]) -> [DVec3; 3] {
    let mesh = &item.stored.mesh;
    let to_f64 = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let [a, b, c] = vertices.map(|v| to_f64(mesh.positions[v]));
    let flat = || unit(item.normals * unit((b - a).cross(c - a)));
    if mesh.normals.is_empty() {
        return [flat(); 3];
    }
    vertices.map(|v| {
        let normal = unit(item.normals * unit(to_f64(mesh.normals[v])));
        if normal == DVec3::ZERO { flat() } else { normal }
    })
}

/// Texture coordinates of a vertex, transformed; (0, 0) where the mesh doesn't have that set.
fn texcoord(mesh: &Mesh, usage: &TextureUse, vertex: usize) -> [f64; 2] {
    let [u, v] = mesh.texcoords.get(usage.set as usize).map_or([0.0; 2], |set| set[vertex]).map(f64::from);
    usage.transform.map(|row| f64::from(row[0]) * u + f64::from(row[1]) * v + f64::from(row[2]))
}

/// The unit vector of that direction; zero if there is none. Scaled first, so that neither tiny nor huge vectors are
/// lost in their squares.
fn unit(v: DVec3) -> DVec3 {
    let largest = v.abs().max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return DVec3::ZERO;
    }
    let scaled = v / largest;
    scaled / scaled.length()
}

/// Numbers in meshes may be huge; what they multiply to stays a number. NaN counts as 0.
#[inline]
fn finite(c: f32) -> f32 {
    if c.is_nan() { 0.0 } else { c.clamp(f32::MIN, f32::MAX) }
}
