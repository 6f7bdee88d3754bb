//! Stitching: tiles come in from boards in any order, pictures go out whole.
//!
//! A board sends only the tiles that differ from those it sent last, then says *done* for the frame. So tiles are kept
//! aside, by board, until the backplane swaps a frame to which they belong; then they are laid on the canvas in the order
//! of their frames. What is on the canvas is thus always the picture last shown: a view that is not complete at its swap
//! simply isn't touched, and repeats as a whole. A swap is carried out only when every board that it names is done with that
//! frame. When a newer swap can be carried out, older ones are passed over.
//!
//! When the backplane has lowered the resolution, boards send smaller views, and each of their pixels becomes a square on the canvas, which
//! keeps its size: what can't be shown whole still repeats as it was.
//!
//! A stitcher may show some of the rig's views only: it is then a display, whose picture is that part of the whole.
//!
//! A wiring begins with every board sending all of its tiles, so what was sent under an older wiring is dropped.

use bytes::Bytes;
use proto::codec::CodecError;
use proto::frame::{PixelFormat, TileIndex, tile_grid};
use proto::ids::{BoardKey, Epoch, FrameNumber, ViewId};
use proto::message::{Moment, Swap, split_tiles};
use proto::view::{View, ViewSetup};
use std::collections::{BTreeMap, VecDeque};

/// Swaps that may wait for tiles; beyond, the oldest is given up. Two seconds at 60 Hz: more means that a board's link is
/// far behind, and newest wins.
const SWAPS_MAX: usize = 120;

/// Tiles of one board that may wait for their swap, as a multiple of the canvas. Beyond, some board is not delivering, and the others' tiles
/// pile up. A start with many late frames needs three or four.
const WAITING_MAX: usize = 16;

/// How many of the canvas's pixels, each way, one of a board's may stand for.
const SCALES: [u32; 3] = [1, 2, 4];

/// Tiles of one message, not yet on the canvas.
#[derive(Clone, Debug)]
struct Run {
    frame: FrameNumber,
    epoch: Epoch,
    view: ViewId,
    /// Pixels of the canvas, each way, for one of these.
    scale: u32,
    tiles: Vec<TileIndex>,
    /// The pixels lie at the end of this payload, from `pixels_at` on.
    payload: Bytes,
    pixels_at: usize,
}

#[derive(Clone, Debug, Default)]
struct Inbox {
    runs: VecDeque<Run>,
    /// Bytes of the runs' payloads.
    bytes: usize,
    /// Frames of which all tiles are here; the newest at the end.
    done: VecDeque<(Epoch, FrameNumber)>,
}

/// A view's place on the canvas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Placed {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Placed {
    /// The size of a view of which each pixel stands for `scale` × `scale` of these.
    fn at_scale(&self, scale: u32) -> (u32, u32) {
        (self.width.div_ceil(scale), self.height.div_ceil(scale))
    }
}

/// A frame went onto the canvas.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shown {
    /// Which.
    pub frame: FrameNumber,
    /// Whether the console wants it.
    pub preview: bool,
    /// When it is to be shown; `None`: at once.
    pub moment: Option<Moment>,
    /// By view: whether it is new; else it repeats.
    pub complete: Vec<bool>,
    /// Number of tiles that changed.
    pub tiles: usize,
    /// Swaps that were passed over.
    pub skipped: usize,
}

/// See the module's head.
#[derive(Clone, Debug, Default)]
pub struct Stitcher {
    /// Which are shown; none: all.
    shown: Vec<ViewId>,
    /// By view; `None`: not shown here.
    views: Vec<Option<Placed>>,
    /// By view: whether it has ever been laid on this canvas as a whole.
    is_laid: Vec<bool>,
    width: u32,
    height: u32,
    format: PixelFormat,
    canvas: Vec<u8>,
    boards: BTreeMap<BoardKey, Inbox>,
    swaps: VecDeque<Swap>,
}

impl Stitcher {
    /// A stitcher that knows no views yet, for pixels of this format. It is to show these views; none: all.
    pub fn new(format: PixelFormat, shown: Vec<ViewId>) -> Self {
        Self { format, shown, ..Self::default() }
    }

    /// What its pixels are.
    pub fn format(&self) -> PixelFormat {
        self.format
    }

    /// The views that are shown, and where on the canvas the upper left pixel of each is.
    pub fn places(&self) -> impl Iterator<Item = (ViewId, [u32; 2])> {
        let placed = self.views.iter().enumerate();
        placed.filter_map(|(view, placed)| placed.map(|Placed { x, y, .. }| (ViewId(view as u32), [x, y])))
    }

    /// The views. A change of sizes or places clears the canvas. False, and nothing changes, when the picture would be too
    /// large.
    pub fn set_views(&mut self, views: &[ViewSetup]) -> bool {
        let Some((places, _)) = ViewSetup::layout(views) else { return false };
        let is_shown = |view: usize| self.shown.is_empty() || self.shown.iter().any(|shown| shown.0 as usize == view);
        let shown = || (0..views.len()).filter(|view| is_shown(*view));
        // What is shown of the rig's picture begins at its own corner.
        let [left, top] =
            [0, 1].map(|k| shown().map(|view| places[view][k]).min().filter(|_| !self.shown.is_empty()).unwrap_or(0));
        let place = |view: usize| {
            let (setup, [x, y]) = (&views[view], places[view]);
            let View { width, height, .. } = setup.view;
            // Those that aren't shown may lie on the other side of the corner.
            is_shown(view).then(|| Placed { x: x - left, y: y - top, width, height })
        };
        let placed: Vec<_> = (0..views.len()).map(place).collect();
        let end = |far: fn(&Placed) -> u32| placed.iter().flatten().map(far).max().unwrap_or(0);
        let (width, height) = (end(|placed| placed.x + placed.width), end(|placed| placed.y + placed.height));
        if placed != self.views {
            (self.width, self.height) = (width, height);
            self.canvas = vec![0; width as usize * height as usize * self.format.bytes()];
            self.is_laid = vec![false; placed.len()];
            self.views = placed;
            // Their tiles have the old sizes; boards send all anew when views change.
            for inbox in self.boards.values_mut() {
                inbox.runs.clear();
                inbox.bytes = 0;
            }
        }
        true
    }

    /// Width and height of the stitched picture, pixels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Whether the canvas shows a picture everywhere. Until each view has been complete once, it is black there.
    pub fn is_whole(&self) -> bool {
        self.is_laid.iter().all(|is_laid| *is_laid)
    }

    /// The stitched picture, row-major, tightly packed.
    pub fn canvas(&self) -> &[u8] {
        &self.canvas
    }

    /// By view that is shown here: the hashes of its tiles, row by row from the upper left.
    pub fn tile_hashes(&self) -> Vec<(ViewId, Vec<blake3::Hash>)> {
        let hash_of = |placed: &Placed, tile: TileIndex| {
            let (rect, bytes) = (tile.rect(placed.width, placed.height), self.format.bytes());
            let mut hasher = blake3::Hasher::new();
            for y in rect.y0..rect.y1 {
                let at = ((placed.y + y) as usize * self.width as usize + (placed.x + rect.x0) as usize) * bytes;
                hasher.update(&self.canvas[at..at + rect.width() as usize * bytes]);
            }
            hasher.finalize()
        };
        let of_view = |(view, placed): (usize, &Option<Placed>)| {
            let placed = placed.as_ref()?;
            let (columns, rows) = tile_grid(placed.width, placed.height);
            let tiles = (0..rows).flat_map(|y| (0..columns).map(move |x| TileIndex { x: x as u16, y: y as u16 }));
            Some((ViewId(view as u32), tiles.map(|tile| hash_of(placed, tile)).collect()))
        };
        self.views.iter().enumerate().filter_map(of_view).collect()
    }

    /// A board's link is up; whatever an earlier link of it brought is forgotten, for it sends all its tiles anew.
    pub fn on_board(&mut self, key: BoardKey) {
        self.boards.insert(key, Inbox::default());
    }

    /// A board's link is down. Returns the frames whose swap waits for it in vain.
    pub fn on_lost(&mut self, key: BoardKey) -> Vec<FrameNumber> {
        self.boards.remove(&key);
        let (lost, kept) = std::mem::take(&mut self.swaps).into_iter().partition(|swap| swap.boards.contains(&key));
        self.swaps = kept;
        let lost: VecDeque<Swap> = lost;
        lost.iter().map(|swap| swap.frame).collect()
    }

    /// Tiles from a board. `size` is the view's size as the board knows it.
    ///
    /// # Errors
    /// [`CodecError`] when the payload is malformed, or too many of the board's tiles wait: nothing is changed, and the board's
    /// link is best dropped, so that it begins anew.
    pub fn on_tiles(
        &mut self,
        key: BoardKey,
        frame: FrameNumber,
        epoch: Epoch,
        view: ViewId,
        count: u32,
        size: (u32, u32),
        format: PixelFormat,
        payload: Bytes,
    ) -> Result<(), CodecError> {
        let (tiles, pixels) = split_tiles(&payload, count, size, format)?;
        let placed = self.placed(view).filter(|_| format == self.format);
        let scale = placed.and_then(|placed| SCALES.into_iter().find(|scale| placed.at_scale(*scale) == size));
        // The view has changed meanwhile; the board sends all of it anew as it now is.
        let Some(scale) = scale else { return Ok(()) };
        let pixels_at = payload.len() - pixels.len();
        let limit = WAITING_MAX * self.canvas.len();
        if let Some(inbox) = self.boards.get_mut(&key) {
            let bytes = inbox.bytes + payload.len();
            if bytes > limit {
                let (value, limit) = (bytes as u64, limit as u64);
                return Err(CodecError::Limit { what: "bytes of tiles that wait for a swap", value, limit });
            }
            inbox.bytes = bytes;
            inbox.runs.push_back(Run { frame, epoch, view, scale, tiles, payload, pixels_at });
        }
        Ok(())
    }

    /// A board has sent all tiles of a frame.
    pub fn on_done(&mut self, key: BoardKey, frame: FrameNumber, epoch: Epoch) {
        if let Some(inbox) = self.boards.get_mut(&key) {
            if inbox.done.len() >= SWAPS_MAX {
                inbox.done.pop_front();
            }
            inbox.done.push_back((epoch, frame));
        }
    }

    /// The backplane swaps a frame.
    pub fn on_swap(&mut self, swap: Swap) {
        if self.swaps.len() >= SWAPS_MAX {
            self.swaps.pop_front();
        }
        self.swaps.push_back(swap);
    }

    /// Forgets the swaps that wait for tiles: whoever said them no longer leads.
    pub fn forget_swaps(&mut self) {
        self.swaps.clear();
    }

    /// Carries out the newest swap whose tiles are all there.
    pub fn poll(&mut self) -> Option<Shown> {
        let newest = (0..self.swaps.len()).rev().find(|i| self.is_satisfied(&self.swaps[*i]))?;
        let swap = self.swaps.drain(..=newest).next_back()?;
        // Later wirings overwrite earlier ones, within a wiring later frames overwrite earlier ones; boards of one
        // wiring never share a tile.
        let mut runs = Vec::new();
        for inbox in self.boards.values_mut() {
            inbox.runs.retain(|run| {
                let is_complete = swap.complete.get(run.view.0 as usize).copied().unwrap_or(false);
                if run.epoch < swap.epoch {
                    inbox.bytes -= run.payload.len();
                    return false;
                }
                let take = run.epoch == swap.epoch && run.frame <= swap.frame && is_complete;
                if take {
                    inbox.bytes -= run.payload.len();
                    runs.push(run.clone());
                }
                !take
            });
            inbox.done.retain(|done| *done > (swap.epoch, swap.frame));
        }
        runs.sort_by_key(|run| run.frame);
        let mut tiles = 0;
        for run in &runs {
            tiles += run.tiles.len();
            self.lay(run);
        }
        for (is_laid, is_complete) in self.is_laid.iter_mut().zip(&swap.complete) {
            *is_laid |= is_complete;
        }
        let Swap { frame, complete, preview, moment, .. } = swap;
        Some(Shown { frame, preview, moment, complete, tiles, skipped: newest })
    }

    fn is_satisfied(&self, swap: &Swap) -> bool {
        swap.boards.iter().all(|key| {
            // Exactly this frame: a board whose link had no room for it has sent its tiles with a later one.
            self.boards.get(key).is_some_and(|inbox| inbox.done.contains(&(swap.epoch, swap.frame)))
        })
    }

    fn placed(&self, view: ViewId) -> Option<Placed> {
        self.views.get(view.0 as usize).copied().flatten()
    }

    fn lay(&mut self, run: &Run) {
        let Some(placed) = self.placed(run.view) else { return };
        let mut pixels = &run.payload[run.pixels_at..];
        let (width, height) = placed.at_scale(run.scale);
        for tile in &run.tiles {
            let rect = tile.rect(width, height);
            let bytes = self.format.bytes();
            let row = rect.width() as usize * bytes;
            for y in rect.y0..rect.y1 {
                let (line, rest) = pixels.split_at(row);
                if run.scale == 1 {
                    let at = ((placed.y + y) as usize * self.width as usize + (placed.x + rect.x0) as usize) * bytes;
                    self.canvas[at..at + row].copy_from_slice(line);
                } else {
                    self.lay_enlarged(placed, run.scale, [rect.x0, y], line);
                }
                pixels = rest;
            }
        }
    }

    /// Lays a row of pixels, the first of which is number (x, y) of its view, as squares.
    fn lay_enlarged(&mut self, placed: Placed, scale: u32, [x, y]: [u32; 2], line: &[u8]) {
        let bytes = self.format.bytes();
        let count = (line.len() / bytes) as u32;
        let (left, right) = (x * scale, ((x + count) * scale).min(placed.width));
        let (top, bottom) = (y * scale, ((y + 1) * scale).min(placed.height));
        let place = |y: u32| ((placed.y + y) as usize * self.width as usize + (placed.x + left) as usize) * bytes;
        let (first, len) = (place(top), (right - left) as usize * bytes);
        let enlarged = self.canvas[first..first + len].chunks_mut(scale as usize * bytes);
        for (square, pixel) in enlarged.zip(line.chunks_exact(bytes)) {
            square.chunks_exact_mut(bytes).for_each(|to| to.copy_from_slice(pixel));
        }
        for y in top + 1..bottom {
            let at = place(y);
            self.canvas.copy_within(first..first + len, at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use proto::share::shares;
    use proto::view::{Samples, Tangents, View};

    const SIZE: (u32, u32) = (100, 70);

    fn views(n: u32) -> Vec<ViewSetup> {
        let row = View::row(n, SIZE.0, SIZE.1, Tangents::symmetric(45.0, SIZE.0, SIZE.1), Samples::One);
        row.into_iter().map(ViewSetup::new).collect()
    }

    /// A board's tiles of one view in a frame, all pixels of the value `shade`.
    fn payload(tiles: &[TileIndex], shade: u8) -> Bytes {
        let mut bytes = Vec::new();
        for tile in tiles {
            bytes.extend_from_slice(&tile.x.to_le_bytes());
            bytes.extend_from_slice(&tile.y.to_le_bytes());
        }
        let pixels: usize = tiles.iter().map(|t| t.rect(SIZE.0, SIZE.1).area()).sum();
        bytes.resize(bytes.len() + pixels * 3, shade);
        bytes.into()
    }

    fn swap(frame: u64, complete: &[bool], boards: &[u64]) -> Swap {
        let boards = boards.iter().map(|k| BoardKey(*k)).collect();
        Swap {
            frame: FrameNumber(frame),
            epoch: Epoch(1),
            complete: complete.to_vec(),
            boards,
            preview: false,
            moment: None,
        }
    }

    fn send(stitcher: &mut Stitcher, key: u64, frame: u64, boards: u32, view_count: u32) {
        let id = proto::ids::BoardId(key as u32);
        for share in shares(id, &vec![1; boards as usize], &views(view_count)) {
            let tiles: Vec<_> = share.part.tiles(SIZE.0, SIZE.1).collect();
            let bytes = payload(&tiles, frame as u8 + 1);
            let (frame, count) = (FrameNumber(frame), tiles.len() as u32);
            let format = PixelFormat::Srgb8;
            stitcher.on_tiles(BoardKey(key), frame, Epoch(1), share.view, count, SIZE, format, bytes).unwrap();
        }
        stitcher.on_done(BoardKey(key), FrameNumber(frame), Epoch(1));
    }

    fn stitcher(boards: u64, view_count: u32) -> Stitcher {
        let mut stitcher = Stitcher::new(PixelFormat::Srgb8, Vec::new());
        assert!(stitcher.set_views(&views(view_count)), "a picture of usual size");
        (0..boards).for_each(|k| stitcher.on_board(BoardKey(k)));
        stitcher
    }

    proptest! {
        #[test]
        fn whatever_order_tiles_come_in_the_picture_is_whole(
            boards in 1u32..6, view_count in 1u32..4, order in Just((0..5u64).collect::<Vec<_>>()).prop_shuffle(),
        ) {
            let mut stitcher = stitcher(boards.into(), view_count);
            let keys: Vec<u64> = (0..u64::from(boards)).collect();
            stitcher.on_swap(swap(0, &vec![true; view_count as usize], &keys));
            let mut shown = 0;
            for key in order.into_iter().filter(|k| *k < u64::from(boards)) {
                prop_assert_eq!(shown, 0, "not before the last board is done");
                send(&mut stitcher, key, 0, boards, view_count);
                shown += usize::from(stitcher.poll().is_some());
            }
            prop_assert_eq!(shown, 1);
            prop_assert!(stitcher.canvas().iter().all(|v| *v == 1));
        }
    }

    #[test]
    fn tiles_of_the_next_frame_wait_for_its_swap() {
        let mut stitcher = stitcher(2, 1);
        stitcher.on_swap(swap(0, &[true], &[0, 1]));
        send(&mut stitcher, 0, 0, 2, 1);
        send(&mut stitcher, 0, 1, 2, 1);
        send(&mut stitcher, 1, 0, 2, 1);
        assert_eq!(stitcher.poll().map(|s| s.frame), Some(FrameNumber(0)));
        assert!(stitcher.canvas().iter().all(|v| *v == 1), "nothing of frame 1 shows in frame 0");
        stitcher.on_swap(swap(1, &[true], &[0, 1]));
        assert_eq!(stitcher.poll(), None);
        send(&mut stitcher, 1, 1, 2, 1);
        assert!(stitcher.poll().is_some() && stitcher.canvas().iter().all(|v| *v == 2));
    }

    #[test]
    fn an_incomplete_view_repeats_as_a_whole_and_catches_up_later() {
        let mut stitcher = stitcher(2, 2);
        stitcher.on_swap(swap(0, &[true, true], &[0, 1]));
        send(&mut stitcher, 0, 0, 2, 2);
        send(&mut stitcher, 1, 0, 2, 2);
        stitcher.poll().unwrap();
        send(&mut stitcher, 0, 1, 2, 2);
        stitcher.on_swap(swap(1, &[true, false], &[0]));
        stitcher.poll().unwrap();
        let pixel = |s: &Stitcher, x: usize| s.canvas()[x * 3];
        assert!(stitcher.is_whole(), "each has been whole once");
        assert_eq!((pixel(&stitcher, 50), pixel(&stitcher, 150)), (2, 1));
        send(&mut stitcher, 1, 1, 2, 2);
        stitcher.on_done(BoardKey(0), FrameNumber(2), Epoch(1));
        stitcher.on_done(BoardKey(1), FrameNumber(2), Epoch(1));
        stitcher.on_swap(swap(2, &[true, true], &[0, 1]));
        stitcher.poll().unwrap();
        assert_eq!((pixel(&stitcher, 50), pixel(&stitcher, 150)), (2, 2), "the late tiles count for the next swap");
    }

    #[test]
    fn pixels_of_a_smaller_view_become_squares_and_what_is_not_whole_repeats_as_it_was() {
        for scale in [2, 4] {
            // Neither side is a multiple of the scale.
            let (width, height) = (99, 69);
            let setup = |scale| {
                let view = View::row(1, width, height, Tangents::symmetric(45.0, width, height), Samples::One)[0];
                [ViewSetup::new(view.at_scale(scale))]
            };
            let mut stitcher = Stitcher::new(PixelFormat::Srgb8, Vec::new());
            assert!(stitcher.set_views(&setup(1)), "a picture of usual size");
            stitcher.on_board(BoardKey(0));
            let small = setup(scale)[0].view;
            let tiles: Vec<_> = proto::share::Part::WHOLE.tiles(small.width, small.height).collect();
            let pixel = |x: u32, y: u32| [x as u8, y as u8, (x ^ y) as u8];
            let mut bytes: Vec<u8> =
                tiles.iter().flat_map(|t| [t.x.to_le_bytes(), t.y.to_le_bytes()].concat()).collect();
            for rect in tiles.iter().map(|tile| tile.rect(small.width, small.height)) {
                bytes.extend((rect.y0..rect.y1).flat_map(|y| (rect.x0..rect.x1).flat_map(move |x| pixel(x, y))));
            }
            let (count, size) = (tiles.len() as u32, (small.width, small.height));
            let (frame, epoch, format) = (FrameNumber(0), Epoch(1), PixelFormat::Srgb8);
            stitcher.on_tiles(BoardKey(0), frame, epoch, ViewId(0), count, size, format, bytes.into()).unwrap();
            stitcher.on_done(BoardKey(0), frame, epoch);
            stitcher.on_swap(swap(0, &[true], &[0]));
            stitcher.poll().unwrap();
            let expected: Vec<u8> =
                (0..height).flat_map(|y| (0..width).flat_map(move |x| pixel(x / scale, y / scale))).collect();
            assert!(stitcher.canvas() == expected, "scale {scale}");
            assert!(stitcher.set_views(&setup(1)), "the same views");
            stitcher.on_swap(swap(1, &[false], &[]));
            stitcher.poll().unwrap();
            assert!(stitcher.canvas() == expected, "scale {scale}: it repeats");
        }
    }

    #[test]
    fn a_canvas_is_whole_when_each_view_has_been_complete_once() {
        let mut stitcher = stitcher(1, 2);
        for (frame, complete, is_whole) in
            [(0, [false, false], false), (1, [false, true], false), (2, [true, false], true)]
        {
            send(&mut stitcher, 0, frame, 1, 2);
            stitcher.on_swap(swap(frame, &complete, &[0]));
            assert!(stitcher.poll().is_some());
            assert_eq!(stitcher.is_whole(), is_whole, "frame {frame}");
        }
        let mut smaller = views(2);
        smaller[0].view.width -= 1;
        assert!(stitcher.set_views(&smaller) && !stitcher.is_whole(), "a new canvas");
    }

    #[test]
    fn a_swap_that_waits_for_a_lost_board_is_given_back() {
        let mut stitcher = stitcher(2, 1);
        stitcher.on_swap(swap(4, &[true], &[0, 1]));
        send(&mut stitcher, 0, 4, 2, 1);
        assert_eq!(stitcher.on_lost(BoardKey(1)), [FrameNumber(4)]);
        assert_eq!(stitcher.poll(), None);
    }

    /// Found by review: a board without room for frame 10 sent everything with 11, and 10 was shown without its tiles.
    #[test]
    fn a_later_frame_of_one_board_does_not_stand_in_for_this_one() {
        let mut stitcher = stitcher(2, 1);
        stitcher.on_swap(swap(10, &[true], &[0, 1]));
        send(&mut stitcher, 1, 10, 2, 1);
        send(&mut stitcher, 0, 11, 2, 1);
        assert_eq!(stitcher.poll(), None);
        stitcher.on_swap(swap(11, &[true], &[0, 1]));
        send(&mut stitcher, 1, 11, 2, 1);
        let shown = stitcher.poll().unwrap();
        assert_eq!((shown.frame, shown.skipped), (FrameNumber(11), 1));
        assert!(stitcher.canvas().iter().all(|v| *v == 12));
    }

    #[test]
    fn tiles_that_pile_up_without_a_swap_are_refused_in_the_end() {
        let mut stitcher = stitcher(1, 1);
        let tiles: Vec<_> = proto::share::Part::WHOLE.tiles(SIZE.0, SIZE.1).collect();
        let mut offer = |frame| {
            let (count, bytes) = (tiles.len() as u32, payload(&tiles, 1));
            let (view, format) = (ViewId(0), PixelFormat::Srgb8);
            stitcher.on_tiles(BoardKey(0), FrameNumber(frame), Epoch(1), view, count, SIZE, format, bytes).is_ok()
        };
        assert!((0..8).all(&mut offer), "a few frames may wait");
        assert!(!(8..40).all(&mut offer), "but not any number");
    }

    #[test]
    fn views_lie_where_the_rig_puts_them() {
        let mut stitcher = Stitcher::new(PixelFormat::Srgb8, Vec::new());
        let mut setups = views(2);
        setups[0].at = Some([0, 70]);
        setups[1].at = Some([50, 0]);
        assert!(stitcher.set_views(&setups), "a picture of usual size");
        assert_eq!(stitcher.size(), (150, 140));
        stitcher.on_board(BoardKey(0));
        send(&mut stitcher, 0, 0, 1, 2);
        stitcher.on_swap(swap(0, &[true, true], &[0]));
        stitcher.poll().unwrap();
        let pixel = |x: usize, y: usize| stitcher.canvas()[(y * 150 + x) * 3];
        assert_eq!((pixel(0, 0), pixel(50, 0), pixel(149, 69), pixel(0, 70), pixel(99, 139)), (0, 1, 1, 1, 1));
        setups[1].at = Some([u32::MAX, 0]);
        assert!(!stitcher.set_views(&setups), "no picture is that large");
    }

    #[test]
    fn a_display_shows_its_views_from_their_own_corner_and_takes_no_others() {
        let mut stitcher = Stitcher::new(PixelFormat::Srgb8, vec![ViewId(1), ViewId(2)]);
        let mut setups = views(3);
        setups[2].at = Some([50, 80]);
        assert!(stitcher.set_views(&setups), "a picture of usual size");
        assert_eq!(stitcher.size(), (150, 150), "from (50, 0) to (200, 150)");
        stitcher.on_board(BoardKey(0));
        send(&mut stitcher, 0, 0, 1, 3);
        stitcher.on_swap(swap(0, &[true, true, false], &[0]));
        assert_eq!(stitcher.poll().map(|shown| shown.tiles), Some(12), "those of view 1");
        let pixel = |x: usize, y: usize| stitcher.canvas()[(y * 150 + x) * 3];
        assert_eq!((pixel(49, 0), pixel(50, 0), pixel(149, 69), pixel(0, 80)), (0, 1, 1, 0));
        assert_eq!(stitcher.tile_hashes().iter().map(|(view, _)| view.0).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn tiles_outside_the_view_are_refused() {
        let mut stitcher = stitcher(1, 1);
        let tile = [TileIndex { x: 99, y: 0 }];
        let format = PixelFormat::Srgb8;
        let result =
            stitcher.on_tiles(BoardKey(0), FrameNumber(0), Epoch(1), ViewId(0), 1, SIZE, format, payload(&tile, 0));
        assert!(result.is_err());
    }
}
