//! The mesh builder's toolbox: plain shapes that are joined, moved and coloured into buildings, aircraft and hills.
//!
//! A [`Shape`] is a list of vertices and triangles, counter-clockwise in front, in f64 until it is written. Every
//! vertex has a normal, a colour (white unless painted) and texture coordinates (zero unless mapped). Angular things
//! get a vertex per face and corner; round things share vertices and have smooth normals.

use crate::scene::glb::Geometry;
use glam::{DAffine3, DVec2, DVec3, dvec2, dvec3};
use std::f64::consts::TAU;

/// Vertices and triangles under construction.
#[derive(Clone, Debug, Default)]
pub(crate) struct Shape {
    positions: Vec<DVec3>,
    normals: Vec<DVec3>,
    colors: Vec<DVec3>,
    texcoords: Vec<DVec2>,
    triangles: Vec<[u32; 3]>,
}

/// One corner of a shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vertex {
    pub(crate) position: DVec3,
    pub(crate) normal: DVec3,
    pub(crate) color: DVec3,
    pub(crate) texcoord: DVec2,
}

impl Vertex {
    pub(crate) fn new(position: DVec3, normal: DVec3) -> Self {
        Self { position, normal, color: DVec3::ONE, texcoord: DVec2::ZERO }
    }
}

/// Which horizontal faces a box has; the four walls are always there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Caps {
    None,
    Top,
    Both,
}

impl Shape {
    pub(crate) fn new() -> Self {
        Self::default()
    }

    pub(crate) fn join(shapes: impl IntoIterator<Item = Self>) -> Self {
        let mut all = Self::new();
        for shape in shapes {
            all.add(shape);
        }
        all
    }

    pub(crate) fn add(&mut self, other: Self) {
        let base = self.positions.len() as u32;
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.colors.extend(other.colors);
        self.texcoords.extend(other.texcoords);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    pub(crate) fn vertex(&mut self, vertex: Vertex) -> u32 {
        self.positions.push(vertex.position);
        self.normals.push(vertex.normal);
        self.colors.push(vertex.color);
        self.texcoords.push(vertex.texcoord);
        (self.positions.len() - 1) as u32
    }

    pub(crate) fn triangle(&mut self, a: u32, b: u32, c: u32) {
        self.triangles.push([a, b, c]);
    }

    /// Adds a flat convex polygon with texture coordinates; its first three corners must not lie on a line.
    pub(crate) fn mapped_polygon(&mut self, corners: &[(DVec3, DVec2)]) {
        let normal = (corners[1].0 - corners[0].0).cross(corners[2].0 - corners[0].0).try_normalize();
        let normal = normal.expect("scenes are made of polygons that have an area at their first corner");
        let base = self.positions.len() as u32;
        for &(position, texcoord) in corners {
            self.vertex(Vertex { texcoord, ..Vertex::new(position, normal) });
        }
        for i in 1..corners.len() as u32 - 1 {
            self.triangle(base, base + i, base + i + 1);
        }
    }

    /// Adds a flat convex polygon.
    pub(crate) fn polygon(&mut self, corners: &[DVec3]) {
        let corners: Vec<_> = corners.iter().map(|&p| (p, DVec2::ZERO)).collect();
        self.mapped_polygon(&corners);
    }

    /// Flat faces from convex polygons.
    pub(crate) fn flat<const N: usize>(polygons: &[[DVec3; N]]) -> Self {
        let mut shape = Self::new();
        for polygon in polygons {
            shape.polygon(polygon);
        }
        shape
    }

    /// A horizontal rectangle facing up.
    pub(crate) fn rect(x: [f64; 2], z: [f64; 2], y: f64) -> Self {
        Self::flat(&[[dvec3(x[0], y, z[1]), dvec3(x[1], y, z[1]), dvec3(x[1], y, z[0]), dvec3(x[0], y, z[0])]])
    }

    /// A box. Its walls are mapped in metres: u along the wall from its left end, v down from the top.
    pub(crate) fn cuboid(x: [f64; 2], y: [f64; 2], z: [f64; 2], caps: Caps) -> Self {
        Self::prism(&[dvec2(x[0], z[1]), dvec2(x[1], z[1]), dvec2(x[1], z[0]), dvec2(x[0], z[0])], y, caps)
    }

    /// Walls over a convex outline of (x, z) points, counter-clockwise seen from above; mapped as [`Shape::cuboid`].
    pub(crate) fn prism(outline: &[DVec2], y: [f64; 2], caps: Caps) -> Self {
        let mut shape = Self::new();
        let up = |p: DVec2, y: f64| dvec3(p.x, y, p.y);
        for (i, &a) in outline.iter().enumerate() {
            let b = outline[(i + 1) % outline.len()];
            let (width, height) = (a.distance(b), y[1] - y[0]);
            shape.mapped_polygon(&[
                (up(a, y[0]), dvec2(0.0, height)),
                (up(b, y[0]), dvec2(width, height)),
                (up(b, y[1]), dvec2(width, 0.0)),
                (up(a, y[1]), DVec2::ZERO),
            ]);
        }
        if caps != Caps::None {
            shape.polygon(&outline.iter().map(|&p| up(p, y[1])).collect::<Vec<_>>());
        }
        if caps == Caps::Both {
            shape.polygon(&outline.iter().rev().map(|&p| up(p, y[0])).collect::<Vec<_>>());
        }
        shape
    }

    /// A pitched roof with its two gable ends, ridge along x. The slopes are mapped in metres: u along the ridge, v
    /// down.
    pub(crate) fn gable(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Self {
        let middle = (z[0] + z[1]) / 2.0;
        let slope = (dvec2(z[1] - middle, y[1] - y[0])).length();
        let mut shape = Self::new();
        for (eaves, ends) in [(z[1], x), (z[0], [x[1], x[0]])] {
            let width = x[1] - x[0];
            shape.mapped_polygon(&[
                (dvec3(ends[0], y[0], eaves), dvec2(0.0, slope)),
                (dvec3(ends[1], y[0], eaves), dvec2(width, slope)),
                (dvec3(ends[1], y[1], middle), dvec2(width, 0.0)),
                (dvec3(ends[0], y[1], middle), DVec2::ZERO),
            ]);
        }
        shape.polygon(&[dvec3(x[1], y[0], z[1]), dvec3(x[1], y[0], z[0]), dvec3(x[1], y[1], middle)]);
        shape.polygon(&[dvec3(x[0], y[0], z[0]), dvec3(x[0], y[0], z[1]), dvec3(x[0], y[1], middle)]);
        shape
    }

    /// A pyramid over a rectangle.
    pub(crate) fn pyramid(x: [f64; 2], y: [f64; 2], z: [f64; 2]) -> Self {
        let ring = [dvec3(x[0], y[0], z[1]), dvec3(x[1], y[0], z[1]), dvec3(x[1], y[0], z[0]), dvec3(x[0], y[0], z[0])];
        let top = dvec3((x[0] + x[1]) / 2.0, y[1], (z[0] + z[1]) / 2.0);
        let faces: Vec<_> = (0..4).map(|i| [ring[i], ring[(i + 1) % 4], top]).collect();
        Self::flat(&faces)
    }

    /// A frustum of `n` smooth sides about the y axis, radius `r[0]` below and `r[1]` above; an upper radius of zero
    /// makes a cone. Mapped with u around (0..1) and v down (0..1).
    pub(crate) fn cylinder(n: u32, r: [f64; 2], y: [f64; 2], cap: bool) -> Self {
        let mut shape = Self::new();
        let slope = (r[0] - r[1]) / (y[1] - y[0]);
        for i in 0..=n {
            let turn = f64::from(i) / f64::from(n);
            let (s, c) = libm::sincos(turn * TAU);
            let normal = dvec3(c, slope, -s).normalize();
            for (v, r, y) in [(1.0, r[0], y[0]), (0.0, r[1], y[1])] {
                shape.vertex(Vertex { texcoord: dvec2(turn, v), ..Vertex::new(dvec3(c * r, y, -s * r), normal) });
            }
        }
        for a in (0..n).map(|i| 2 * i) {
            shape.triangle(a, a + 2, a + 3);
            if r[1] > 0.0 {
                shape.triangle(a, a + 3, a + 1);
            }
        }
        if cap && r[1] > 0.0 {
            shape.polygon(&circle(n, r[1], y[1]));
        }
        shape
    }

    /// A unit sphere of `n` slices and `m` stacks: 2 n (m − 1) triangles.
    pub(crate) fn sphere(n: u32, m: u32) -> Self {
        let mut shape = Self::new();
        for j in 0..=m {
            let (s, c) = libm::sincos(f64::from(j) / f64::from(m) * TAU / 2.0);
            for i in 0..=n {
                let (sp, cp) = libm::sincos(f64::from(i) / f64::from(n) * TAU);
                let p = dvec3(s * cp, c, -s * sp);
                let texcoord = dvec2(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
                shape.vertex(Vertex { texcoord, ..Vertex::new(p, p) });
            }
        }
        for j in 0..m {
            for i in 0..n {
                let (a, b) = (j * (n + 1) + i, (j + 1) * (n + 1) + i);
                if j < m - 1 {
                    shape.triangle(a, b, b + 1);
                }
                if j > 0 {
                    shape.triangle(a, b + 1, a + 1);
                }
            }
        }
        shape
    }

    /// A net of `nx` × `ny` cells; `vertex(i, j)` gives the corners. The front is where i to the right and j
    /// downwards make a picture seen from in front (for ground seen from above: i east, j south).
    pub(crate) fn grid(nx: u32, ny: u32, mut vertex: impl FnMut(u32, u32) -> Vertex) -> Self {
        let mut shape = Self::new();
        for j in 0..=ny {
            for i in 0..=nx {
                shape.vertex(vertex(i, j));
            }
        }
        for j in 0..ny {
            for i in 0..nx {
                let a = j * (nx + 1) + i;
                let (b, c, d) = (a + 1, a + nx + 1, a + nx + 2);
                shape.triangle(a, c, d);
                shape.triangle(a, d, b);
            }
        }
        shape
    }

    /// A skin over rings of equally many points, each ring closed, smooth all over. Seen from ring 0 towards the last,
    /// the points of a ring run clockwise. Mapped with u along the rings (0..1) and v around (0..1).
    pub(crate) fn loft(rings: &[Vec<DVec3>]) -> Self {
        let (count, around) = (rings.len(), rings[0].len());
        let at = |i: usize, j: usize| rings[i][j % around];
        let mut shape = Self::new();
        for i in 0..count {
            for j in 0..=around {
                let along = at((i + 1).min(count - 1), j) - at(i.saturating_sub(1), j);
                let across = at(i, j + 1) - at(i, j + around - 1);
                let centre = rings[i].iter().sum::<DVec3>() / around as f64;
                // At the tip of a cone the ring has no width, and the radius of its neighbour shows the way.
                let normal = across.cross(along).try_normalize().unwrap_or_else(|| {
                    let inner = if i == 0 { 1 } else { i - 1 };
                    (centre - rings[inner].iter().sum::<DVec3>() / around as f64).normalize_or(DVec3::Y)
                });
                let texcoord = dvec2(i as f64 / (count - 1) as f64, j as f64 / around as f64);
                shape.vertex(Vertex { texcoord, ..Vertex::new(at(i, j), normal) });
            }
        }
        let row = around as u32 + 1;
        for i in 0..count as u32 - 1 {
            for j in 0..row - 1 {
                let a = i * row + j;
                shape.triangle_unless_flat(a, a + 1, a + row + 1);
                shape.triangle_unless_flat(a, a + row + 1, a + row);
            }
        }
        shape
    }

    fn triangle_unless_flat(&mut self, a: u32, b: u32, c: u32) {
        let [p, q, r] = [a, b, c].map(|i| self.positions[i as usize]);
        if (q - p).cross(r - p).length_squared() > 1e-18 {
            self.triangle(a, b, c);
        }
    }

    /// The same shape, moved. A map that mirrors turns the triangles over, so that fronts stay fronts.
    #[must_use]
    pub(crate) fn transformed(mut self, map: DAffine3) -> Self {
        // Normals go by the cofactor matrix, which unlike the inverse transpose exists for every map.
        let m = map.matrix3;
        let sign = m.determinant().signum();
        let cofactors = [m.y_axis.cross(m.z_axis), m.z_axis.cross(m.x_axis), m.x_axis.cross(m.y_axis)];
        for p in &mut self.positions {
            *p = map.transform_point3(*p);
        }
        for n in &mut self.normals {
            *n = ((cofactors[0] * n.x + cofactors[1] * n.y + cofactors[2] * n.z) * sign).normalize_or(DVec3::Y);
        }
        if sign < 0.0 {
            for t in &mut self.triangles {
                t.swap(1, 2);
            }
        }
        self
    }

    #[must_use]
    pub(crate) fn moved(self, by: DVec3) -> Self {
        self.transformed(DAffine3::from_translation(by))
    }

    #[must_use]
    pub(crate) fn scaled(self, by: DVec3) -> Self {
        self.transformed(DAffine3::from_scale(by))
    }

    /// Turned about the y axis, counter-clockwise seen from above.
    #[must_use]
    pub(crate) fn turned(self, angle_rad: f64) -> Self {
        self.transformed(DAffine3::from_rotation_y(angle_rad))
    }

    /// Together with its mirror image on the other side of the plane x = 0.
    #[must_use]
    pub(crate) fn mirrored(self) -> Self {
        let other = self.clone().scaled(dvec3(-1.0, 1.0, 1.0));
        Self::join([self, other])
    }

    /// All of one colour, linear RGB.
    #[must_use]
    pub(crate) fn colored(self, color: DVec3) -> Self {
        self.painted(|_, _| color)
    }

    /// Coloured by position and normal.
    #[must_use]
    pub(crate) fn painted(mut self, color: impl Fn(DVec3, DVec3) -> DVec3) -> Self {
        for ((c, &p), &n) in self.colors.iter_mut().zip(&self.positions).zip(&self.normals) {
            *c = color(p, n);
        }
        self
    }

    /// Texture coordinates by position and normal.
    #[must_use]
    pub(crate) fn mapped(mut self, texcoord: impl Fn(DVec3, DVec3) -> DVec2) -> Self {
        for ((t, &p), &n) in self.texcoords.iter_mut().zip(&self.positions).zip(&self.normals) {
            *t = texcoord(p, n);
        }
        self
    }

    /// Texture coordinates by the position and the coordinate there was.
    #[must_use]
    pub(crate) fn remapped(mut self, texcoord: impl Fn(DVec3, DVec2) -> DVec2) -> Self {
        for (t, &p) in self.texcoords.iter_mut().zip(&self.positions) {
            *t = texcoord(p, *t);
        }
        self
    }

    /// Texture coordinates multiplied.
    #[must_use]
    pub(crate) fn tiled(mut self, by: DVec2) -> Self {
        for t in &mut self.texcoords {
            *t *= by;
        }
        self
    }

    /// Each vertex moved by `offset(position)`; normals stay.
    #[must_use]
    pub(crate) fn jittered(mut self, mut offset: impl FnMut(DVec3) -> DVec3) -> Self {
        for p in &mut self.positions {
            *p += offset(*p);
        }
        self
    }

    /// As the glTF writer wants it; colours that are all white and coordinates that are all zero are left out.
    pub(crate) fn geometry(&self) -> Geometry {
        let plain = self.colors.iter().all(|&c| c == DVec3::ONE);
        let unmapped = self.texcoords.iter().all(|&t| t == DVec2::ZERO);
        let colors = if plain { &[] } else { &self.colors[..] };
        let texcoords = if unmapped { &[] } else { &self.texcoords[..] };
        Geometry {
            positions: self.positions.iter().map(|p| p.as_vec3().to_array()).collect(),
            normals: self.normals.iter().map(|n| n.as_vec3().to_array()).collect(),
            colors: colors.iter().map(|c| c.clamp(DVec3::ZERO, DVec3::ONE).as_vec3().to_array()).collect(),
            texcoords: texcoords.iter().map(|t| t.as_vec2().to_array()).collect(),
            triangles: self.triangles.clone(),
        }
    }
}

/// Points of a circle about the y axis, counter-clockwise seen from above.
pub(crate) fn circle(n: u32, r: f64, y: f64) -> Vec<DVec3> {
    (0..n)
        .map(|i| {
            let (s, c) = libm::sincos(f64::from(i) / f64::from(n) * TAU);
            dvec3(c * r, y, -s * r)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Six times the enclosed volume: positive when a closed shape's fronts are outside.
    fn volume(shape: &Shape) -> f64 {
        let p = &shape.positions;
        shape.triangles.iter().map(|t| p[t[0] as usize].dot(p[t[1] as usize].cross(p[t[2] as usize]))).sum()
    }

    fn tube(n: u32) -> Shape {
        let ring = |z: f64, r: f64| circle(n, r, 0.0).iter().map(|p| dvec3(p.x, -p.z, z)).collect::<Vec<_>>();
        Shape::loft(&[ring(-2.0, 0.0), ring(-1.0, 1.0), ring(1.0, 1.0), ring(2.0, 0.0)])
    }

    #[test]
    fn closed_shapes_face_outwards() {
        let unit = [-1.0, 1.0];
        for (name, shape, expected) in [
            ("cuboid", Shape::cuboid(unit, unit, unit, Caps::Both), 48.0),
            ("sphere", Shape::sphere(64, 32), 8.0 * std::f64::consts::PI),
            ("loft", tube(64), 6.0 * std::f64::consts::PI * (2.0 + 2.0 / 3.0)),
            ("mirrored", Shape::cuboid(unit, unit, unit, Caps::Both).moved(dvec3(3.0, 0.0, 0.0)).mirrored(), 96.0),
        ] {
            let found = volume(&shape);
            assert!((found / expected - 1.0).abs() < 0.01, "{name}: {found}, not {expected}");
        }
    }

    #[test]
    fn normals_agree_with_the_winding() {
        let unit = [-1.0, 1.0];
        for (name, shape) in [
            ("cuboid", Shape::cuboid(unit, unit, unit, Caps::Both)),
            ("gable", Shape::gable(unit, unit, unit)),
            ("pyramid", Shape::pyramid(unit, unit, unit)),
            ("cylinder", Shape::cylinder(12, [1.0, 0.5], unit, true)),
            ("cone", Shape::cylinder(12, [1.0, 0.0], unit, false)),
            ("sphere", Shape::sphere(12, 8)),
            ("loft", tube(12)),
            ("turned and squeezed", Shape::sphere(12, 8).scaled(dvec3(-1.0, 3.0, 0.5)).turned(1.0)),
            ("grid", Shape::grid(2, 2, |i, j| Vertex::new(dvec3(f64::from(i), 0.0, f64::from(j)), DVec3::Y))),
        ] {
            for t in &shape.triangles {
                let [a, b, c] = t.map(|i| shape.positions[i as usize]);
                let face = (b - a).cross(c - a);
                let mean: DVec3 = t.iter().map(|&i| shape.normals[i as usize]).sum();
                assert!(face.dot(mean) > 0.0, "{name}: a face turns away from its normals");
            }
            assert!(
                shape.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9),
                "{name}: a normal is no unit vector"
            );
        }
    }
}
