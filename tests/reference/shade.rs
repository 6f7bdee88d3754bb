//! The colour of a face at a place, of the air before it, and of the sky behind everything: picture.md, "Shade",
//! "Visibility", "Background".
//!
//! Choices: vertex normals are brought to world axes and made unit ones there before they are interpolated, as vertex
//! shaders do; the page doesn't say in which space (it matters where an object's scale isn't the same along all
//! axes). Where interpolation leaves no direction, the face's own normal counts. A vertex colour's alpha counts like
//! its colour. Products of alpha are clamped to 0..=1. The fog's colour under a sky is the horizon's. The scene's
//! lights attenuate as `KHR_lights_punctual` recommends, a lux or candela per square metre counting as 1 in the
//! formula.

use crate::screen::{Piece, Screen};
use crate::texture::{Coordinates, Filtering, read};
use glam::{DVec3, DVec4};
use proto::frame::{Background, Environment};
use proto::scene::{Alpha, Filter, LightKind, LightRow, Mesh, TextureUse};

/// Horizon and zenith of the default sky, linear.
const HORIZON: [f64; 3] = [0.60, 0.70, 0.80];
const ZENITH: [f64; 3] = [0.15, 0.30, 0.60];

/// What a face looks like in a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaded {
    /// Linear RGB, faded.
    pub color: [f64; 3],
    /// Saturation; 1 for an opaque face.
    pub alpha: f64,
    /// Texels per pixel of the texture that is reduced the most; 0 without one.
    pub texels_per_pixel: f64,
}

/// A place on the screen and the piece of a face that is there.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// The piece.
    pub piece: &'a Piece,
    /// Pixels.
    pub point: [f64; 2],
}

impl Screen<'_> {
    /// The colour of a face at a place. `covered` gives, for a number of places per side, those of the pixel that the
    /// face covers: where its textures are averaged.
    pub fn shade<'p>(&self, at: Place<'p>, filtering: Filtering, covered: &dyn Fn(usize) -> Vec<Place<'p>>) -> Shaded {
        let face = &self.faces[at.piece.face as usize];
        let mesh = self.world.instances[face.instance as usize].mesh;
        let material = &mesh.material;
        let corners = mesh.triangles[face.triangle as usize];
        let weights = at.piece.weights_at(at.point);

        let mut texels_per_pixel = 0.0f64;
        let mut averaged = |used: &Option<TextureUse>| {
            used.as_ref().map_or([1.0; 4], |used| {
                let (color, rate) = self.texture(mesh, used, corners, at, filtering, covered);
                texels_per_pixel = texels_per_pixel.max(rate);
                color
            })
        };
        let texture = averaged(&material.base_texture);
        let glow = if material.unlit { [0.0; 4] } else { averaged(&material.emissive_texture) };
        let vertex = vertex_color(mesh, corners, weights);
        let base: [f64; 4] = std::array::from_fn(|k| f64::from(material.base_color[k]) * vertex[k] * texture[k]);
        let alpha = if matches!(material.alpha, Alpha::Blend) { base[3].clamp(0.0, 1.0) } else { 1.0 };

        let lit = if material.unlit {
            [base[0], base[1], base[2]]
        } else {
            let light = self.light(at.piece, weights);
            std::array::from_fn(|k| base[k] * light[k] + f64::from(material.emissive[k]) * glow[k])
        };
        let color = fade(&self.state.environment, lit, self.distance(at));
        Shaded { color, alpha, texels_per_pixel }
    }

    /// Euclidean distance from the eye, m; infinite at the horizon of a plane and beyond.
    pub fn distance(&self, at: Place<'_>) -> f64 {
        let inverse = at.piece.inverse_depth(at.point);
        if inverse > 0.0 { self.camera.slant(at.point) / inverse } else { f64::INFINITY }
    }

    /// The product of factor, vertex colour and texture in alpha at one place; what a cut-off is compared with.
    pub fn alpha_at(&self, at: Place<'_>) -> f64 {
        let face = &self.faces[at.piece.face as usize];
        let mesh = self.world.instances[face.instance as usize].mesh;
        let corners = mesh.triangles[face.triangle as usize];
        let weights = at.piece.weights_at(at.point);
        let texture = mesh.material.base_texture.map_or(1.0, |used| {
            let coordinates = Coordinates::new(mesh, &used, corners);
            let filter =
                if texels_per_pixel(self, at, &coordinates, &used) > 1.0 { Filter::Linear } else { used.magnify };
            read(self.world.textures[&used.texture], &used, coordinates.at(weights), filter)[3]
        });
        f64::from(mesh.material.base_color[3]) * vertex_color(mesh, corners, weights)[3] * texture
    }

    /// The cut-off of a face, if it has one.
    pub fn cutoff(&self, face: u32) -> Option<f64> {
        match self.materials[self.faces[face as usize].material as usize].alpha {
            Alpha::Mask { cutoff } => Some(f64::from(cutoff)),
            Alpha::Opaque | Alpha::Blend => None,
        }
    }

    /// Whether a face is translucent, whatever its saturation.
    pub fn is_translucent(&self, face: u32) -> bool {
        matches!(self.materials[self.faces[face as usize].material as usize].alpha, Alpha::Blend)
    }

    /// `ambient + Σ_l light_l · max(0, n·d_l)`
    fn light(&self, piece: &Piece, weights: [f64; 3]) -> [f64; 3] {
        let environment = &self.state.environment;
        let normal = self.normal(piece, weights);
        let sun = f64::from(environment.sun) * normal.dot(environment.sun_direction).max(0.0);
        let mut sum = [f64::from(environment.ambient) + sun; 3];
        if environment.scene_lights {
            let face = &self.faces[piece.face as usize];
            let instance = &self.world.instances[face.instance as usize];
            let corners = instance.mesh.triangles[face.triangle as usize];
            let place = corners.iter().zip(weights).map(|(c, weight)| instance.mesh.position(*c as usize) * weight);
            let place = instance.transform.transform_point3(place.sum());
            for light in &self.world.lights {
                let (toward, strength) = arriving(light, place);
                let part = strength * normal.dot(toward).max(0.0);
                for (sum, intensity) in sum.iter_mut().zip(light.intensity) {
                    *sum += f64::from(intensity) * part;
                }
            }
        }
        sum
    }

    /// The unit normal, world axes, on the side that is seen.
    fn normal(&self, piece: &Piece, weights: [f64; 3]) -> DVec3 {
        let face = &self.faces[piece.face as usize];
        let instance = &self.world.instances[face.instance as usize];
        let mesh = instance.mesh;
        let corners = mesh.triangles[face.triangle as usize].map(|c| c as usize);
        let [a, b, c] = corners.map(|corner| mesh.position(corner));
        let to_world =
            |normal: DVec3| (self.normals[face.instance as usize] * normal.normalize_or_zero()).try_normalize();
        let own = to_world((b - a).cross(c - a)).unwrap_or(DVec3::ZERO);
        let vertex_normal = |corner: usize| {
            let given = mesh.normals.get(corner).map(|n| DVec3::from_array(n.map(f64::from)));
            given.and_then(to_world).unwrap_or(own)
        };
        let mixed: DVec3 = corners.iter().zip(weights).map(|(corner, weight)| vertex_normal(*corner) * weight).sum();
        let normal = mixed.try_normalize().unwrap_or(own);
        if piece.is_behind { -normal } else { normal }
    }

    /// A texture's colour in a pixel, and how many texels of it a pixel is wide.
    fn texture<'p>(
        &self,
        mesh: &Mesh,
        used: &TextureUse,
        corners: [u32; 3],
        at: Place<'p>,
        filtering: Filtering,
        covered: &dyn Fn(usize) -> Vec<Place<'p>>,
    ) -> ([f64; 4], f64) {
        let texture = self.world.textures[&used.texture];
        let coordinates = Coordinates::new(mesh, used, corners);
        let rate = texels_per_pixel(self, at, &coordinates, used);
        let filter = if rate > 1.0 { Filter::Linear } else { used.magnify };
        let one = |place: Place<'_>| {
            let coordinate = coordinates.at(place.piece.weights_at(place.point));
            DVec4::from_array(read(texture, used, coordinate, filter))
        };
        let side = filtering.side(rate);
        let places = if side == 1 { Vec::new() } else { covered(side) };
        let color = if places.is_empty() {
            one(at)
        } else {
            places.iter().map(|place| one(*place)).sum::<DVec4>() / places.len() as f64
        };
        (color.to_array(), rate)
    }

    /// What is behind everything at a point of the screen.
    pub fn background(&self, point: [f64; 2]) -> [f64; 3] {
        match self.state.environment.background {
            Background::Constant(color) => color.map(f64::from),
            Background::Sky => {
                let elevation = self.camera.direction_world(point).y.clamp(-1.0, 1.0).asin().to_degrees();
                let part = (elevation / 30.0).clamp(0.0, 1.0);
                std::array::from_fn(|k| HORIZON[k] + (ZENITH[k] - HORIZON[k]) * part)
            }
        }
    }
}

/// The longer of the ways that the texture coordinate goes, texels, when the screen position goes a pixel right or
/// down.
fn texels_per_pixel(screen: &Screen<'_>, at: Place<'_>, coordinates: &Coordinates, used: &TextureUse) -> f64 {
    let texture = screen.world.textures[&used.texture];
    let size = glam::DVec2::new(f64::from(texture.width), f64::from(texture.height));
    // A small step, so that it doesn't reach beyond a horizon.
    const STEP: f64 = 1e-3;
    let [x, y] = at.point;
    let here = coordinates.at(at.piece.weights_at(at.point));
    let way = |point| ((coordinates.at(at.piece.weights_at(point)) - here) * size).length() / STEP;
    way([x + STEP, y]).max(way([x, y + STEP]))
}

/// From where, and how much weakened, a light arrives at a place: `KHR_lights_punctual`, "Range Property" and "Inner
/// and Outer Cone Angles".
fn arriving(light: &LightRow, place: DVec3) -> (DVec3, f64) {
    let from = light.position - place;
    let window = |range: Option<f64>| {
        let weakened = range.map_or(1.0, |range| (1.0 - (from.length() / range).powi(4)).clamp(0.0, 1.0));
        weakened / from.length_squared().max(f64::MIN_POSITIVE)
    };
    let toward = from.normalize_or_zero();
    match light.kind {
        LightKind::Directional => (-light.direction, 1.0),
        LightKind::Point { range } => (toward, window(range)),
        LightKind::Spot { range, inner_cos, outer_cos } => {
            let scale = 1.0 / (f64::from(inner_cos) - f64::from(outer_cos)).max(0.001);
            let cosine = light.direction.dot(-toward);
            let cone = ((cosine - f64::from(outer_cos)) * scale).clamp(0.0, 1.0);
            (toward, window(range) * cone * cone)
        }
    }
}

fn vertex_color(mesh: &Mesh, corners: [u32; 3], weights: [f64; 3]) -> [f64; 4] {
    if mesh.colors.is_empty() {
        return [1.0; 4];
    }
    let colors = corners.map(|corner| mesh.colors[corner as usize].map(f64::from));
    std::array::from_fn(|k| (0..3).map(|v| colors[v][k] * weights[v]).sum())
}

/// What is left of a colour at a distance: c·e^(−k d) + fog·(1 − e^(−k d)), k = −ln 0.02 / V.
fn fade(environment: &Environment, color: [f64; 3], distance: f64) -> [f64; 3] {
    let Some(visibility) = environment.visibility_m else { return color };
    let fog = match (environment.fog, environment.background) {
        (Some(fog), _) | (None, Background::Constant(fog)) => fog.map(f64::from),
        (None, Background::Sky) => HORIZON,
    };
    let left = (0.02f64.ln() / visibility * distance).exp();
    std::array::from_fn(|k| color[k] * left + fog[k] * (1.0 - left))
}
