//! The world of proof.md's *lists*: objects of radius 2 to 12 m on a jittered 40 m grid, none overlapping but 6 % brought to overlap in pairs, 1 % of them
//! moving, four subobjects each. It is made from a seed, and needs no meshes.

use glam::{DQuat, DVec3};
use manager::scene::blocks::{Blocks, Bodies, Content};
use manager::scene::bvh::Cut;
use manager::select::{Body, Counters, Frustum, Where, World};
use proto::scene::Sphere;
use proto::view::{Pose, Samples, Tangents, View};
use std::ops::Range;

/// Distance of the grid's points, m.
const SPACING: f64 = 40.0;
/// How far an object may stand from its point, each way, m: neighbours of 12 m don't touch.
const JITTER: f64 = 7.9;
/// Subobjects of an object.
pub(crate) const PIECES: u32 = 4;
/// Of the objects, those that overlap another.
const OVERLAPPING: f64 = 0.06;
/// One object in so many moves.
const MOVING_EACH: usize = 100;
/// Radius of the circle that a moving object goes round, m, and how far round in a frame, radians: 10 m/s at 60 Hz.
const CIRCLE: (f64, f64) = (6.0, 10.0 / 60.0 / 6.0);
/// What the eye advances in a frame, m: 150 m/s at 60 Hz.
pub(crate) const ADVANCE: f64 = 2.5;
/// How high it is, m.
const HEIGHT: f64 = 300.0;
/// Visibility, m.
pub(crate) const VISIBILITY: f64 = 20_000.0;

/// Well mixed bits of two numbers (`SplitMix64`'s finaliser).
fn mixed(number: u64, salt: u64) -> u64 {
    let mut z = number.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(salt.wrapping_mul(0xd134_2543_de82_ef95));
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// Between 0 and 1.
fn part(number: usize, salt: u64) -> f64 {
    (mixed(number as u64, salt) >> 11) as f64 / (1u64 << 53) as f64
}

/// Where the objects stand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    count: usize,
    /// Grid points to a row.
    row: usize,
}

impl Layout {
    pub(crate) fn new(count: usize) -> Self {
        // Even, so that pairs are in one row.
        Self { count, row: ((count as f64).sqrt().ceil() as usize).next_multiple_of(2) }
    }

    /// Ground to an object, m².
    pub(crate) fn area_each(&self) -> f64 {
        SPACING * SPACING
    }

    fn radius(object: usize) -> f64 {
        2.0 + 10.0 * part(object, 1)
    }

    /// Where it stands if it is in no pair.
    fn alone(&self, object: usize) -> DVec3 {
        let (column, row) = (object % self.row, object / self.row);
        let from = |number: usize| (number as f64 - self.row as f64 / 2.0) * SPACING;
        let jitter = |salt| (part(object, salt) * 2.0 - 1.0) * JITTER;
        DVec3::new(from(column) + jitter(2), Self::radius(object), from(row) + jitter(3))
    }

    fn is_paired(&self, object: usize) -> bool {
        let first = object & !1;
        part(first, 4) < OVERLAPPING && first + 1 < self.count
    }

    fn is_moving(&self, object: usize) -> bool {
        object % MOVING_EACH == MOVING_EACH / 2 && !self.is_paired(object)
    }

    /// Where an object is at rest.
    pub(crate) fn at(&self, object: usize) -> Sphere {
        let radius = Self::radius(object);
        let mut centre = self.alone(object);
        if object % 2 == 1 && self.is_paired(object) {
            let other = self.alone(object - 1);
            let apart = (radius + Self::radius(object - 1)) * (0.3 + 0.6 * part(object, 5));
            centre = other + (centre - other).normalize() * apart;
        }
        Sphere { centre, radius }
    }

    /// From an object's centre to its piece's, m.
    fn offset(object: usize, piece: u32) -> DVec3 {
        let angle = (f64::from(piece) / f64::from(PIECES) + part(object, 6)) * std::f64::consts::TAU;
        let up = if piece.is_multiple_of(2) { 0.3 } else { -0.3 };
        DVec3::new(angle.cos() * 0.8, up, angle.sin() * 0.8) * (Self::radius(object) * 0.5)
    }

    fn piece(object: usize, piece: u32, centre: DVec3) -> Sphere {
        let radius = Self::radius(object) * (0.3 + 0.15 * part(object, 7 + u64::from(piece)));
        Sphere { centre: centre + Self::offset(object, piece), radius }
    }
}

/// What the database is made from: some of a layout's objects.
struct Standing<'a> {
    /// Which of them.
    objects: &'a [u32],
    /// Their balls.
    balls: Vec<Sphere>,
}

impl Bodies for Standing<'_> {
    fn count(&self) -> usize {
        self.objects.len()
    }
    fn ball(&self, object: u32) -> Sphere {
        self.balls[object as usize]
    }
    fn pieces(&self, object: u32) -> Range<u32> {
        object * PIECES..(object + 1) * PIECES
    }
    fn piece_ball(&self, piece: u32) -> Sphere {
        let object = (piece / PIECES) as usize;
        Layout::piece(self.objects[object] as usize, piece % PIECES, self.balls[object].centre)
    }
    fn content(&self, object: u32) -> Content {
        let radius = self.balls[object as usize].radius;
        let object = self.objects[object as usize] as usize;
        let triangles = 100 + (part(object, 20) * 1900.0) as u32;
        // A cube in the ball.
        let area = (2.0 * radius * radius) as f32;
        let translucent = if part(object, 21) < 0.05 { area / PIECES as f32 } else { 0.0 };
        Content { vertices: triangles / 2, triangles, area, textured: 0.0, translucent }
    }
}

/// An object that moves.
#[derive(Clone, Copy, Debug)]
struct Mover {
    /// Number in the world, and in the layout.
    object: u32,
    laid: u32,
    home: DVec3,
    ball: Sphere,
}

/// The world: a database, and what moves in it.
#[derive(Debug)]
pub(crate) struct Field {
    blocks: Blocks,
    side: f64,
    movers: Vec<Mover>,
    /// By object: its place in `movers`, or `u32::MAX`.
    numbers: Vec<u32>,
    places: u64,
}

impl Field {
    /// Of so many objects.
    pub(crate) fn new(count: usize, cut: Cut) -> Self {
        let all: Vec<u32> = (0..count as u32).collect();
        Self::of(Layout::new(count), &all, cut)
    }

    /// Of some of a layout's objects.
    pub(crate) fn of(layout: Layout, objects: &[u32], cut: Cut) -> Self {
        let balls = objects.iter().map(|&object| layout.at(object as usize)).collect();
        let blocks = Blocks::build(&Standing { objects, balls }, cut);
        let mut numbers = vec![u32::MAX; objects.len()];
        let mut movers = Vec::new();
        for (object, &laid) in (0..).zip(objects).filter(|(_, laid)| layout.is_moving(**laid as usize)) {
            numbers[object as usize] = movers.len() as u32;
            let ball = layout.at(laid as usize);
            movers.push(Mover { object, laid, home: ball.centre, ball });
        }
        Self { blocks, side: layout.row as f64 * SPACING, movers, numbers, places: 0 }
    }

    /// Brings what moves to where it is in a frame.
    pub(crate) fn set_frame(&mut self, frame: u32) {
        self.places = u64::from(frame) + 1;
        for mover in &mut self.movers {
            let angle = f64::from(frame) * CIRCLE.1 + f64::from(mover.laid);
            mover.ball.centre = mover.home + DVec3::new(angle.cos(), 0.0, angle.sin()) * CIRCLE.0;
        }
    }

    /// The eye of a frame: it flies along −z, from so far before the middle that it is there half-way.
    pub(crate) fn eye(&self, frame: u32, frames: u32) -> Pose {
        let along = (f64::from(frame) - f64::from(frames) / 2.0) * ADVANCE;
        let reach = self.side / 2.0;
        Pose { position: DVec3::new(3.0, HEIGHT, (-along).clamp(-reach, reach)), orientation: DQuat::IDENTITY }
    }

    /// The ball of an object now.
    pub(crate) fn ball(&self, object: u32) -> Sphere {
        match self.moved_number(object) {
            Some(moved) => self.movers[moved].ball,
            None => self.blocks.ball(self.blocks.slot(object)),
        }
    }

    /// The ball of a subobject now.
    pub(crate) fn piece_ball(&self, id: u32) -> Sphere {
        let (object, piece) = (id / PIECES, (id % PIECES) as usize);
        match self.moved_number(object) {
            Some(moved) => self.moved_piece_ball(moved, piece),
            None => {
                let slot = self.blocks.slot(object);
                self.blocks.piece_ball(slot, self.blocks.places(slot).start + piece)
            }
        }
    }
}

/// Three adjoining views of 60°, 1920 pixels across.
pub(crate) fn views() -> Vec<View> {
    let across = 30f64.to_radians().tan();
    let up = across * 9.0 / 16.0;
    let tangents = Tangents { left: -across, right: across, bottom: -up, top: up };
    View::row(3, 1920, 1080, tangents, Samples::One)
}

impl World for Field {
    fn blocks(&self) -> &Blocks {
        &self.blocks
    }
    fn moved_count(&self) -> usize {
        self.movers.len()
    }
    fn moved_object(&self, moved: usize) -> u32 {
        self.movers[moved].object
    }
    fn first_piece(&self, object: u32) -> u32 {
        object * PIECES
    }
    fn moved_ball(&self, moved: usize) -> Sphere {
        self.movers[moved].ball
    }
    fn moved_piece_ball(&self, moved: usize, piece: usize) -> Sphere {
        let mover = &self.movers[moved];
        Layout::piece(mover.laid as usize, piece as u32, mover.ball.centre)
    }
    fn moved_number(&self, object: u32) -> Option<usize> {
        let number = self.numbers[object as usize];
        (number != u32::MAX).then_some(number as usize)
    }
    fn moved_set(&self) -> u64 {
        0
    }
    fn moved_places(&self) -> u64 {
        self.places
    }
    fn shown_set(&self) -> u64 {
        0
    }
    fn conditional(&self, _: &mut dyn FnMut(u32)) {}
    fn is_shown(&self, _: u32) -> bool {
        true
    }
    fn across(&self, body: Body, frustum: &Frustum, counters: &mut Counters, take: &mut dyn FnMut(usize)) {
        counters.subobjects_tested += u64::from(PIECES);
        for piece in 0..PIECES as usize {
            let ball = match body {
                Body::AtRest(slot) => self.blocks.piece_ball(slot, self.blocks.places(slot).start + piece),
                Body::Moved(moved) => self.moved_piece_ball(moved, piece),
            };
            if frustum.ball(ball) != Where::Outside {
                take(piece);
            }
        }
    }
}
