//! What all parts of the airport are built with: the writer, the materials, chance, and painted shadows.

use super::super::paint;
use super::super::random::Random;
use super::super::shapes::Shape;
use crate::scene::glb::{AlphaMode, GlbBuilder, MaterialId, MeshId, Node, NodeId, Surface};
use glam::{DQuat, DVec2, DVec3, dvec2, dvec3};
use serde_json::json;

/// Heights above the level ground of the airfield, m. Faces never lie in one plane: each kind of surface has its own
/// height, far enough from the next to be told apart from 3 km and too little to be seen floating from 5 m.
pub(super) mod level {
    /// Taxiways and aprons.
    pub(crate) const TAXIWAY: f64 = 0.05;
    /// Lines on them.
    pub(crate) const TAXI_LINE: f64 = 0.10;
    /// The runway.
    pub(crate) const RUNWAY: f64 = 0.08;
    /// Markings on it.
    pub(crate) const MARKING: f64 = 0.13;
    /// Shadows, above all of these.
    pub(crate) const SHADOW: f64 = 0.17;
}

/// Towards the default sun, not normalised: picture.md, "Shade".
const SUN: DVec3 = dvec3(0.35, 0.80, 0.48);

/// The materials that parts share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Palette {
    /// Vertex colours and nothing else.
    pub(super) plain: MaterialId,
    /// The same, seen from both sides.
    pub(super) cloth: MaterialId,
    pub(super) grass: MaterialId,
    pub(super) crops: MaterialId,
    pub(super) leaves: MaterialId,
    pub(super) tree_tops: MaterialId,
    pub(super) asphalt: MaterialId,
    pub(super) slabs: MaterialId,
    pub(super) ribs: MaterialId,
    pub(super) tiles: MaterialId,
    pub(super) office: MaterialId,
    pub(super) house: MaterialId,
    pub(super) skin: MaterialId,
    pub(super) water: MaterialId,
    pub(super) glass: MaterialId,
    pub(super) propeller: MaterialId,
    pub(super) fence: MaterialId,
    pub(super) shadow: MaterialId,
    pub(super) white_lamp: MaterialId,
    pub(super) red_lamp: MaterialId,
    pub(super) green_lamp: MaterialId,
}

impl Palette {
    fn new(glb: &mut GlbBuilder) -> Self {
        let mut textured = |name: &str, picture| {
            let picture = glb.picture(name, &picture);
            glb.material(name, &Surface::textured(picture))
        };
        let [grass, crops, leaves] = [("grass", paint::grass()), ("crops", paint::rows()), ("leaves", paint::leaves())]
            .map(|(n, p)| textured(n, p));
        let tree_tops = textured("tree tops", paint::tree_tops());
        let [asphalt, slabs] = [("asphalt", paint::asphalt()), ("slabs", paint::slabs())].map(|(n, p)| textured(n, p));
        let [ribs, tiles] = [("ribs", paint::ribs()), ("tiles", paint::tiles())].map(|(n, p)| textured(n, p));
        let [office, house] = [("office", paint::office()), ("house", paint::house())].map(|(n, p)| textured(n, p));
        let skin = textured("airliner", paint::airliner_skin());
        let translucent =
            |r, g, b, a| Surface { base_color: [r, g, b, a], alpha: AlphaMode::Blend, ..Surface::default() };
        let lamp = |r, g, b| Surface { emissive: [r, g, b], ..Surface::plain(0.1, 0.1, 0.1) };
        let both_sides = |surface| Surface { double_sided: true, ..surface };
        Self {
            plain: glb.material("plain", &Surface::default()),
            cloth: glb.material("cloth", &both_sides(Surface::default())),
            grass,
            crops,
            leaves,
            tree_tops,
            asphalt,
            slabs,
            ribs,
            tiles,
            office,
            house,
            skin,
            water: glb.material("water", &Surface::plain(0.13, 0.21, 0.27)),
            glass: glb.material("glass", &both_sides(translucent(0.10, 0.22, 0.24, 0.45))),
            propeller: glb.material("propeller", &both_sides(translucent(0.2, 0.2, 0.2, 0.18))),
            fence: glb.material("fence", &both_sides(translucent(0.35, 0.37, 0.36, 0.2))),
            shadow: glb.material("shadow", &translucent(0.0, 0.0, 0.004, 0.58)),
            white_lamp: glb.material("white lamp", &lamp(1.0, 0.95, 0.8)),
            red_lamp: glb.material("red lamp", &lamp(1.0, 0.06, 0.04)),
            green_lamp: glb.material("green lamp", &lamp(0.05, 1.0, 0.3)),
        }
    }
}

/// The scene under construction.
#[derive(Debug)]
pub(super) struct Kit {
    pub(super) glb: GlbBuilder,
    pub(super) palette: Palette,
    pub(super) random: Random,
    /// The parent of all painted shadows, so that whoever computes real ones can leave them out.
    shadows: NodeId,
}

impl Kit {
    pub(super) fn new(seed: u64) -> Self {
        let mut glb = GlbBuilder::new("cyclorama airport");
        let palette = Palette::new(&mut glb);
        let shadows = glb.node(None, Node::new("painted shadows"));
        Self { glb, palette, random: Random::new(seed), shadows }
    }

    pub(super) fn group(&mut self, name: &str) -> NodeId {
        self.glb.node(None, Node::new(name))
    }

    /// A mesh of one shape per material.
    pub(super) fn mesh(&mut self, name: &str, parts: &[(Shape, MaterialId)]) -> MeshId {
        let parts: Vec<_> = parts.iter().map(|(shape, material)| (shape.geometry(), *material)).collect();
        self.glb.mesh(name, &parts)
    }

    /// A node that shows a mesh of its own.
    pub(super) fn object(&mut self, parent: NodeId, name: &str, parts: &[(Shape, MaterialId)]) -> NodeId {
        let mesh = self.mesh(name, parts);
        self.glb.node(Some(parent), Node::new(name).mesh(mesh))
    }

    /// A node that the flight moves, with its shadow as a second such node.
    pub(super) fn entity(&mut self, name: &str, mesh: MeshId, at: DVec3, turned: DQuat) -> NodeId {
        let moving = json!({"cyclorama": {"static": false}});
        self.glb.node(None, Node::new(name).mesh(mesh).at(at).turned(turned).extras(moving))
    }

    /// The shadow that a box over level ground casts, painted on the ground.
    pub(super) fn box_shadow(&mut self, x: [f64; 2], z: [f64; 2], height: f64) {
        let corners = [dvec2(x[0], z[0]), dvec2(x[1], z[0]), dvec2(x[0], z[1]), dvec2(x[1], z[1])];
        self.outline_shadow(&corners, height);
    }

    /// The shadow of a convex prism with these ground points.
    pub(super) fn outline_shadow(&mut self, points: &[DVec2], height: f64) {
        let all: Vec<DVec2> = points.iter().flat_map(|&p| [p, p + shadow_shift(height)]).collect();
        let mut shape = Shape::new();
        shape.polygon(&hull(all).iter().map(|p| dvec3(p.x, level::SHADOW, p.y)).collect::<Vec<_>>());
        let material = self.palette.shadow;
        let shadows = self.shadows;
        self.object(shadows, "shadow", &[(shape, material)]);
    }

    /// A shadow mesh placed by hand.
    pub(super) fn placed_shadow(&mut self, mesh: MeshId, at: DVec3, turned: DQuat) {
        let shadows = self.shadows;
        self.glb.node(Some(shadows), Node::new("shadow").mesh(mesh).at(at).turned(turned));
    }
}

/// How far the shadow of a point at `height` lies from the point's foot: (x, z), m.
pub(super) fn shadow_shift(height: f64) -> DVec2 {
    dvec2(-SUN.x, -SUN.z) / SUN.y * height
}

/// Where the shadow of something at `p` lies on level ground.
pub(super) fn shadow_of(p: DVec3) -> DVec3 {
    let shift = shadow_shift(p.y);
    dvec3(p.x + shift.x, level::SHADOW, p.z + shift.y)
}

/// The convex hull of (x, z) points, counter-clockwise seen from above (Andrew's monotone chain).
fn hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp_dot(p - b) < 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut chain = half(&mut points.iter().copied());
    chain.extend(half(&mut points.iter().rev().copied()));
    chain
}

/// The rotation of something that heads `heading_rad` clockwise from north.
pub(super) fn heading(heading_rad: f64) -> DQuat {
    DQuat::from_rotation_y(-heading_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hull_faces_up_and_leaves_out_what_is_inside() {
        let square = [dvec2(0.0, 0.0), dvec2(2.0, 0.0), dvec2(1.0, 1.0), dvec2(2.0, 2.0), dvec2(0.0, 2.0)];
        let hull = hull(square.to_vec());
        assert_eq!(hull.len(), 4, "{hull:?}");
        // With z downwards on paper, counter-clockwise seen from above is a negative area in (x, z).
        let area: f64 = (0..4).map(|i| hull[i].perp_dot(hull[(i + 1) % 4])).sum();
        assert_eq!(area, -8.0);
    }

    #[test]
    fn shadows_fall_away_from_the_sun() {
        let shadow = shadow_of(dvec3(10.0, 8.0, 20.0));
        assert!(shadow.x < 10.0 && shadow.z < 20.0 && shadow.y == level::SHADOW, "{shadow}");
    }
}
