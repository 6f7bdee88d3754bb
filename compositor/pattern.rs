//! A picture to set up projectors by: shown in place of the rig's, at the same swaps.
//!
//! Each view has its border (outermost pixels), lines of equal azimuth and elevation every 5° as the eye sees them — so a line goes on from one projector to the next,
//! at whatever angle they stand —, a ring 10° round its axis, its number, colours and eleven steps of grey. A white block runs along the top, a sixtieth of the width
//! a frame: displays on which it isn't at the same place show different frames.

use glam::DVec3;
use proto::ids::{FrameNumber, ViewId};
use proto::view::View;

/// Between lines, degrees.
const LINES_DEG: f64 = 5.0;
/// Between heavier ones.
const HEAVY_DEG: f64 = 30.0;
/// Of the ring round a view's axis, degrees.
const RING_DEG: f64 = 10.0;
/// Lines of equal azimuth would run together round the zenith: the lighter ones end here, degrees.
const LIGHT_MAX_DEG: f64 = 75.0;
/// Places of the running block.
const STEPS: u64 = 60;

type Rgb = [u8; 3];
const GROUND: Rgb = [22; 3];
const LIGHT: Rgb = [96; 3];
const HEAVY: Rgb = [190; 3];
const AHEAD: Rgb = [255, 176, 0];
const RING: Rgb = [0, 170, 255];
const WHITE: Rgb = [255; 3];
/// Beside each other, left to right.
const COLOURS: [Rgb; 7] =
    [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 255, 255], [255, 0, 255], [255, 255, 0], [255; 3]];
const GREYS: u32 = 11;

/// A view on the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PatternView {
    pub id: ViewId,
    pub view: View,
    /// Of its upper left pixel.
    pub at: [u32; 2],
}

/// The pattern of some views on a picture.
#[derive(Debug)]
pub(crate) struct Pattern {
    views: Vec<PatternView>,
    width: u32,
    height: u32,
    pixels: Vec<u8>,
}

impl Pattern {
    /// For a picture of that size.
    pub(crate) fn new(views: Vec<PatternView>, (width, height): (u32, u32)) -> Self {
        let pixels = vec![0; width as usize * height as usize * 3];
        let mut pattern = Self { views, width, height, pixels };
        for view in pattern.views.clone() {
            pattern.draw(&view);
        }
        pattern
    }

    /// Whether it is the pattern of these views on a picture of that size.
    pub(crate) fn is_of(&self, views: &[PatternView], size: (u32, u32)) -> bool {
        self.views == views && (self.width, self.height) == size
    }

    /// The picture of a frame: rows from the top, 8-bit sRGB.
    pub(crate) fn of(&self, frame: FrameNumber) -> Vec<u8> {
        let mut pixels = self.pixels.clone();
        for PatternView { view, at: [left, top], .. } in &self.views {
            let edge = |step: u64| left + (u64::from(view.width) * step / STEPS) as u32;
            let step = frame.0 % STEPS;
            let block = [edge(step), edge(step + 1).max(edge(step) + 1)];
            for y in top + 1..top + (view.height / 24).max(2).min(view.height) {
                let row = (y * self.width) as usize * 3;
                pixels[row + block[0] as usize * 3..row + block[1] as usize * 3].fill(255);
            }
        }
        pixels
    }

    fn draw(&mut self, view: &PatternView) {
        let View { width, height, .. } = view.view;
        let mut above = corners(&view.view, 0);
        for y in 0..height {
            let below = corners(&view.view, y + 1);
            for x in 0..width {
                let corner = x as usize;
                let around = [above[corner], above[corner + 1], below[corner], below[corner + 1]];
                let is_border = x == 0 || y == 0 || x + 1 == width || y + 1 == height;
                self.put(view, [x, y], if is_border { WHITE } else { colour(&around) });
            }
            above = below;
        }
        self.bars(view);
        self.number(view);
    }

    /// Colours above greys, in the middle of the lower third.
    fn bars(&mut self, view: &PatternView) {
        let View { width, height, .. } = view.view;
        let [left, right] = [width / 4, width - width / 4];
        let [top, middle, bottom] = [8, 9, 10].map(|twelfth| height * twelfth / 12);
        for y in top..bottom {
            for x in left..right {
                let of = |count: u32| (x - left) * count / (right - left).max(1);
                let grey = [(of(GREYS) * 255 / (GREYS - 1)) as u8; 3];
                self.put(view, [x, y], if y < middle { COLOURS[of(COLOURS.len() as u32) as usize] } else { grey });
            }
        }
    }

    /// The view's number in seven segments a digit, in the upper left.
    fn number(&mut self, view: &PatternView) {
        /// Segments of digits: top, upper left and right, middle, lower left and right, bottom.
        const DIGITS: [u8; 10] = [
            0b1110111, 0b0010010, 0b1011101, 0b1011011, 0b0111010, 0b1101011, 0b1101111, 0b1010010, 0b1111111,
            0b1111011,
        ];
        let View { width, height, .. } = view.view;
        // Strokes that thick; a digit is 4 × 7 of them.
        let stroke = (height.min(width) / 48).max(1);
        let segments: [[u32; 4]; 7] =
            [[0, 0, 4, 1], [0, 0, 1, 4], [3, 0, 1, 4], [0, 3, 4, 1], [0, 3, 1, 4], [3, 3, 1, 4], [0, 6, 4, 1]];
        for (place, digit) in view.id.0.to_string().bytes().enumerate() {
            let left = width / 12 + place as u32 * 5 * stroke;
            let lit = DIGITS[usize::from(digit - b'0')];
            for (k, [x, y, wide, high]) in segments.into_iter().enumerate() {
                if lit & (1 << (6 - k)) != 0 {
                    let [x, y] = [left + x * stroke, height / 8 + y * stroke];
                    for y in y..(y + high * stroke).min(height) {
                        for x in x..(x + wide * stroke).min(width) {
                            self.put(view, [x, y], WHITE);
                        }
                    }
                }
            }
        }
    }

    fn put(&mut self, view: &PatternView, [x, y]: [u32; 2], rgb: Rgb) {
        let at = ((view.at[1] + y) as usize * self.width as usize + (view.at[0] + x) as usize) * 3;
        self.pixels[at..at + 3].copy_from_slice(&rgb);
    }
}

/// A pixel's corner as the eye sees it, degrees.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Corner {
    azimuth: f64,
    elevation: f64,
    /// From the view's axis.
    off_axis: f64,
}

/// The corners between two rows of pixels, or above the first or below the last.
fn corners(view: &View, y: u32) -> Vec<Corner> {
    let tangents = &view.tangents;
    let up = tangents.top + (tangents.bottom - tangents.top) * f64::from(y) / f64::from(view.height);
    let corner = |x: u32| {
        let right = tangents.left + (tangents.right - tangents.left) * f64::from(x) / f64::from(view.width);
        let [ahead_x, ahead_y, ahead_z] = (view.offset.orientation * DVec3::new(right, up, -1.0)).to_array();
        Corner {
            azimuth: ahead_x.atan2(-ahead_z).to_degrees(),
            elevation: ahead_y.atan2(ahead_x.hypot(ahead_z)).to_degrees(),
            off_axis: right.hypot(up).atan().to_degrees(),
        }
    };
    (0..=view.width).map(corner).collect()
}

/// What is seen in a pixel with these corners.
fn colour(around: &[Corner; 4]) -> Rgb {
    let azimuths = around.map(|corner| corner.azimuth);
    let elevations = around.map(|corner| corner.elevation);
    // Behind the eye azimuth leaps from 180° to −180°, which is a line too; it is a heavy one.
    let is_ahead = azimuths.iter().all(|azimuth| azimuth.abs() < 90.0);
    let is_low = elevations.iter().all(|elevation| elevation.abs() < LIGHT_MAX_DEG);
    if is_ahead && crosses(&azimuths, 360.0) || crosses(&elevations, 360.0) {
        AHEAD
    } else if crosses(&azimuths, HEAVY_DEG) || crosses(&elevations, HEAVY_DEG) {
        HEAVY
    } else if crosses(&around.map(|corner| corner.off_axis - RING_DEG), 360.0) {
        RING
    } else if is_low && crosses(&azimuths, LINES_DEG) || crosses(&elevations, LINES_DEG) {
        LIGHT
    } else {
        GROUND
    }
}

/// Whether a multiple of `every` lies between these values.
fn crosses(values: &[f64; 4], every: f64) -> bool {
    let steps = values.map(|value| (value / every).floor());
    steps.iter().any(|step| *step != steps[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::view::{Samples, Tangents};

    const SIZE: u32 = 240;

    /// Two views side by side, 60° wide each.
    fn pair() -> Pattern {
        let views = View::row(2, SIZE, SIZE, Tangents::symmetric(60.0, SIZE, SIZE), Samples::One);
        let placed = views.into_iter().zip(0..);
        let placed = placed.map(|(view, k)| PatternView { id: ViewId(k), view, at: [k * SIZE, 0] });
        Pattern::new(placed.collect(), (2 * SIZE, SIZE))
    }

    fn at(pixels: &[u8], [x, y]: [u32; 2]) -> Rgb {
        let at = ((y * 2 * SIZE + x) * 3) as usize;
        pixels[at..at + 3].try_into().unwrap()
    }

    #[test]
    fn lines_go_on_from_view_to_view() {
        let pixels = pair().of(FrameNumber(0));
        // Beside the border, and below the running block; a line at a slant may be a row further on the other side of three pixels.
        let rows = |x: u32| (SIZE / 10..SIZE - 1).filter(move |y| ![GROUND, RING].contains(&at(&pixels, [x, *y])));
        let [left, right] = [SIZE - 2, SIZE + 1].map(|x| rows.clone()(x).collect::<Vec<_>>());
        assert!(left.len() >= 9, "lines every 5° over 60° less what the block hides: {left:?}");
        assert!(
            left.len() == right.len() && left.iter().zip(&right).all(|(a, b)| a.abs_diff(*b) <= 1),
            "{left:?} {right:?}"
        );
    }

    #[test]
    fn lines_are_where_their_angles_are() {
        let pixels = pair().of(FrameNumber(0));
        // The view's axis is 30° to the left, and 60° spread over the width by tangents.
        let column = |degrees: f64| {
            let tangent = (degrees + 30.0).to_radians().tan() / 30f64.to_radians().tan();
            ((tangent + 1.0) / 2.0 * f64::from(SIZE)) as u32
        };
        // One row above the horizon.
        let row = SIZE / 2 - 2;
        for (degrees, wanted) in
            [(-30.0, HEAVY), (-25.0, LIGHT), (-10.0, LIGHT), (-5.0, LIGHT), (-40.0, RING), (-20.0, RING)]
        {
            let near = (column(degrees) - 1..=column(degrees) + 1).map(|x| at(&pixels, [x, row]));
            assert!(near.into_iter().any(|rgb| rgb == wanted), "{degrees}°");
        }
        assert_eq!(at(&pixels, [column(-23.0), row]), GROUND);
        assert_eq!(at(&pixels, [column(-23.0), SIZE / 2]), AHEAD, "the horizon, between two rows, is in the lower one");
    }

    #[test]
    fn every_view_has_its_border_its_number_and_the_block_of_the_frame() {
        let pattern = pair();
        let [first, later] = [0, 30].map(|frame| pattern.of(FrameNumber(frame)));
        for x in [0, SIZE - 1, SIZE, 2 * SIZE - 1] {
            assert!((0..SIZE).all(|y| at(&first, [x, y]) == WHITE), "{x}");
        }
        for left in [0, SIZE] {
            let is_block = |pixels: &[u8], step: u32| (1..4).all(|x| at(pixels, [left + step * 4 + x, 2]) == WHITE);
            assert!(is_block(&first, 0) && is_block(&later, 30) && !is_block(&first, 30));
        }
        let number = |left: u32| {
            let box_of = (0..35).flat_map(move |y| (0..20).map(move |x| [left + SIZE / 12 + x, SIZE / 8 + y]));
            box_of.map(|place| at(&first, place) == WHITE).collect::<Vec<_>>()
        };
        assert_ne!(number(0), number(SIZE));
        // The upper stroke of 0, which 1 lacks.
        assert!(number(0)[7] && !number(SIZE)[7]);
        assert_eq!(pattern.of(FrameNumber(60)), first);
    }

    #[test]
    fn views_of_any_size_have_one() {
        for (width, height) in [(1, 1), (2, 3), (1, 40), (61, 2), (500, 9)] {
            let view = View::row(1, width, height, Tangents::symmetric(40.0, width, height), Samples::One)[0];
            let view = PatternView { id: ViewId(u32::MAX), view, at: [0, 0] };
            let pattern = Pattern::new(vec![view], (width, height));
            for frame in [0, 59, u64::MAX] {
                assert_eq!(pattern.of(FrameNumber(frame)).len(), (width * height * 3) as usize);
            }
        }
    }
}
