//! Where faces land: every face of a world as triangles on a view's screen.
//!
//! A face is moved to the view's frame in f64 and cut where it crosses the near plane; what is left is fanned out into
//! *pieces*, triangles on the screen that remember their place in the face. Screen vertices are the true projection or
//! that projection rounded to a grid; in the latter case coverage, depth and attributes are those of the rounded
//! vertices, as picture.md has it ("One sample"), but for the depth of faces that have it from a plane of the scene
//! ([`crate::depth`]).
//!
//! Neighbours that are cut must agree on the new vertex, so it is computed from the edge's inner end to its outer end,
//! whichever way round the face runs.
//!
//! Choices: rounding is to the nearest, halves upwards. A piece is seen from its front or from behind by the winding
//! of what is on the screen (rounded, if vertices are). An object that a transformation mirrors runs the other way
//! round.

use crate::camera::Camera;
use crate::coverage::side;
use crate::depth::InverseDepth;
use crate::plane::FacePlane;
use crate::world::World;
use glam::{DMat3, DVec3};
use proto::frame::FrameState;
use proto::scene::Material;
use proto::view::View;

/// Where the vertices of faces are on the screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vertices {
    /// Where they really are.
    Exact,
    /// On the nearest point of a grid.
    Rounded(Grid),
}

/// A grid of screen positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// 2^bits positions per pixel.
    pub bits: u32,
    /// Faces that reach beyond that many pixels from the view's upper left are cut there before they are rounded;
    /// `None`: they aren't. The page knows no such limit: it is the range of the pipeline's integers, and where it
    /// cuts an edge the rounded edge runs up to half a grid step beside where it would without.
    pub limit_pixels: Option<f64>,
}

impl Grid {
    /// The pipeline's: 1/256 pixel, coordinates of 25 bits with their sign.
    pub const PIPELINE: Self = Self { bits: 8, limit_pixels: Some(16_777_215.0 / 256.0) };
}

/// A face that is at least partly on the screen.
#[derive(Clone, Copy, Debug)]
pub struct Face {
    /// Index of its instance.
    pub instance: u32,
    /// Index of its triangle in the mesh.
    pub triangle: u32,
    /// What is in front where depths are equal: larger is. (Layer, primitive, number of the face in it.)
    pub rank: (i32, u32, u32),
    /// Its plane.
    pub plane: FacePlane,
    /// Index of its material among those of [`Screen::materials`].
    pub material: u32,
}

/// A triangle on the screen: a face, or a part of one that was cut.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    /// Index into [`Screen::faces`].
    pub face: u32,
    /// Corners, pixels; clockwise as seen, y being downwards.
    pub corners: [[f64; 2]; 3],
    /// 1/−Z over the screen.
    pub depth: InverseDepth,
    /// 1/−Z at the corners, for the weights. Positive: a rounded corner beyond the horizon of its face's plane is all
    /// but infinitely far.
    pub inverse: [f64; 3],
    /// Each corner's weights of the face's three vertices.
    pub weights: [[f64; 3]; 3],
    /// Seen from behind.
    pub is_behind: bool,
}

impl Piece {
    /// 1/−Z at a point of the screen, also beyond the corners.
    pub fn inverse_depth(&self, point: [f64; 2]) -> f64 {
        self.depth.at(point)
    }

    /// The weights of the face's three vertices at a point of the screen, perspectively correct.
    pub fn weights_at(&self, point: [f64; 2]) -> [f64; 3] {
        let [a, b, c] = self.corners;
        let areas = [side(b, c, point), side(c, a, point), side(a, b, point)];
        let shares: [f64; 3] = std::array::from_fn(|k| areas[k] * self.inverse[k]);
        let sum: f64 = shares.iter().sum();
        std::array::from_fn(|v| (0..3).map(|k| shares[k] * self.weights[k][v]).sum::<f64>() / sum)
    }

    /// Smallest and largest coordinate along an axis, pixels.
    pub fn extent(&self, axis: usize) -> [f64; 2] {
        let c = self.corners.map(|corner| corner[axis]);
        [c[0].min(c[1]).min(c[2]), c[0].max(c[1]).max(c[2])]
    }
}

/// 1/−Z that is as good as none, 1/m, and still can be multiplied and divided by.
const FARTHEST: f64 = 1e-200;

/// All faces of a world on the screen of a view.
#[derive(Clone, Debug)]
pub struct Screen<'a> {
    /// What is drawn.
    pub world: &'a World<'a>,
    /// The frame.
    pub state: FrameState,
    /// The view's camera.
    pub camera: Camera,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// In the order of the file.
    pub faces: Vec<Face>,
    /// In the order of their faces.
    pub pieces: Vec<Piece>,
    /// Different materials.
    pub materials: Vec<Material>,
    /// For each instance: normals from mesh space to world, lengths meaning nothing.
    pub normals: Vec<DMat3>,
}

/// A vertex of a face that is being cut.
#[derive(Clone, Copy)]
struct Corner {
    point: DVec3,
    weights: [f64; 3],
}

impl<'a> Screen<'a> {
    /// Projects everything.
    pub fn new(world: &'a World<'a>, state: &FrameState, view: &View, vertices: Vertices) -> Self {
        let mut screen = Self {
            world,
            state: *state,
            camera: Camera::new(state, view),
            width: view.width,
            height: view.height,
            faces: Vec::new(),
            pieces: Vec::new(),
            materials: Vec::new(),
            normals: Vec::new(),
        };
        let camera = screen.camera;
        let planes: Vec<_> =
            world.planes.iter().map(|plane| InverseDepth::of_scene_plane(&camera, plane, vertices)).collect();
        for instance in 0..world.instances.len() {
            screen.add(instance, &planes, vertices);
        }
        screen
    }

    /// Adds an instance's faces, `planes` being what there is of the world's planes.
    fn add(&mut self, number: usize, planes: &[Option<InverseDepth>], vertices: Vertices) {
        let instance = &self.world.instances[number];
        let mesh = instance.mesh;
        let linear = instance.transform.matrix3;
        let mirrored = linear.determinant() < 0.0;
        self.normals.push(normal_matrix(linear));
        let material = self.materials.iter().position(|known| *known == mesh.material).unwrap_or_else(|| {
            self.materials.push(mesh.material);
            self.materials.len() - 1
        });
        let placed: Vec<DVec3> =
            (0..mesh.positions.len()).map(|i| self.camera.view_point(&instance.transform, mesh.position(i))).collect();
        for (triangle, corners) in mesh.triangles.iter().enumerate() {
            let points = corners.map(|c| placed[c as usize]);
            if !points.iter().all(|p| p.is_finite()) {
                continue;
            }
            let pieces = self.pieces.len();
            let face = self.faces.len() as u32;
            let shared = instance.planes.get(triangle).copied().flatten().and_then(|plane| planes[plane as usize]);
            self.cut_and_project(face, points, mirrored, mesh.material.double_sided, shared, vertices);
            if self.pieces.len() > pieces {
                self.faces.push(Face {
                    instance: number as u32,
                    triangle: triangle as u32,
                    rank: (instance.layer, instance.primitive, mesh.face_numbers[triangle]),
                    plane: FacePlane::new(points, instance.reach(triangle)),
                    material: material as u32,
                });
            }
        }
    }

    fn cut_and_project(
        &mut self,
        face: u32,
        points: [DVec3; 3],
        mirrored: bool,
        double_sided: bool,
        shared: Option<InverseDepth>,
        vertices: Vertices,
    ) {
        let near = self.camera.near;
        let unit = |k: usize| std::array::from_fn(|v| f64::from(u8::from(v == k)));
        let mut polygon: Vec<Corner> = (0..3).map(|k| Corner { point: points[k], weights: unit(k) }).collect();
        polygon = cut(&polygon, |p| -p.z - near, Some(near));
        if let Vertices::Rounded(Grid { limit_pixels: Some(limit), .. }) = vertices {
            let band = self.camera.band(limit);
            polygon = cut(&polygon, |p| p.x - band.left * -p.z, None);
            polygon = cut(&polygon, |p| band.right * -p.z - p.x, None);
            polygon = cut(&polygon, |p| p.y - band.bottom * -p.z, None);
            polygon = cut(&polygon, |p| band.top * -p.z - p.y, None);
        }
        if polygon.len() < 3 {
            return;
        }
        let seen: Vec<[f64; 2]> = polygon.iter().map(|c| place(self.camera.project(c.point), vertices)).collect();
        for k in 1..polygon.len() - 1 {
            // A counter-clockwise face, seen from its front, runs clockwise the wrong way round: y is downwards here.
            let area = side(seen[0], seen[k], seen[k + 1]);
            let is_behind = (area < 0.0) == mirrored;
            if area == 0.0 || area.is_nan() || (is_behind && !double_sided) {
                continue;
            }
            let order = if area > 0.0 { [0, k, k + 1] } else { [0, k + 1, k] };
            let corners = order.map(|i| seen[i]);
            let own = order.map(|i| -1.0 / polygon[i].point.z);
            let (depth, inverse) = match (shared, vertices) {
                (Some(shared), _) => (shared, corners.map(|corner| shared.at(corner).max(FARTHEST))),
                (None, Vertices::Exact) => (self.true_depth(points).through(corners[0], own[0]), own),
                (None, Vertices::Rounded(_)) => (InverseDepth::through_corners(corners, own), own),
            };
            if depth.is_finite() {
                let weights = order.map(|i| polygon[i].weights);
                self.pieces.push(Piece { face, corners, depth, inverse, weights, is_behind });
            }
        }
    }

    /// 1/−Z on the plane through three points of the view's frame.
    fn true_depth(&self, [a, b, c]: [DVec3; 3]) -> InverseDepth {
        InverseDepth::of_plane(&self.camera, (b - a).cross(c - a), a)
    }

    /// The pieces that reach the view, by the rows of pixels that they reach, each in the order of the file.
    pub fn pieces_by_row(&self, margin: f64) -> Vec<Vec<u32>> {
        let mut rows = vec![Vec::new(); self.height as usize];
        for (index, piece) in self.pieces.iter().enumerate() {
            let [top, bottom] = piece.extent(1);
            let [left, right] = piece.extent(0);
            if right < -margin || left > f64::from(self.width) + margin {
                continue;
            }
            let first = (top - margin).floor().clamp(0.0, f64::from(self.height)) as usize;
            let end = ((bottom + margin).floor() + 1.0).clamp(0.0, f64::from(self.height)) as usize;
            for row in rows.get_mut(first..end).unwrap_or_default() {
                row.push(index as u32);
            }
        }
        rows
    }
}

/// The matrix of cofactors: the inverse transpose, up to a positive factor, that also a flattened object has.
fn normal_matrix(linear: DMat3) -> DMat3 {
    let (x, y, z) = (linear.x_axis, linear.y_axis, linear.z_axis);
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(y.cross(z) * sign, z.cross(x) * sign, x.cross(y) * sign)
}

fn place(screen: [f64; 2], vertices: Vertices) -> [f64; 2] {
    match vertices {
        Vertices::Exact => screen,
        Vertices::Rounded(Grid { bits, .. }) => {
            let steps = f64::from(bits).exp2();
            screen.map(|c| (c * steps + 0.5).floor() / steps)
        }
    }
}

/// The part of a polygon where `inside` is not negative. New vertices lie at the depth `flat`, if there is one.
fn cut(polygon: &[Corner], inside: impl Fn(DVec3) -> f64, flat: Option<f64>) -> Vec<Corner> {
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (i, here) in polygon.iter().enumerate() {
        let next = &polygon[(i + 1) % polygon.len()];
        let (at_here, at_next) = (inside(here.point), inside(next.point));
        if at_here >= 0.0 {
            kept.push(*here);
        }
        if (at_here >= 0.0) != (at_next >= 0.0) {
            let (inner, outer, from, to) =
                if at_here >= 0.0 { (here, next, at_here, at_next) } else { (next, here, at_next, at_here) };
            let part = from / (from - to);
            let mut point = inner.point + (outer.point - inner.point) * part;
            if let Some(depth) = flat {
                point.z = -depth;
            }
            let weights = std::array::from_fn(|k| inner.weights[k] + (outer.weights[k] - inner.weights[k]) * part);
            kept.push(Corner { point, weights });
        }
    }
    kept
}
