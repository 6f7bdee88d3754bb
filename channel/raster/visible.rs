//! The visible faces of a tile: the visibility buffer.
//!
//! A pixel has nothing, or one face at all samples (most pixels), or a short list of (face, samples) whose sample masks
//! don't overlap. Exact depths are not kept: they are the faces' planes, asked for when two faces meet. What is kept is an upper
//! and a lower bound of the inverse distance that a pixel sees, so that most meetings need no plane: a face wholly behind
//! the bounds is dropped and one wholly before them wins, 16 pixels at a time. The least lower bound of a block is how far
//! one can see in it, and hides triangles before any pixel is looked at.
//!
//! So a pixel inside a face costs the same at 1 and at 64 samples, and a pixel on an edge costs what its faces cost, not its
//! samples. The list of a pixel is never longer than its samples, however many triangles crowd there.
//!
//! Faces are named by their place in the tile's list of triangles; see [`super::opaque`].

use super::coverage::{BLOCK_PIXELS, BLOCKS, RowPairs, TILE_PIXELS};
use crate::room::room;
use crate::simd::each4;
use fearless_simd::{Simd, f32x16, mask32x16, prelude::*, u32x16};

/// A cell that sees nothing.
pub const NOTHING: u32 = u32::MAX;
/// This bit set: the rest is the index of a list's first entry; else the cell is a face seen by all samples.
const LIST: u32 = 1 << 31;
/// Ends a list.
const END: u32 = u32::MAX;

const _: () = assert!(BLOCKS <= 64, "a block is a bit of a u64");

/// Length of what has a number per block, for vectors of 16.
const BLOCKS_PADDED: usize = BLOCKS.next_multiple_of(16);

/// How far one can see in the blocks of an empty tile.
const NOTHING_SEEN: [f32; BLOCKS_PADDED] = {
    let mut far = [f32::INFINITY; BLOCKS_PADDED];
    let mut block = 0;
    while block < BLOCKS {
        far[block] = f32::NEG_INFINITY;
        block += 1;
    }
    far
};

/// Triangles from one look at the whole tile to the next. A guess: looking costs about as much as drawing a small one.
const RENEWED_EVERY: u32 = 4;

/// Most triangles of a tile: numbers must leave the bit that marks a list alone.
pub const TILE_TRIANGLES_MAX: usize = (LIST - 1) as usize;

/// A face and the samples that see it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// The triangle's place in the tile's list.
    pub triangle: u32,
    /// The samples.
    pub mask: u64,
    /// Where the face is shaded in the pixel: number of a sample, or [`CENTRE`].
    pub point: u8,
}

/// The pixel's centre, in place of a sample's number.
pub const CENTRE: u8 = 64;

#[derive(Clone, Copy, Debug)]
struct Entry {
    seen: Seen,
    /// Lower bound of its q over the pixel.
    low: f32,
    next: u32,
}

/// A face on its way into a pixel.
#[derive(Clone, Copy, Debug)]
pub struct Arriving {
    /// The triangle's place in the tile's list.
    pub triangle: u32,
    /// Bounds of its q over the pixel's samples.
    pub low: f32,
    /// See `low`.
    pub high: f32,
    /// See [`Seen::point`].
    pub point: u8,
}

/// Of a block's pixels: how a face's bounds lie to those of what they see. Neither: it isn't known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Depths {
    /// The face is in front at all samples.
    pub front: u64,
    /// It is behind at all samples.
    pub behind: u64,
}

/// A tile's visible faces. Reused from tile to tile.
#[derive(Debug)]
pub struct Visible {
    cells: Box<[u32; TILE_PIXELS]>,
    /// No sample that sees anything sees a smaller q; −∞ while some sample sees nothing.
    lows: Box<[f32; TILE_PIXELS]>,
    /// No sample sees a larger q; −∞ where nothing is seen.
    highs: Box<[f32; TILE_PIXELS]>,
    entries: Vec<Entry>,
    /// First of the entries that lists gave back.
    free: u32,
    /// The mask of all samples.
    full: u64,
    /// Per block: the least of its lows, as of when it was last asked for. What is no block is infinite.
    far: [f32; BLOCKS_PADDED],
    /// The least of these.
    tile_far: f32,
    /// A bit per block: its pixels changed since.
    changed: u64,
    /// A bit per block: nothing was ever put into it.
    fresh: u64,
    /// Whether `tile_far` may have grown.
    is_old: bool,
    /// How often the tile was asked.
    questions: u32,
}

room!(Visible: entries; cells, lows, highs, free, full, far, tile_far, changed, fresh, is_old, questions);

impl Visible {
    /// An empty tile.
    pub fn new() -> Self {
        Self {
            cells: Box::new([NOTHING; TILE_PIXELS]),
            lows: Box::new([f32::NEG_INFINITY; TILE_PIXELS]),
            highs: Box::new([f32::NEG_INFINITY; TILE_PIXELS]),
            entries: Vec::new(),
            free: END,
            full: 1,
            far: NOTHING_SEEN,
            tile_far: f32::NEG_INFINITY,
            changed: 0,
            fresh: u64::MAX,
            is_old: false,
            questions: 0,
        }
    }

    /// Forgets everything; `full` is the mask of all samples from now on.
    pub fn clear(&mut self, full: u64) {
        self.cells.fill(NOTHING);
        self.lows.fill(f32::NEG_INFINITY);
        self.highs.fill(f32::NEG_INFINITY);
        self.entries.clear();
        self.free = END;
        self.full = full;
        self.far = NOTHING_SEEN;
        self.tile_far = f32::NEG_INFINITY;
        self.changed = 0;
        self.fresh = u64::MAX;
        self.is_old = false;
    }

    /// The cells of a block: [`NOTHING`], a face that all samples see (see [`Visible::single`]), or a list.
    #[inline(always)]
    pub fn block(&self, block: usize) -> &[u32; BLOCK_PIXELS] {
        self.cells[block * BLOCK_PIXELS..][..BLOCK_PIXELS].try_into().expect("64 pixels")
    }

    /// The face that all samples of a pixel see, if they do.
    #[inline(always)]
    pub fn single(cell: u32) -> Option<u32> {
        (cell & LIST == 0).then_some(cell)
    }

    /// What the samples of a pixel see; samples in no mask see the background.
    #[inline(always)]
    pub fn seen(&self, pixel: usize) -> impl Iterator<Item = Seen> + '_ {
        let cell = self.cells[pixel];
        let single = (cell & LIST == 0).then_some(Seen { triangle: cell, mask: self.full, point: CENTRE });
        let mut at = if single.is_some() || cell == NOTHING { END } else { cell & !LIST };
        single.into_iter().chain(std::iter::from_fn(move || {
            let entry = (at != END).then(|| self.entries[at as usize])?;
            at = entry.next;
            Some(entry.seen)
        }))
    }

    /// How far one can see in a block: all samples see something with at least this q.
    #[inline(always)]
    pub fn far<S: Simd>(&mut self, simd: S, block: usize) -> f32 {
        if self.changed >> block & 1 != 0 {
            self.look(simd, block);
        }
        self.far[block]
    }

    /// The same for all of the tile. It only ever grows, so that an old value is true as well: it is renewed at every so many
    /// questions.
    #[inline(always)]
    pub fn tile_far<S: Simd>(&mut self, simd: S) -> f32 {
        self.questions += 1;
        if self.is_old && self.questions.is_multiple_of(RENEWED_EVERY) {
            self.is_old = false;
            let mut rest = self.changed;
            while rest != 0 {
                self.look(simd, rest.trailing_zeros() as usize);
                rest &= rest - 1;
            }
            let mut least = f32x16::splat(simd, f32::INFINITY);
            for sixteen in self.far.chunks_exact(16) {
                least = least.min(f32x16::from_slice(simd, sixteen));
            }
            self.tile_far = least.reduce_min();
        }
        self.tile_far
    }

    #[inline(always)]
    fn look<S: Simd>(&mut self, simd: S, block: usize) {
        let lows = &self.lows[block * BLOCK_PIXELS..][..BLOCK_PIXELS];
        let [a, b, c, d] = each4([0, 16, 32, 48], |at| f32x16::from_slice(simd, &lows[at..at + 16]));
        // No bound is NaN: one is only entered where it compared as larger than another.
        self.far[block] = a.min(b).min(c.min(d)).reduce_min();
        self.changed &= !(1 << block);
    }

    /// How a face with these bounds at a block's first pixel, and these gains from there, lies to what is there; not known in other
    /// rows than `rows`.
    #[inline(always)]
    pub fn compare<S: Simd>(
        &self,
        simd: S,
        block: usize,
        rows: RowPairs,
        [low, high]: [f32; 2],
        gains: &[f32x16<S>; 4],
    ) -> Depths {
        if self.fresh >> block & 1 != 0 {
            // In front of nothing is what has bounds at all.
            // Not a closure: it would be a function without the level's instructions.
            let [a, b, c, d] = *gains;
            let none = f32::NEG_INFINITY;
            let are_bounds = ((a + low).simd_gt(none) & (b + low).simd_gt(none))
                & ((c + low).simd_gt(none) & (d + low).simd_gt(none));
            let front = if are_bounds.all_true() { u64::MAX } else { 0 };
            return Depths { front, behind: 0 };
        }
        let mut depths = Depths::default();
        for (group, gain) in gains.iter().enumerate().take(rows.last + 1).skip(rows.first) {
            let at = block * BLOCK_PIXELS + group * 16;
            let lows = f32x16::from_slice(simd, &self.lows[at..at + 16]);
            let highs = f32x16::from_slice(simd, &self.highs[at..at + 16]);
            // NaN compares as neither.
            depths.front |= (*gain + low).simd_gt(highs).to_bitmask() << (group * 16);
            depths.behind |= (*gain + high).simd_lt(lows).to_bitmask() << (group * 16);
        }
        depths
    }

    /// All samples of the block's pixels `mask` see the face from now on; it is in front of what was there.
    #[inline(always)]
    pub fn fill<S: Simd>(
        &mut self,
        simd: S,
        block: usize,
        mask: u64,
        triangle: u32,
        [low, high]: [f32; 2],
        gains: &[f32x16<S>; 4],
        least_gain: f32,
    ) {
        self.is_old = true;
        self.fresh &= !(1 << block);
        let least = low + least_gain;
        if mask == u64::MAX && least > f32::NEG_INFINITY {
            // Rounded otherwise than the sums below may be, by less than the bounds have to spare.
            self.far[block] = least;
            self.changed &= !(1 << block);
        } else {
            self.changed |= 1 << block;
        }
        for (group, gain) in gains.iter().enumerate() {
            let bits = mask >> (group * 16) & 0xffff;
            let at = block * BLOCK_PIXELS + group * 16;
            if bits == 0 {
                continue;
            }
            let (lows, highs) = (*gain + low, *gain + high);
            let numbers = u32x16::splat(simd, triangle);
            if bits == 0xffff {
                numbers.store_slice(&mut self.cells[at..at + 16]);
                lows.store_slice(&mut self.lows[at..at + 16]);
                highs.store_slice(&mut self.highs[at..at + 16]);
                continue;
            }
            let bits = mask32x16::from_bitmask(simd, bits);
            let cells = &mut self.cells[at..at + 16];
            bits.select(numbers, u32x16::from_slice(simd, cells)).store_slice(cells);
            let to = &mut self.lows[at..at + 16];
            bits.select(lows, f32x16::from_slice(simd, to)).store_slice(to);
            let to = &mut self.highs[at..at + 16];
            bits.select(highs, f32x16::from_slice(simd, to)).store_slice(to);
        }
    }

    /// The samples of `mask` at which a face is not hidden by what was put before; `in_front(other, samples)` says at which of these samples it is in
    /// front of another face.
    #[inline(always)]
    pub fn unhidden(&self, pixel: usize, mut mask: u64, mut in_front: impl FnMut(u32, u64) -> u64) -> u64 {
        for seen in self.seen(pixel) {
            let both = seen.mask & mask;
            if both != 0 {
                mask &= !both | in_front(seen.triangle, both);
            }
        }
        mask
    }

    /// Puts a face that covers `mask` of a pixel's samples; `in_front` as in [`Visible::unhidden`].
    #[inline(always)]
    pub fn put(&mut self, pixel: usize, face: Arriving, mask: u64, mut in_front: impl FnMut(u32, u64) -> u64) {
        debug_assert!(mask != 0 && mask & !self.full == 0, "samples of the pattern");
        self.is_old = true;
        self.fresh &= !(1 << (pixel / BLOCK_PIXELS));
        let cell = self.cells[pixel];
        if cell == NOTHING {
            let whole = mask == self.full;
            self.cells[pixel] = if whole { face.triangle } else { self.entry(face, mask, END) };
            self.highs[pixel] = face.high;
            if whole {
                self.lows[pixel] = face.low;
                self.changed |= 1 << (pixel / BLOCK_PIXELS);
            }
        } else if cell & LIST == 0 {
            let won = in_front(cell, mask);
            if won == self.full {
                self.cells[pixel] = face.triangle;
                (self.lows[pixel], self.highs[pixel]) = (face.low, face.high);
                self.changed |= 1 << (pixel / BLOCK_PIXELS);
            } else if won != 0 {
                let (low, high) = (self.lows[pixel], self.highs[pixel]);
                // What all samples see covers the centre.
                let other = Arriving { triangle: cell, low, high, point: CENTRE };
                let other = self.entry(other, self.full & !won, END);
                self.cells[pixel] = self.entry(face, won, other & !LIST);
                self.widen(pixel, face);
            }
        } else {
            self.put_in_list(pixel, face, mask, in_front);
        }
    }

    /// A pixel that sees something at every sample sees a face as well.
    #[inline(always)]
    fn widen(&mut self, pixel: usize, face: Arriving) {
        if face.low < self.lows[pixel] {
            self.lows[pixel] = face.low;
            self.changed |= 1 << (pixel / BLOCK_PIXELS);
        }
        if face.high > self.highs[pixel] {
            self.highs[pixel] = face.high;
        }
    }

    #[inline(always)]
    fn put_in_list(&mut self, pixel: usize, face: Arriving, mask: u64, mut in_front: impl FnMut(u32, u64) -> u64) {
        let mut won = mask;
        let mut head = END;
        let mut at = self.cells[pixel] & !LIST;
        let mut covered = mask;
        let mut low = f32::INFINITY;
        while at != END {
            let Entry { seen, next, low: other_low } = self.entries[at as usize];
            let both = seen.mask & mask;
            let front = if both == 0 { 0 } else { in_front(seen.triangle, both) };
            won &= !both | front;
            covered |= seen.mask;
            let left = seen.mask & !front;
            if left == 0 {
                self.entries[at as usize].next = self.free;
                self.free = at;
            } else {
                self.entries[at as usize] = Entry { seen: Seen { mask: left, ..seen }, low: other_low, next: head };
                low = if other_low < low { other_low } else { low };
                head = at;
            }
            at = next;
        }
        if won == self.full {
            self.cells[pixel] = face.triangle;
            (self.lows[pixel], self.highs[pixel]) = (face.low, face.high);
            self.changed |= 1 << (pixel / BLOCK_PIXELS);
            return;
        }
        if won == 0 {
            self.cells[pixel] = head | LIST;
            return;
        }
        self.cells[pixel] = self.entry(face, won, head);
        if face.high > self.highs[pixel] {
            self.highs[pixel] = face.high;
        }
        if covered == self.full {
            self.lows[pixel] = if face.low < low { face.low } else { low };
            self.changed |= 1 << (pixel / BLOCK_PIXELS);
        }
    }

    /// A list's new head, as a cell.
    #[inline(always)]
    fn entry(&mut self, face: Arriving, mask: u64, next: u32) -> u32 {
        let seen = Seen { triangle: face.triangle, mask, point: face.point };
        let entry = Entry { seen, low: face.low, next };
        if self.free == END {
            self.entries.push(entry);
            (self.entries.len() as u32 - 1) | LIST
        } else {
            let at = self.free;
            self.free = self.entries[at as usize].next;
            self.entries[at as usize] = entry;
            at | LIST
        }
    }
}

impl Default for Visible {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The twin: an array of (number, nearness) per sample.
        #[test]
        fn a_pixel_sees_what_an_array_of_samples_sees(
            faces in prop::collection::vec((any::<u64>(), 0u8..4, 0u8..5), 0..100),
        ) {
            let mut visible = Visible::new();
            visible.clear(u64::MAX);
            // Nearness differs between the two halves of the pixel, ties go to the later number.
            let nearness = |n: u32, sample: u32| u32::from(faces[n as usize].1) * 8 + (n * 7 + sample / 32) % 8;
            let front = |a: u32, b: u32, mask: u64| (0..64).filter(|s| mask >> s & 1 != 0)
                .filter(|s| (nearness(a, *s), a) > (nearness(b, *s), b)).fold(0, |m, s| m | 1u64 << s);
            let mut samples = [None; 64];
            for (n, (mask, _, kind)) in faces.iter().enumerate() {
                let mask = if *kind == 0 { u64::MAX } else { *mask };
                let n = n as u32;
                if mask == 0 { continue }
                let bounds = [nearness(n, 0), nearness(n, 63)].map(|q| q as f32);
                let (low, high) = (bounds[0].min(bounds[1]), bounds[0].max(bounds[1]));
                let unhidden = visible.unhidden(5, mask, |other, both| front(n, other, both));
                visible.put(5, Arriving { triangle: n, low, high, point: CENTRE }, mask, |other, both| front(n, other, both));
                let mut won = 0;
                for (s, sample) in samples.iter_mut().enumerate().filter(|(s, _)| mask >> s & 1 != 0) {
                    let s = s as u32;
                    if sample.is_none_or(|other| (nearness(n, s), n) > (nearness(other, s), other)) {
                        *sample = Some(n);
                        won |= 1 << s;
                    }
                }
                prop_assert_eq!(unhidden, won);
                let seen = || samples.iter().enumerate().filter_map(|(s, n)| n.map(|n| nearness(n, s as u32) as f32));
                prop_assert!(seen().all(|q| q <= visible.highs[5]));
                if visible.lows[5] > f32::NEG_INFINITY {
                    prop_assert!(samples.iter().all(Option::is_some) && seen().all(|q| q >= visible.lows[5]));
                }
            }
            let mut found = [None; 64];
            for seen in visible.seen(5) {
                for s in (0..64).filter(|s| seen.mask >> s & 1 != 0) {
                    prop_assert_eq!(found[s], None);
                    found[s] = Some(seen.triangle);
                }
            }
            prop_assert_eq!(found, samples);
            prop_assert!(visible.entries.len() <= 66, "{} entries for 64 samples", visible.entries.len());
        }
    }
}
