//! Shading: the colour of a face in a pixel (picture.md, "One sample").
//!
//! Evaluated once per pixel and face, at the pixel's centre if the face covers it, else at its covered sample nearest the
//! centre. "Covers" is the face's own coverage, whatever hides it, and of a face that was cut at the near plane all
//! pieces together; so neighbouring boards and passes agree on the point.
//!
//! Attributes are interpolated perspectively: the barycentric numerators are edge functions of the rounded vertices, exact
//! integers, times the corners' inverse distances, divided by their sum. Texture gradients come from the same planes,
//! analytically, so that a pixel's footprint in a texture depends on nothing but the pixel and the face. What a face needs for this is
//! prepared once per tile and kept in a small cache.

use crate::geometry::camera::Camera;
use crate::geometry::setup::{ClipRecord, Flags, Triangle, WHOLE_FACE, area_twice};
use crate::geometry::transform::Item;
use crate::lights::Light;
use crate::raster::coverage::Edges;
use crate::resolve::background::fog;
use crate::samples::{Pattern, SUBPIXELS};
use crate::texture::{Footprint, MipTexture, detail};
use glam::DVec3;
use proto::frame::Environment;
use proto::scene::{Mesh, TextureUse};

/// −ln 0.02: at the range of visibility 98 % is faded (Koschmieder's limit).
const KOSCHMIEDER: f64 = 3.912_023_005_428_146;

/// Faces that the cache has room for; a power of two.
const CACHE_FACES: usize = 256;

/// No face is cached here.
const NOBODY: u32 = u32::MAX;

/// One frame's numbers for shading.
#[derive(Clone, Copy, Debug)]
pub struct Shader<'a> {
    /// The view's camera.
    pub camera: &'a Camera,
    /// The samples of a pixel.
    pub pattern: &'a Pattern,
    /// Light and air.
    pub environment: &'a Environment,
    /// The lights of the scene's file, if they are asked for.
    pub lights: &'a [Light],
    /// The frame's list.
    pub items: &'a [Item<'a>],
    /// The frame's triangles.
    pub triangles: &'a [Triangle],
    /// Records of the pieces of cut faces.
    pub clips: &'a [ClipRecord],
    fog: [f32; 3],
    /// k of the fade e^(−k d), 1/m, and V², m²; `None` in clear air.
    fade: Option<(f64, f64)>,
    /// Whether light is the same everywhere and depends on the normal alone.
    lit_alike: bool,
}

impl<'a> Shader<'a> {
    /// The numbers of a frame. The environment has been checked.
    pub fn new(
        camera: &'a Camera,
        pattern: &'a Pattern,
        environment: &'a Environment,
        lights: &'a [Light],
        items: &'a [Item<'a>],
        triangles: &'a [Triangle],
        clips: &'a [ClipRecord],
    ) -> Self {
        let fade = environment.visibility_m.map(|v| (KOSCHMIEDER / v, v * v));
        let lit_alike = lights.iter().all(Light::is_uniform);
        Self { camera, pattern, environment, lights, items, triangles, clips, fog: fog(environment), fade, lit_alike }
    }

    /// Linear RGB, faded, and alpha of a face in the pixel whose upper left is (x, y) sub. Always finite.
    #[inline]
    pub fn pixel_colour(&self, faces: &mut FaceCache, number: u32, x: i32, y: i32) -> [f32; 4] {
        let face = faces.of(self, number);
        if let (Some(colour), None) = (face.constant, self.fade) {
            return colour;
        }
        let point = self.shading_point(&face.edges, number, x, y);
        let face = faces.of(self, point.triangle);
        face.colour(self, point.x, point.y, [x, y])
    }

    /// Of the samples `mask` of a pixel, those at which the surface is within the range of visibility.
    pub fn within_visibility(&self, triangle: &Triangle, x: i32, y: i32, mask: u64) -> u64 {
        let Some((_, range_squared)) = self.fade else { return mask };
        let mut within = 0;
        let mut rest = mask;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [dx, dy] = self.pattern.points[i];
            let q = triangle.plane.at(x + dx, y + dy);
            let [rx, ry] = self.camera.ray(x + dx, y + dy);
            // d² = (rx² + ry² + 1) / q² ≤ V²; q is not positive at a horizon that a rounded outline reaches beyond.
            within |= u64::from(q > 0.0 && rx * rx + ry * ry + 1.0 <= range_squared * (q * q)) << i;
        }
        within
    }

    /// Of the samples `mask` of a pixel, those at which the alpha of a MASK surface is at least the cut-off.
    pub fn reaches_cutoff(&self, faces: &mut FaceCache, number: u32, cutoff: f32, x: i32, y: i32, mask: u64) -> u64 {
        if mask == 0 {
            return 0;
        }
        let face = faces.of(self, number);
        if let Some(colour) = face.constant {
            return if colour[3] >= cutoff { mask } else { 0 };
        }
        // One mip level for the whole pixel, that of the point where its colour is taken; a sample is worth its share of
        // the pixel, a power of two: 1/√n as wide.
        let point = self.shading_point(&face.edges, number, x, y);
        let level = faces.of(self, point.triangle).base_level(self, point.x, point.y);
        let level = level - 0.5 * self.pattern.count.trailing_zeros() as f32;
        let face = faces.of(self, number);
        let mut reached = 0;
        let mut rest = mask;
        while rest != 0 {
            let i = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let [dx, dy] = self.pattern.points[i];
            reached |= u64::from(face.alpha(self, x + dx, y + dy, level) >= cutoff) << i;
        }
        reached
    }

    /// Where the face that a triangle with these edges is, or is a piece of, is shaded in the pixel whose upper left is (x, y) sub.
    #[inline]
    fn shading_point(&self, edges: &Edges, number: u32, x: i32, y: i32) -> ShadingPoint {
        let centre = SUBPIXELS / 2;
        if edges.covers(x + centre, y + centre) {
            return ShadingPoint { triangle: number, x: x + centre, y: y + centre };
        }
        self.shading_point_off_centre(number, x, y)
    }

    /// The same where a triangle doesn't cover the pixel's centre: another piece may, or it is at a sample.
    fn shading_point_off_centre(&self, number: u32, x: i32, y: i32) -> ShadingPoint {
        let triangle = &self.triangles[number as usize];
        let centre = SUBPIXELS / 2;
        let pieces = if triangle.clip == WHOLE_FACE {
            number..number + 1
        } else {
            let record = &self.clips[triangle.clip as usize];
            let first = number - u32::from(record.before);
            first..first + u32::from(record.pieces)
        };
        let edges_of = |piece: u32| Edges::of(&self.triangles[piece as usize]);
        for piece in pieces.clone() {
            if edges_of(piece).covers(x + centre, y + centre) {
                return ShadingPoint { triangle: piece, x: x + centre, y: y + centre };
            }
        }
        let points =
            self.pattern.by_distance[..self.pattern.count].iter().map(|i| self.pattern.points[usize::from(*i)]);
        for [dx, dy] in points {
            for piece in pieces.clone() {
                if edges_of(piece).covers(x + dx, y + dy) {
                    return ShadingPoint { triangle: piece, x: x + dx, y: y + dy };
                }
            }
        }
        unreachable!("a face is shaded only in pixels where it covers a sample")
    }
}

/// Where, and as which triangle, a face is shaded in a pixel.
#[derive(Clone, Copy, Debug)]
struct ShadingPoint {
    triangle: u32,
    x: i32,
    y: i32,
}

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
    fn of(&mut self, shader: &Shader<'_>, number: u32) -> &Face {
        let place = number as usize % CACHE_FACES;
        if self.numbers[place] != number {
            self.faces[place] = Face::new(shader, number);
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
struct Face {
    x: [i32; 3],
    y: [i32; 3],
    q: [f64; 3],
    edges: Edges,
    /// Twice the area, sub².
    area: f64,
    /// Index into the frame's list.
    item: u32,
    /// Linear RGBA where there is nothing to interpolate: the colour everywhere on the face, before fading.
    constant: Option<[f32; 4]>,
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
        self.parts.map(|p| p * scale)
    }
}

impl Face {
    fn new(shader: &Shader<'_>, number: u32) -> Self {
        let triangle = &shader.triangles[number as usize];
        let item = &shader.items[triangle.item as usize];
        let mesh = &item.stored.mesh;
        let material = &mesh.material;
        let vertices = mesh.triangles[triangle.face as usize].map(|v| v as usize);
        let corners = Corners::of(shader, triangle);

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
            q: triangle.q,
            edges: Edges::of(triangle),
            area: area_twice_of(triangle),
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
        let is_lit_alike = face.unlit || shader.lit_alike;
        if is_lit_alike && !face.is_smooth && !face.is_coloured && face.uv.iter().all(Option::is_none) {
            face.constant = Some(face.lit(shader, base[0], face.emissive, normals[0], DVec3::ZERO));
        }
        face
    }

    /// Linear RGB, faded, and alpha at a sub-pixel position on the face, textures averaged over the pixel whose upper
    /// left is `pixel`.
    fn colour(&self, shader: &Shader<'_>, x: i32, y: i32, pixel: [i32; 2]) -> [f32; 4] {
        let place = self.place(x, y);
        let mut colour = self.constant.unwrap_or_else(|| {
            let weights = place.weights();
            let mut base = self.base_at(weights);
            let mut emissive = self.emissive;
            if self.uv[0].is_some() {
                let texel = self.averaged(shader, 0, &place, weights, [x, y], pixel);
                base = std::array::from_fn(|c| base[c] * texel[c]);
            }
            if self.uv[1].is_some() {
                let texel = self.averaged(shader, 1, &place, weights, [x, y], pixel);
                emissive = std::array::from_fn(|c| emissive[c] * texel[c]);
            }
            let normal = if self.is_smooth {
                let [a, b, c] = self.normals;
                unit(a * weights[0] + b * weights[1] + c * weights[2])
            } else {
                self.normals[0]
            };
            let point = if shader.lights.is_empty() {
                DVec3::ZERO
            } else {
                let [rx, ry] = shader.camera.ray(x, y);
                shader.camera.world_axes(DVec3::new(rx, ry, -1.0) * (self.area / place.sum))
            };
            self.lit(shader, base, emissive, normal, point)
        });
        if let Some((per_m, _)) = shader.fade {
            // w = 1/q, and the distance is w times the ray's length.
            let [rx, ry] = shader.camera.ray(x, y);
            let distance = self.area / place.sum * (rx * rx + ry * ry + 1.0).sqrt();
            let seen = libm::exp(-per_m * distance) as f32;
            for (c, fog) in colour.iter_mut().zip(shader.fog) {
                *c = *c * seen + fog * (1.0 - seen);
            }
        }
        colour
    }

    /// c = base · (ambient + Σ light · max(0, n · d)) + emissive; unlit: c = base. `point` is the place relative to the view's
    /// eye, world axes; of no meaning where light is the same everywhere.
    fn lit(&self, shader: &Shader<'_>, base: [f32; 4], emissive: [f32; 3], normal: DVec3, point: DVec3) -> [f32; 4] {
        let mut colour = base;
        if !self.unlit {
            let environment = shader.environment;
            let slope = normal.dot(environment.sun_direction) as f32;
            let light = environment.ambient + environment.sun * if slope > 0.0 { slope } else { 0.0 };
            let mut light = [light; 3];
            for other in shader.lights {
                let more = other.on(point, normal);
                light = std::array::from_fn(|c| light[c] + more[c] as f32);
            }
            for c in 0..3 {
                colour[c] = base[c] * light[c] + emissive[c];
            }
        }
        colour.map(finite)
    }

    /// Alpha at a sub-pixel position, the base texture read at mip level `level`.
    fn alpha(&self, shader: &Shader<'_>, x: i32, y: i32, level: f32) -> f32 {
        let place = self.place(x, y);
        let weights = place.weights();
        let alpha = self.base_at(weights)[3];
        let Some((texture, usage, uv)) = self.texture(shader, 0) else { return alpha };
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
        let w = weights.map(|w| w as f32);
        std::array::from_fn(|c| self.base[0][c] * w[0] + self.base[1][c] * w[1] + self.base[2][c] * w[2])
    }

    /// The mip level at which the base texture is read at a sub-pixel position.
    fn base_level(&self, shader: &Shader<'_>, x: i32, y: i32) -> f32 {
        let Some((texture, _, uv)) = self.texture(shader, 0) else { return 0.0 };
        let place = self.place(x, y);
        let [du, dv] = self.slopes(0, &place, mixed(uv, place.weights()));
        detail(texture.size(), du, dv)
    }

    /// The base texture (0) or the emissive one (1), if there is one, and its coordinates at the corners.
    #[inline]
    fn texture<'a>(
        &self,
        shader: &Shader<'a>,
        which: usize,
    ) -> Option<(&'a MipTexture, &'a TextureUse, [[f64; 2]; 3])> {
        let item = &shader.items[self.item as usize];
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
        shader: &Shader<'_>,
        which: usize,
        place: &Place,
        weights: [f64; 3],
        [x, y]: [i32; 2],
        pixel: [i32; 2],
    ) -> [f32; 4] {
        let Some((texture, usage, uv)) = self.texture(shader, which) else { return [1.0; 4] };
        let at = mixed(uv, weights);
        let [du, dv] = self.slopes(which, place, at);
        let part = |sub: i32| f64::from(sub) * (1.0 / f64::from(SUBPIXELS));
        let footprint = Footprint { at, place: [part(x - pixel[0]), part(y - pixel[1])], du, dv };
        let half = SUBPIXELS as u32 / 2;
        let covered = |column: u32, columns: u32, row: u32, rows: u32| {
            // The middle of a cell, in whole sub-pixels.
            let [dx, dy] = [(2 * column + 1) * half / columns, (2 * row + 1) * half / rows];
            self.edges.covers(pixel[0] + dx as i32, pixel[1] + dy as i32)
        };
        let corners = [[0, 0], [SUBPIXELS, 0], [0, SUBPIXELS], [SUBPIXELS, SUBPIXELS]];
        let is_full = corners.iter().all(|[dx, dy]| self.edges.covers(pixel[0] + dx, pixel[1] + dy));
        texture.average(usage, &footprint, (!is_full).then_some(covered))
    }

    /// Change of u and of v per pixel, to the right and downwards, at a place with coordinates `at`: u = U/S with U and S affine
    /// on the screen, so du = (dU − u dS)/S.
    #[inline]
    fn slopes(&self, which: usize, place: &Place, at: [f64; 2]) -> [[f64; 2]; 2] {
        let scale = f64::from(SUBPIXELS) / place.sum;
        [0, 1].map(|axis| {
            [0, 1]
                .map(|direction| (self.uv_steps[which][axis][direction] - at[axis] * self.sum_steps[direction]) * scale)
        })
    }
}

/// The mean of the corners' coordinates with these weights.
#[inline]
fn mixed(uv: [[f64; 2]; 3], weights: [f64; 3]) -> [f64; 2] {
    [0, 1].map(|axis| uv[0][axis] * weights[0] + uv[1][axis] * weights[1] + uv[2][axis] * weights[2])
}

/// Change of a corner's part (see [`Place`]) per sub-pixel, to the right and downwards, for each corner.
fn part_steps(triangle: &Triangle) -> [[f64; 3]; 2] {
    let (x, y, q) = (triangle.x, triangle.y, triangle.q);
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
    fn of(shader: &Shader<'a>, triangle: &Triangle) -> Self {
        if triangle.clip == WHOLE_FACE {
            Self::Whole(if triangle.flags.has(Flags::SWAPPED) { [0, 2, 1] } else { [0, 1, 2] })
        } else {
            Self::Piece(&shader.clips[triangle.clip as usize].weights)
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

fn area_twice_of(t: &Triangle) -> f64 {
    area_twice([t.x[0], t.y[0]], [t.x[1], t.y[1]], [t.x[2], t.y[2]]) as f64
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
