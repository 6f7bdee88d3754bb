//! Detail: which versions of a model are shown from where the eye is, and how they are mixed (lod.md; seed 004, 2.5,
//! 3.4 and 4.4).
//!
//! Three steps. How many display elements does the entity's critical radius span from here ([`elements`], the report's
//! detail control parameter `N_e`)? What does the table say to that number ([`LevelTable::weights`])? And which models
//! must boards be told of ([`Detail::select`])?
//!
//! Weights are multiples of 1/65 536, so that those of two versions sum up to exactly 1 in f32 and an eye that hardly moves changes
//! none of them; a step is a 257th of what an 8-bit picture can show.

use crate::scene::{Entities, Model, NodeIndex, Scene, bounds};
use glam::{DVec2, DVec3, Vec3Swizzles};
use proto::frame::VersionWeights;
use proto::ids::ModelId;
use proto::limits;
use proto::scene::Sphere;
use proto::view::View;
use std::collections::BTreeSet;

/// The grain of weights.
const GRAIN: f64 = 65_536.0;

/// A display element is never wider than this, radians: an eighth of a circle, where the tangent is 1. Views of a few
/// pixels would otherwise have elements of more than a right angle, which no number of them could span.
const ELEMENT_MAX: f64 = std::f64::consts::FRAC_PI_4;

/// Whether models are shown by the rules of detail.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DetailMode {
    /// Levels by what they span on the picture.
    #[default]
    Auto,
    /// All at their finest and unfaded, whatever their distance: what pictures are compared with.
    Finest,
}

/// At how many display elements which level is shown. Level 1 is the coarsest; a model of n versions has the levels 1 to n.
#[derive(Clone, Debug, PartialEq)]
pub struct LevelTable {
    /// From nothing at the first number of elements to all of it at the second.
    fade: (f64, f64),
    /// Entry L − 1: from level L alone to level L + 1 alone.
    steps: [(f64, f64); limits::VERSIONS_MAX - 1],
}

impl Default for LevelTable {
    /// The square law: level L alone up to 1.5 L², L + 1 alone from 1.5 L (L + 1); and fading from 1 element to half of one.
    fn default() -> Self {
        let steps = std::array::from_fn(|i| {
            let level = (i + 1) as f64;
            (1.5 * level * level, 1.5 * level * (level + 1.0))
        });
        Self { fade: (0.5, 1.0), steps }
    }
}

impl LevelTable {
    /// Whether a model that spans so many display elements shows its finest version alone.
    fn is_finest(&self, elements: f64, versions: usize) -> bool {
        let step = versions.checked_sub(2).and_then(|last| self.steps.get(last));
        elements >= step.map_or(self.fade.1, |(_, to)| to.max(self.fade.1))
    }

    /// The weights of a model's versions, finest first, if it spans so many display elements (0 to infinity). What is missing
    /// to 1 has faded.
    pub fn weights(&self, elements: f64, versions: usize) -> Vec<f32> {
        let mut weights = vec![0.0; versions];
        let presence = (elements - self.fade.0) / (self.fade.1 - self.fade.0);
        let presence = if presence >= 1.0 { 1.0 } else { (presence.max(0.0) * GRAIN).round() / GRAIN };
        let steps = &self.steps[..versions.saturating_sub(1).min(self.steps.len())];
        let level = steps.iter().take_while(|(_, to)| elements >= *to).count() + 1;
        // Of level + 1; the last level has nothing finer.
        let finer = steps.get(level - 1).map_or(0.0, |(from, to)| ((elements - from) / (to - from)).max(0.0));
        let finer = (finer * presence * GRAIN).round() / GRAIN;
        weights[versions - level] = (presence - finer) as f32;
        if finer > 0.0 {
            weights[versions - level - 1] = finer as f32;
        }
        weights
    }
}

/// What the parameter asks of an entity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Its middle, world.
    pub centre: DVec3,
    /// Critical radius `r_c`, m; 0 if there is nothing.
    pub radius: f64,
    /// Set for a feature on the ground.
    pub lying: Option<Lying>,
}

/// The shape of a feature on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lying {
    /// Long radius `r_l`, m.
    pub long: f64,
    /// Short radius `r_s`, m.
    pub short: f64,
    /// Unit vector along the long axis: east, south.
    pub axis: DVec2,
}

/// `K_LOD`: how many display elements an object spans whose critical radius is as large as its distance. That of the view with
/// the smallest elements, since all views of an eye show one level (lod.md, "Overload").
pub fn display_factor<'a>(views: impl IntoIterator<Item = &'a View>) -> f64 {
    let factor = |view: &View| {
        let field = view.tangents.right.atan() - view.tangents.left.atan();
        1.0 / (field / f64::from(view.width)).min(ELEMENT_MAX).tan()
    };
    views.into_iter().map(factor).fold(1.0, f64::max)
}

/// The detail control parameter `N_e`: the display elements that the feature's critical radius spans, 0 to infinity and never
/// NaN. Infinite on and within the feature, and wherever a coordinate is no number: full detail is never wrong.
pub fn elements(feature: &Feature, eye: DVec3, display_factor: f64, visibility_m: Option<f64>) -> f64 {
    let sight = feature.centre - eye;
    let slant = sight.length();
    // A slant range that is NaN is "within".
    let is_outside = slant > feature.radius;
    if !is_outside {
        return f64::INFINITY;
    }
    let spanned = match feature.lying {
        None => display_factor * (feature.radius / slant),
        Some(lying) => {
            // World +Y is up. A feature seen from below is as large as from above.
            let (ground, height) = (sight.xz().length(), sight.y.abs());
            let effective = lying.effective_radius(sight.xz());
            let room = slant * slant - effective * ground;
            if room > 0.0 { display_factor * (effective * height / room) } else { f64::INFINITY }
        }
    };
    let seen = spanned * visible(slant - feature.radius, visibility_m);
    if seen.is_nan() { f64::INFINITY } else { seen }
}

impl Lying {
    /// `r_e` for a line of sight with this ground track. Its length doesn't matter; without any, all directions are as good.
    fn effective_radius(&self, track: DVec2) -> f64 {
        let Some(track) = track.try_normalize() else { return self.long };
        let (cos, sin) = (track.dot(self.axis), track.perp_dot(self.axis));
        let across = (self.short * cos).hypot(self.long * sin);
        // A line that is looked along has no width: it is as long as it is.
        if across > 0.0 { self.long * self.short / across } else { self.long }
    }
}

/// f(v): what the air lets through of a feature whose nearest point is so far away; 0 where 98 % is faded.
fn visible(distance: f64, visibility_m: Option<f64>) -> f64 {
    match visibility_m {
        Some(range) if distance >= range => 0.0,
        Some(range) => (0.02f64.ln() * distance / range).exp(),
        None => 1.0,
    }
}

/// Selects the versions of a scene's models. Made for one scene and used with that one only.
#[derive(Clone, Debug)]
pub struct Detail {
    mode: DetailMode,
    table: LevelTable,
    /// By model: what is asked of it where the file puts it. `None`: a merged part of one mesh, which has no levels.
    at_rest: Vec<Option<Feature>>,
}

impl Detail {
    /// For `scene`.
    pub fn new(scene: &Scene, mode: DetailMode, table: LevelTable) -> Self {
        let entities = Entities::new(scene);
        let at_rest = scene.models.iter().map(|model| model.only.is_none().then(|| feature(scene, &entities, model)));
        Self { mode, at_rest: at_rest.collect(), table }
    }

    /// How the models are mixed for an eye at `eye`, by ascending model: as the host wants those in `given` (ascending too), the others
    /// by the table, or at their finest. Models that show their finest version alone are left out, unless the host names them. Replaces the
    /// content of `out`.
    pub fn select(
        &self,
        scene: &Scene,
        entities: &Entities,
        given: &[VersionWeights],
        eye: DVec3,
        display_factor: f64,
        visibility_m: Option<f64>,
        out: &mut Vec<VersionWeights>,
    ) {
        if self.mode == DetailMode::Finest {
            out.clear();
            out.extend_from_slice(given);
            return;
        }
        let model_of = |object| scene.node(scene.object(object).node).model;
        let moved: BTreeSet<ModelId> = entities.objects().iter().filter_map(|moved| model_of(moved.object)).collect();
        let mut given = given.iter().peekable();
        out.clear();
        for (id, (model, at_rest)) in (0..).map(ModelId).zip(scene.models.iter().zip(&self.at_rest)) {
            if let Some(wanted) = given.next_if(|given| given.model == id) {
                out.push(wanted.clone());
                continue;
            }
            let Some(at_rest) = at_rest else { continue };
            let moved = moved.contains(&id).then(|| feature(scene, entities, model));
            let elements = elements(&moved.unwrap_or(*at_rest), eye, display_factor, visibility_m);
            let versions = model.versions as usize;
            if !self.table.is_finest(elements, versions) {
                out.push(VersionWeights { model: id, weights: self.table.weights(elements, versions) });
            }
        }
        assert!(out.len() <= limits::MODELS_MAX, "the scene has no more models than a frame can name");
    }
}

/// What is asked of a model whose objects are where `entities` has them.
fn feature(scene: &Scene, entities: &Entities, model: &Model) -> Feature {
    let objects = || objects_of(scene, model.node);
    let balls: Vec<Sphere> =
        objects().map(|id| bounds::ball_moved(&entities.transform(scene, id), ball(scene, id))).collect();
    let around = bounds::ball_of_balls(balls.iter());
    let said = objects().next().map(|id| scene.object(id).traits);
    let radius = said.and_then(|traits| traits.critical_radius).unwrap_or(around.radius).max(0.0);
    let lying = said.is_some_and(|traits| traits.surface).then(|| {
        let corners: Vec<DVec2> = objects().flat_map(|id| corners(scene, entities, id)).collect();
        lying(&corners)
    });
    Feature { centre: around.centre, radius, lying }
}

fn objects_of(scene: &Scene, node: NodeIndex) -> impl Iterator<Item = proto::ids::ObjectId> + use<> {
    scene.node(node).objects.clone().map(proto::ids::ObjectId)
}

fn ball(scene: &Scene, object: proto::ids::ObjectId) -> Sphere {
    scene.shape_of(scene.object(object)).sphere
}

/// Where the corners of the boxes of an object's pieces stand on the ground: east, south.
fn corners(scene: &Scene, entities: &Entities, object: proto::ids::ObjectId) -> Vec<DVec2> {
    let transform = entities.transform(scene, object);
    let pieces = &scene.shape_of(scene.object(object)).pieces;
    let corner = |piece: usize, k: usize| {
        let corners = [pieces[piece].bounds.min, pieces[piece].bounds.max];
        let local = DVec3::new(corners[k & 1].x, corners[k >> 1 & 1].y, corners[k >> 2].z);
        transform.transform_point3(local).xz()
    };
    (0..pieces.len()).flat_map(|piece| (0..8).map(move |k| corner(piece, k))).collect()
}

/// Axes and radii of a set of points on the ground: along the direction in which they spread most, and across.
fn lying(points: &[DVec2]) -> Lying {
    let middle = points.iter().sum::<DVec2>() / points.len().max(1) as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for point in points {
        let by = *point - middle;
        (xx, xy, yy) = (xx + by.x * by.x, xy + by.x * by.y, yy + by.y * by.y);
    }
    // The eigenvector of the larger eigenvalue; from the row that is farther from being zero.
    let half = (xx - yy) / 2.0;
    let root = half.hypot(xy);
    let along = if half >= 0.0 { DVec2::new(half + root, xy) } else { DVec2::new(xy, root - half) };
    let axis = along.try_normalize().unwrap_or(DVec2::X);
    let radius = |direction: DVec2| {
        let places = points.iter().map(|point| direction.dot(*point - middle));
        let (low, high) = places.fold((0.0f64, 0.0f64), |(low, high), place| (low.min(place), high.max(place)));
        (high - low) / 2.0
    };
    let (a, b) = (radius(axis), radius(axis.perp()));
    let (long, short, axis) = if a >= b { (a, b, axis) } else { (b, a, axis.perp()) };
    Lying { long, short, axis }
}

#[cfg(test)]
mod torture;
