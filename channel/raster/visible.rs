//! The visible faces of a tile: the visibility buffer.
//!
//! A pixel has nothing, or one face at all samples (most pixels), or a short list of (face, samples) whose sample masks
//! don't overlap. No depths are kept: they are the faces' planes, asked for when two faces meet. So a pixel inside a
//! face costs the same at 1 and at 64 samples, and a pixel on an edge costs what its faces cost, not its samples. The
//! list of a pixel is never longer than its samples, however many triangles crowd there.

use super::coverage::TILE_PIXELS;

/// A cell that sees nothing.
const NOTHING: u32 = u32::MAX;
/// This bit set: the rest is the index of a list's first entry; else the cell is a face seen by all samples.
const LIST: u32 = 1 << 31;
/// Ends a list.
const END: u32 = u32::MAX;

/// Most triangles of a frame: numbers must leave the bit that marks a list alone.
pub const TRIANGLES_MAX: usize = (LIST - 1) as usize;

/// A face and the samples that see it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Number of the triangle.
    pub triangle: u32,
    /// The samples.
    pub mask: u64,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    seen: Seen,
    next: u32,
}

/// A tile's visible faces. Reused from tile to tile.
#[derive(Debug)]
pub struct Visible {
    cells: Vec<u32>,
    entries: Vec<Entry>,
    /// First of the entries that lists gave back.
    free: u32,
    /// The mask of all samples.
    full: u64,
}

impl Visible {
    /// An empty tile.
    pub fn new() -> Self {
        Self { cells: vec![NOTHING; TILE_PIXELS], entries: Vec::new(), free: END, full: 1 }
    }

    /// Forgets everything; `full` is the mask of all samples from now on.
    pub fn clear(&mut self, full: u64) {
        self.cells.fill(NOTHING);
        self.entries.clear();
        self.free = END;
        self.full = full;
    }

    /// The face that all samples of a pixel see, if they do.
    #[inline]
    pub fn single(&self, pixel: usize) -> Option<u32> {
        let cell = self.cells[pixel];
        (cell & LIST == 0).then_some(cell)
    }

    /// Whether no sample sees anything.
    #[inline]
    pub fn is_empty(&self, pixel: usize) -> bool {
        self.cells[pixel] == NOTHING
    }

    /// What the samples of a pixel see; samples in no mask see the background.
    #[inline]
    pub fn seen(&self, pixel: usize) -> impl Iterator<Item = Seen> + '_ {
        let cell = self.cells[pixel];
        let single = (cell & LIST == 0).then_some(Seen { triangle: cell, mask: self.full });
        let mut at = if single.is_some() || cell == NOTHING { END } else { cell & !LIST };
        single.into_iter().chain(std::iter::from_fn(move || {
            let entry = (at != END).then(|| self.entries[at as usize])?;
            at = entry.next;
            Some(entry.seen)
        }))
    }

    /// All samples of an empty pixel, or of one whose faces lost everywhere, see `triangle`.
    #[inline]
    pub fn put_single(&mut self, pixel: usize, triangle: u32) {
        self.cells[pixel] = triangle;
    }

    /// The samples of `mask` at which a face is not hidden by what was put before; `in_front(other, samples)` says at which of these samples it is in
    /// front of another face.
    #[inline]
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
    #[inline]
    pub fn put(&mut self, pixel: usize, triangle: u32, mask: u64, mut in_front: impl FnMut(u32, u64) -> u64) {
        let cell = self.cells[pixel];
        if cell == NOTHING {
            self.cells[pixel] = if mask == self.full { triangle } else { self.entry(triangle, mask, END) };
        } else if cell & LIST == 0 {
            let won = in_front(cell, mask);
            if won == self.full {
                self.cells[pixel] = triangle;
            } else if won != 0 {
                let other = self.entry(cell, self.full & !won, END);
                self.cells[pixel] = self.entry(triangle, won, other & !LIST);
            }
        } else {
            self.put_in_list(pixel, triangle, mask, in_front);
        }
    }

    fn put_in_list(&mut self, pixel: usize, triangle: u32, mask: u64, mut in_front: impl FnMut(u32, u64) -> u64) {
        let mut won = mask;
        let mut head = END;
        let mut at = self.cells[pixel] & !LIST;
        while at != END {
            let Entry { seen, next } = self.entries[at as usize];
            let both = seen.mask & mask;
            let front = if both == 0 { 0 } else { in_front(seen.triangle, both) };
            won &= !both | front;
            let left = seen.mask & !front;
            if left == 0 {
                self.entries[at as usize].next = self.free;
                self.free = at;
            } else {
                self.entries[at as usize] = Entry { seen: Seen { mask: left, ..seen }, next: head };
                head = at;
            }
            at = next;
        }
        self.cells[pixel] = if won == self.full {
            triangle
        } else if won != 0 {
            self.entry(triangle, won, head)
        } else {
            head | LIST
        };
    }

    /// A list's new head, as a cell.
    #[inline]
    fn entry(&mut self, triangle: u32, mask: u64, next: u32) -> u32 {
        let entry = Entry { seen: Seen { triangle, mask }, next };
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
            let nearness = |n: u32, sample: u32| (faces[n as usize].1, sample, n).0 as u32 * 8 + (n * 7 + sample / 32) % 8;
            let front = |a: u32, b: u32, mask: u64| (0..64).filter(|s| mask >> s & 1 != 0)
                .filter(|s| (nearness(a, *s), a) > (nearness(b, *s), b)).fold(0, |m, s| m | 1u64 << s);
            let mut samples = [None; 64];
            for (n, (mask, _, kind)) in faces.iter().enumerate() {
                let mask = if *kind == 0 { u64::MAX } else { *mask };
                let n = n as u32;
                if mask == 0 { continue }
                let unhidden = visible.unhidden(5, mask, |other, both| front(n, other, both));
                visible.put(5, n, mask, |other, both| front(n, other, both));
                let mut won = 0;
                for (s, sample) in samples.iter_mut().enumerate().filter(|(s, _)| mask >> s & 1 != 0) {
                    let s = s as u32;
                    if sample.is_none_or(|other| (nearness(n, s), n) > (nearness(other, s), other)) {
                        *sample = Some(n);
                        won |= 1 << s;
                    }
                }
                prop_assert_eq!(unhidden, won);
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
