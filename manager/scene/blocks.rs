//! The hierarchical database as selection walks it (seed 002, claim 1): bounding balls at every level of a tree whose leaves are
//! *blocks* of 64 objects that lie together.
//!
//! What is asked of an object lies by *slot*, block after block, one array per number (structure of arrays), so that a
//! loop over a block is a loop over vectors; and a bit mask says everything about the objects of a block in one word. Within a block the
//! largest come first: of a block far off it is then the first few that are large enough to be seen.
//!
//! Balls are kept as four f32 in the block's own frame, `origin + unit · offset`, where unit is a power of two no smaller than anything in
//! the block. That is 16 bytes instead of 32, and good to a few millimetres in a block of 64 km and to micrometres in one of a hundred metres. What is
//! lost by rounding is added to the radius, so that a kept ball still encloses what it stands for; and kept balls are *the* balls: keys, overlaps
//! and tests are f64 arithmetic on them, in one order, so that all ways to ask give the same bits.

use super::bvh::{Bvh, Cut};
use glam::DVec3;
use proto::scene::Sphere;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Objects of a block: as many as a word has bits.
pub const BLOCK: usize = 64;

/// What the database is made from. Objects and subobjects are numbered from 0; each object has at least one subobject, its own one after another
/// and all in the order of the objects.
pub trait Bodies: Sync {
    /// Number of objects.
    fn count(&self) -> usize;
    /// Encloses the object, world. An empty ball counts as a point.
    fn ball(&self, object: u32) -> Sphere;
    /// Its subobjects.
    fn pieces(&self, object: u32) -> Range<u32>;
    /// Encloses the subobject, world.
    fn piece_ball(&self, piece: u32) -> Sphere;
    /// What there is to draw of it.
    fn content(&self, object: u32) -> Content;
}

/// What drawing an object takes, as far as the database knows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Content {
    /// Vertices of all subobjects.
    pub vertices: u32,
    /// Triangles of all subobjects.
    pub triangles: u32,
    /// What one sees of their boxes, from all sides on the average, m²: a box's surface is four times that.
    pub area: f32,
    /// That of subobjects with a picture, m².
    pub textured: f32,
    /// That of subobjects that light passes through, m².
    pub translucent: f32,
}

/// Where a block's balls are: `origin + unit · offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// World.
    pub origin: DVec3,
    /// A power of two, m.
    pub unit: f64,
}

/// The balls of a block's objects, on its grid: one array per number, by slot. Those of objects that the last block doesn't have are 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct ObjectBalls {
    /// Offset of the centre, units.
    pub x: Lane,
    /// Offset of the centre, units.
    pub y: Lane,
    /// Offset of the centre, units.
    pub z: Lane,
    /// Radius, units.
    pub radius: Lane,
}

/// A number of each object of a block.
pub type Lane = [f32; BLOCK];

/// The balls of a block's subobjects, on its grid, and their numbers: one array each, by place, counted from the block's first.
#[derive(Clone, Copy, Debug)]
pub struct PieceBalls<'a> {
    /// Offset of the centre, units, as bits of an f32.
    pub x: &'a [u32],
    /// Offset of the centre, units, as bits of an f32.
    pub y: &'a [u32],
    /// Offset of the centre, units, as bits of an f32.
    pub z: &'a [u32],
    /// Radius, units, as bits of an f32.
    pub radius: &'a [u32],
    /// The subobjects' numbers.
    pub ids: &'a [u32],
}

/// Numbers that are kept of a subobject.
const PIECE_WORDS: usize = 5;

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    /// Tells this database from all others of this process.
    serial: u64,
    /// Its items are objects by slot; leaf k is block k.
    pub tree: Bvh,
    /// By branch: the smallest and the largest radius of its objects, m, rounded outwards.
    pub sizes: Vec<[f32; 2]>,
    /// By block.
    pub grids: Vec<Grid>,
    /// By block.
    pub objects: Vec<ObjectBalls>,
    /// By slot, and one more: where the object's subobjects begin.
    pub first: Vec<u32>,
    /// Of subobjects, whose places are those of slot 0, then those of slot 1 …: block by block, in a block number by number, so that a block is one
    /// stretch of memory.
    pieces: Vec<u32>,
    /// By object.
    slots: Vec<u32>,
    /// By slot.
    content: Vec<Content>,
}

/// `x`, rounded up.
fn up(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}

/// What a distance is multiplied by so that rounding can't have made it too short.
const GROW: f64 = 1.0 + 8.0 * f64::EPSILON;

/// A distance that is at least that of two points, rounding included.
fn apart(a: DVec3, b: DVec3) -> f64 {
    a.distance(b) * GROW + 2.0 * f64::EPSILON * (a.abs().max_element() + b.abs().max_element())
}

impl Grid {
    /// A grid for these balls.
    fn around(balls: impl Iterator<Item = Sphere> + Clone) -> Self {
        let (low, high) = balls.clone().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), ball| {
            (low.min(ball.centre), high.max(ball.centre))
        });
        let origin = low + (high - low) * 0.5;
        // What rounding costs at the origin's distance must be a small number on the grid, even if all there is is a point.
        let least = (origin.abs().max_element() * f64::from(f32::EPSILON) * f64::from(f32::EPSILON)).max(1e-300);
        let reach =
            balls.fold(least, |reach, ball| reach.max((ball.centre - origin).abs().max_element()).max(ball.radius));
        // The next power of two: one more in the exponent, nothing in the mantissa.
        Self { origin, unit: f64::from_bits(((reach.to_bits() >> 52) + 1) << 52) }
    }

    /// The ball of these numbers.
    pub fn ball(&self, [x, y, z, radius]: [f32; 4]) -> Sphere {
        let offset = DVec3::new(f64::from(x), f64::from(y), f64::from(z));
        Sphere { centre: self.origin + offset * self.unit, radius: f64::from(radius) * self.unit }
    }

    /// Numbers of a ball that encloses this one, and the balls of `within`, which are on the grid already.
    fn put(&self, ball: Sphere, within: impl Iterator<Item = Sphere>) -> [f32; 4] {
        let offset = (ball.centre - self.origin) / self.unit;
        let [x, y, z] = [offset.x as f32, offset.y as f32, offset.z as f32];
        let centre = self.ball([x, y, z, 0.0]).centre;
        let radius = within.fold(ball.radius.max(0.0) + apart(centre, ball.centre), |radius, inner| {
            radius.max(apart(centre, inner.centre) + inner.radius)
        });
        [x, y, z, up(radius * GROW / self.unit)]
    }
}

fn bytes_of<T>(list: &Vec<T>) -> usize {
    list.capacity() * size_of::<T>()
}

impl Blocks {
    /// The database of `bodies`, its tree cut at `cut`.
    pub fn build(bodies: &impl Bodies, cut: Cut) -> Self {
        static SERIAL: AtomicU64 = AtomicU64::new(1);
        let count = bodies.count();
        let filled = |object| {
            let ball = bodies.ball(object);
            Sphere { radius: ball.radius.max(0.0), ..ball }
        };
        let mut tree = Bvh::in_blocks(count, BLOCK, cut, &filled);
        for block in tree.items.chunks_mut(BLOCK) {
            block.sort_unstable_by(|&a, &b| filled(b).radius.total_cmp(&filled(a).radius).then(a.cmp(&b)));
        }
        let pieces_all = count.checked_sub(1).map_or(0, |last| bodies.pieces(last as u32).end as usize);
        let mut blocks = Self {
            serial: SERIAL.fetch_add(1, Ordering::Relaxed),
            sizes: Vec::new(),
            grids: Vec::with_capacity(count.div_ceil(BLOCK)),
            objects: Vec::with_capacity(count.div_ceil(BLOCK)),
            first: Vec::with_capacity(count + 1),
            pieces: Vec::with_capacity(pieces_all * PIECE_WORDS),
            slots: vec![0; count],
            content: Vec::with_capacity(count),
            tree,
        };
        blocks.first.push(0);
        let mut columns: [Vec<u32>; PIECE_WORDS] = Default::default();
        for block in blocks.tree.items.chunks(BLOCK) {
            let balls = || block.iter().map(|&object| filled(object));
            let pieces = block.iter().flat_map(|&object| bodies.pieces(object)).map(|piece| bodies.piece_ball(piece));
            let grid = Grid::around(balls().chain(pieces));
            blocks.grids.push(grid);
            let mut own = ObjectBalls { x: [0.0; BLOCK], y: [0.0; BLOCK], z: [0.0; BLOCK], radius: [0.0; BLOCK] };
            columns.iter_mut().for_each(Vec::clear);
            for (k, &object) in block.iter().enumerate() {
                blocks.slots[object as usize] = blocks.content.len() as u32;
                blocks.content.push(bodies.content(object));
                let from = columns[0].len();
                for piece in bodies.pieces(object) {
                    let ball = grid.put(bodies.piece_ball(piece), std::iter::empty());
                    for (column, bits) in columns.iter_mut().zip(ball.map(f32::to_bits).into_iter().chain([piece])) {
                        column.push(bits);
                    }
                }
                let at = |place: usize| std::array::from_fn(|number| f32::from_bits(columns[number][place]));
                let within = (from..columns[0].len()).map(|place| grid.ball(at(place)));
                [own.x[k], own.y[k], own.z[k], own.radius[k]] = grid.put(filled(object), within);
                let first = blocks.pieces.len() / PIECE_WORDS + columns[0].len();
                blocks.first.push(first as u32);
            }
            blocks.objects.push(own);
            columns.iter().for_each(|column| blocks.pieces.extend_from_slice(column));
        }
        blocks.bound_branches(filled);
        blocks
    }

    /// Widens the branches by what rounding added to their objects, and finds the sizes of those.
    fn bound_branches(&mut self, exact: impl Fn(u32) -> Sphere) {
        let mut branches = std::mem::take(&mut self.tree.branches);
        self.sizes = vec![[f32::INFINITY, 0.0]; branches.len()];
        // By branch: by how much a kept ball may reach beyond what it stands for, m.
        let mut beyond = vec![0.0f64; branches.len()];
        for index in (0..branches.len()).rev() {
            let mut size = [f32::INFINITY, 0.0f32];
            if branches[index].is_leaf(index) {
                for slot in branches[index].range() {
                    let (kept, exact) = (self.ball(slot), exact(self.object(slot)));
                    size = [size[0].min(-up(-kept.radius)), size[1].max(up(kept.radius))];
                    beyond[index] = beyond[index].max(apart(kept.centre, exact.centre) + kept.radius - exact.radius);
                }
            } else {
                for child in [index + 1, branches[index + 1].next as usize] {
                    let of_child: [f32; 2] = self.sizes[child];
                    size = [size[0].min(of_child[0]), size[1].max(of_child[1])];
                    beyond[index] = beyond[index].max(beyond[child]);
                }
            }
            let radius = &mut branches[index].ball.radius;
            *radius = (*radius + beyond[index]) * GROW;
            self.sizes[index] = size;
        }
        self.tree.branches = branches;
    }

    /// Tells this database from all others of this process.
    pub fn serial(&self) -> u64 {
        self.serial
    }

    /// Number of objects, and of slots.
    pub fn count(&self) -> usize {
        self.slots.len()
    }

    /// Number of blocks.
    pub fn block_count(&self) -> usize {
        self.grids.len()
    }

    /// The slots of a block.
    pub fn slots_of(&self, block: usize) -> Range<usize> {
        block * BLOCK..self.count().min((block + 1) * BLOCK)
    }

    /// Where an object is kept.
    pub fn slot(&self, object: u32) -> usize {
        self.slots[object as usize] as usize
    }

    /// Who is kept there.
    pub fn object(&self, slot: usize) -> u32 {
        self.tree.items[slot]
    }

    /// The ball of the object in a slot, world.
    pub fn ball(&self, slot: usize) -> Sphere {
        let (balls, k) = (&self.objects[slot / BLOCK], slot % BLOCK);
        self.grids[slot / BLOCK].ball([balls.x[k], balls.y[k], balls.z[k], balls.radius[k]])
    }

    /// The places of the subobjects of the object in a slot.
    pub fn places(&self, slot: usize) -> Range<usize> {
        self.first[slot] as usize..self.first[slot + 1] as usize
    }

    /// The ball of a subobject, world, given its object's slot and its place.
    pub fn piece_ball(&self, slot: usize, place: usize) -> Sphere {
        let (balls, k) = self.piece(slot, place);
        let [x, y, z, radius] = [balls.x, balls.y, balls.z, balls.radius].map(|column| f32::from_bits(column[k]));
        self.grids[slot / BLOCK].ball([x, y, z, radius])
    }

    /// The number of a subobject, given its object's slot and its place.
    pub fn id(&self, slot: usize, place: usize) -> u32 {
        let (balls, k) = self.piece(slot, place);
        balls.ids[k]
    }

    fn piece(&self, slot: usize, place: usize) -> (PieceBalls<'_>, usize) {
        let block = slot / BLOCK;
        (self.pieces_of(block), place - self.first[block * BLOCK] as usize)
    }

    /// The subobjects of a block.
    pub fn pieces_of(&self, block: usize) -> PieceBalls<'_> {
        let slots = self.slots_of(block);
        let (from, to) = (self.first[slots.start] as usize, self.first[slots.end] as usize);
        let words = &self.pieces[from * PIECE_WORDS..to * PIECE_WORDS];
        let column = |number: usize| &words[number * (to - from)..(number + 1) * (to - from)];
        PieceBalls { x: column(0), y: column(1), z: column(2), radius: column(3), ids: column(4) }
    }

    /// Number of subobjects.
    pub fn piece_count(&self) -> usize {
        self.pieces.len() / PIECE_WORDS
    }

    /// What there is to draw of the object in a slot.
    pub fn content(&self, slot: usize) -> Content {
        self.content[slot]
    }

    /// Whose subobject it is. Order log n.
    pub fn object_of(&self, piece: u32) -> u32 {
        let (mut low, mut high) = (0, self.slots.len());
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            if self.begin(middle) <= piece { low = middle } else { high = middle }
        }
        low as u32
    }

    /// The number of an object's first subobject.
    fn begin(&self, object: usize) -> u32 {
        let slot = self.slots[object] as usize;
        self.id(slot, self.first[slot] as usize)
    }

    /// Memory, bytes.
    pub fn bytes(&self) -> usize {
        let tree = bytes_of(&self.tree.branches) + bytes_of(&self.tree.items) + bytes_of(&self.sizes);
        let slots = bytes_of(&self.grids) + bytes_of(&self.slots) + bytes_of(&self.first) + bytes_of(&self.content);
        tree + slots + bytes_of(&self.objects) + bytes_of(&self.pieces)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Two subobjects an object, in it.
    struct Two(Vec<Sphere>);

    impl Bodies for Two {
        fn count(&self) -> usize {
            self.0.len()
        }
        fn ball(&self, object: u32) -> Sphere {
            self.0[object as usize]
        }
        fn pieces(&self, object: u32) -> Range<u32> {
            object * 2..object * 2 + 2
        }
        fn piece_ball(&self, piece: u32) -> Sphere {
            let Sphere { centre, radius } = self.0[piece as usize / 2];
            let by = radius * (f64::from(piece % 2) - 0.5);
            Sphere { centre: centre + DVec3::X * by, radius: radius * 0.5 }
        }
        fn content(&self, object: u32) -> Content {
            Content { vertices: object, ..Content::default() }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]
        #[test]
        fn kept_balls_enclose_what_they_stand_for_and_branches_enclose_them(
            scale in prop_oneof![Just(1e-3), Just(1.0), Just(1e7), Just(1e39)],
            far in prop_oneof![Just(0.0), Just(1.0), Just(1e9)],
            balls in prop::collection::vec((-1e2..1e2, -1e2..1e2, -1e2..1e2, prop_oneof![Just(0.0), 0.0..50.0]), 1..400),
            eighth in any::<bool>(),
        ) {
            let balls = balls.into_iter().map(|(x, y, z, radius)| Sphere {
                centre: (DVec3::new(x, y, z) + far) * scale, radius: radius * scale,
            });
            let bodies = Two(balls.collect());
            let blocks = Blocks::build(&bodies, if eighth { Cut::Eighth } else { Cut::Middle });
            prop_assert_eq!(blocks.count(), bodies.count());
            let encloses = |outer: Sphere, inner: Sphere| {
                outer.centre.distance(inner.centre) + inner.radius <= outer.radius * (1.0 + 1e-15) + 1e-15 * outer.centre.length()
            };
            for (object, &exact) in (0..).zip(&bodies.0) {
                let slot = blocks.slot(object);
                let kept = blocks.ball(slot);
                prop_assert_eq!(blocks.object(slot), object);
                prop_assert_eq!(blocks.content(slot).vertices, object);
                prop_assert!(encloses(kept, exact), "{:?} in {:?}", exact, kept);
                let grid = blocks.grids[slot / BLOCK];
                let lost = kept.radius - exact.radius;
                prop_assert!(lost <= 1e-6 * grid.unit + 1e-14 * grid.origin.length(), "lost {}", lost);
                for (place, piece) in blocks.places(slot).zip(bodies.pieces(object)) {
                    prop_assert_eq!(blocks.id(slot, place), piece);
                    prop_assert_eq!(blocks.object_of(piece), object);
                    let own = blocks.piece_ball(slot, place);
                    prop_assert!(encloses(own, bodies.piece_ball(piece)) && encloses(kept, own));
                }
            }
            for (index, branch) in blocks.tree.branches.iter().enumerate() {
                for slot in branch.range() {
                    let kept = blocks.ball(slot);
                    prop_assert!(encloses(branch.ball, kept));
                    let [least, most] = blocks.sizes[index].map(f64::from);
                    prop_assert!(least <= kept.radius && kept.radius <= most);
                }
            }
            for block in 0..blocks.block_count() {
                let radii = &blocks.objects[block].radius[..blocks.slots_of(block).len()];
                prop_assert!(radii.windows(2).all(|pair| pair[0] * (1.0 + 1e-5) + 1e-5 >= pair[1]), "the largest first");
            }
        }
    }

    #[test]
    fn nothing_is_a_database_too() {
        let blocks = Blocks::build(&Two(Vec::new()), Cut::Middle);
        assert_eq!((blocks.count(), blocks.block_count(), blocks.piece_count()), (0, 0, 0));
    }
}
