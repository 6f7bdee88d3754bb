//! Convex polygons within a pixel, and lines that cut them.
//!
//! Corners nearer to a line than [`ON_LINE`] count as on it and belong to both sides, so that a line through a corner, or
//! the edge that two faces share, never leaves a sliver behind. What that gives away is below `ON_LINE` times the length of the
//! cut, at most √2: nothing beside the error that is allowed.

/// Nearer to a line than this is on it, pixels. Well above the rounding of a distance within the pixel, about 1e-15.
pub(super) const ON_LINE: f64 = 1e-13;

/// Most corners of a polygon. The square has four, a triangle's part of it seven at most, and what faces leave between them seldom
/// more; a pixel that would need more is sampled.
pub(super) const CORNERS_MAX: usize = 16;

/// Half of that, and enough for most.
const EIGHT: usize = CORNERS_MAX / 2;

/// An affine function of the position in the pixel, positive inside of a face's edge.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Line {
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) c: f64,
    /// Values up to this, either sign, are on the line.
    pub(super) slack: f64,
}

impl Line {
    #[inline]
    pub(super) fn new(a: f64, b: f64, c: f64) -> Self {
        Self { a, b, c, slack: ON_LINE * (a.abs() + b.abs()) }
    }

    #[inline]
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> f64 {
        self.c + (self.a * x + self.b * y)
    }

    /// Least and largest value over the unit square.
    #[inline]
    pub(super) fn over_square(&self) -> [f64; 2] {
        [self.c + (lesser(self.a, 0.0) + lesser(self.b, 0.0)), self.c + (larger(self.a, 0.0) + larger(self.b, 0.0))]
    }
}

/// The lesser of two; if one is no number, the second. One instruction, where `f64::min` takes several.
#[inline]
pub(super) fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The larger of two; if one is no number, the second.
#[inline]
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// A rectangle along the axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bounds {
    least: [f64; 2],
    most: [f64; 2],
}

impl Bounds {
    pub(super) const SQUARE: Self = Self { least: [0.0; 2], most: [1.0; 2] };

    #[inline]
    pub(super) fn of_triangle([x0, x1, x2]: [f64; 3], [y0, y1, y2]: [f64; 3]) -> Self {
        Self {
            least: [lesser(lesser(x0, x1), x2), lesser(lesser(y0, y1), y2)],
            most: [larger(larger(x0, x1), x2), larger(larger(y0, y1), y2)],
        }
    }

    /// Of corners, at least one.
    #[inline]
    pub(super) fn of(corners: &[[f64; 2]]) -> Self {
        let mut bounds = Self { least: corners[0], most: corners[0] };
        for [x, y] in &corners[1..] {
            bounds.least = [lesser(bounds.least[0], *x), lesser(bounds.least[1], *y)];
            bounds.most = [larger(bounds.most[0], *x), larger(bounds.most[1], *y)];
        }
        bounds
    }

    /// Whether two have no area in common.
    #[inline]
    pub(super) fn are_apart(&self, other: &Self) -> bool {
        (self.most[0] <= other.least[0])
            | (other.most[0] <= self.least[0])
            | (self.most[1] <= other.least[1])
            | (other.most[1] <= self.least[1])
    }
}

/// On which side of a line each corner is. A buffer: clearing all values for each line took longer than computing them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sides {
    /// Bit i: corner i is inside.
    pub(super) inside: u32,
    /// Bit i: corner i is outside. Corners in neither are on the line.
    pub(super) outside: u32,
    /// The line's function at the corners.
    values: [f64; CORNERS_MAX],
}

/// The corners inside of a line, between where the outline comes in and where it goes out.
#[derive(Clone, Copy, Debug)]
struct Run {
    entry: [f64; 2],
    exit: [f64; 2],
    /// Whether the entry is a new corner.
    is_entry_cut: bool,
    /// The corner that follows the run.
    end: usize,
    /// Number of corners that aren't inside.
    left: usize,
}

/// Convex, with its corners in the direction of positive area (y down).
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    count: usize,
    at: [[f64; 2]; CORNERS_MAX],
}

/// The whole pixel.
pub(super) static SQUARE: Polygon = {
    let mut square = Polygon::EMPTY;
    square.count = 4;
    (square.at[1], square.at[2], square.at[3]) = ([1.0, 0.0], [1.0, 1.0], [0.0, 1.0]);
    square
};

impl Polygon {
    pub(super) const EMPTY: Self = Self { count: 0, at: [[0.0; 2]; CORNERS_MAX] };

    /// Copies; of few corners, a fixed number of them, which needs no call.
    #[inline]
    pub(super) fn set(&mut self, from: &Self) {
        self.count = from.count;
        let (few, more) = self.at.split_at_mut(EIGHT);
        let (from_few, from_more) = from.at.split_at(EIGHT);
        few.copy_from_slice(from_few);
        if from.count > EIGHT {
            more.copy_from_slice(from_more);
        }
    }

    #[inline]
    pub(super) fn corners(&self) -> &[[f64; 2]] {
        &self.at[..self.count]
    }

    /// Whether cutting might need more corners than there is room for.
    #[inline]
    pub(super) fn is_full(&self) -> bool {
        self.count == CORNERS_MAX
    }

    /// Pixels².
    #[inline]
    pub(super) fn area(&self) -> f64 {
        let corners = self.corners();
        let Some(([x, y], rest)) = corners.split_first() else { return 0.0 };
        let mut twice = 0.0;
        for pair in rest.windows(2) {
            let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
            twice += (ax - x) * (by - y) - (ay - y) * (bx - x);
        }
        twice * 0.5
    }

    /// The mean of the corners: a point inside.
    #[inline]
    pub(super) fn middle(&self) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for [x, y] in self.corners() {
            sum[0] += x;
            sum[1] += y;
        }
        sum.map(|s| s / self.count as f64)
    }

    #[inline]
    pub(super) fn set_sides(&self, line: &Line, sides: &mut Sides) {
        (sides.inside, sides.outside) = (0, 0);
        let mut bit = 1;
        for (corner, to) in self.corners().iter().zip(&mut sides.values) {
            let value = line.at(*corner);
            *to = value;
            sides.inside |= if value > line.slack { bit } else { 0 };
            sides.outside |= if value < -line.slack { bit } else { 0 };
            bit <<= 1;
        }
    }

    /// The lines, a bit each, that have corners on both sides; `None` if a line has the polygon outside.
    #[inline]
    pub(super) fn set_crossing(&self, lines: &[Line], sides: &mut [Sides; 3]) -> Option<u32> {
        let mut crossing = 0;
        for (i, (line, sides)) in lines.iter().zip(sides).enumerate() {
            self.set_sides(line, sides);
            if sides.inside == 0 {
                return None;
            }
            crossing |= u32::from(sides.outside != 0) << i;
        }
        Some(crossing)
    }

    /// Makes `to` what of this polygon is inside of all lines, and returns false if that is nothing. `None` if it would need too many
    /// corners. The sides and `room` are overwritten.
    #[inline]
    pub(super) fn keep_inside(
        &self,
        lines: &[Line],
        sides: &mut [Sides; 3],
        to: &mut Self,
        room: &mut Self,
    ) -> Option<bool> {
        let Some(mut crossing) = self.set_crossing(lines, sides) else { return Some(false) };
        if crossing == 0 {
            to.set(self);
            return Some(true);
        }
        if self.is_full() {
            return None;
        }
        self.inner_run(&sides[crossing.trailing_zeros() as usize], to);
        crossing &= crossing - 1;
        while crossing != 0 {
            let i = crossing.trailing_zeros() as usize;
            crossing &= crossing - 1;
            let sides = &mut sides[i];
            to.set_sides(&lines[i], sides);
            if sides.inside == 0 {
                return Some(false);
            }
            if sides.outside != 0 {
                if to.is_full() {
                    return None;
                }
                to.inner_run(sides, room);
                to.set(room);
            }
        }
        Some(true)
    }

    /// Whether nothing of it is inside of a line.
    #[inline]
    pub(super) fn is_outside(&self, line: &Line) -> bool {
        self.corners().iter().all(|corner| line.at(*corner) <= line.slack)
    }

    /// Cuts it in two by a line that has corners on both sides. It must not be full.
    #[inline]
    pub(super) fn cut(&self, sides: &Sides, inside: &mut Self, outside: &mut Self) {
        let run = self.inner_run(sides, inside);
        outside.count = 0;
        if sides.outside >> run.end & 1 != 0 {
            outside.push(run.exit);
        }
        let mut i = run.end;
        for _ in 0..run.left {
            outside.push(self.at[i]);
            i = self.next(i);
        }
        if run.is_entry_cut {
            outside.push(run.entry);
        }
    }

    /// Makes the inner part of a cut.
    #[inline]
    fn inner_run(&self, sides: &Sides, inside: &mut Self) -> Run {
        let count = self.count;
        // Going round a convex polygon, the corners inside are one run.
        let follows = sides.inside << 1 | sides.inside >> (count - 1);
        let first = (sides.inside & !follows).trailing_zeros() as usize % CORNERS_MAX;
        inside.count = 0;
        let previous = if first == 0 { count - 1 } else { first - 1 };
        let is_entry_cut = sides.outside >> previous & 1 != 0;
        let entry = if is_entry_cut { self.crossing(sides, previous, first) } else { self.at[previous] };
        inside.push(entry);
        let (mut last, mut end, mut left) = (first, first, count);
        while left > 0 && sides.inside >> end & 1 != 0 {
            inside.push(self.at[end]);
            (last, end, left) = (end, self.next(end), left - 1);
        }
        let exit = if sides.outside >> end & 1 != 0 { self.crossing(sides, last, end) } else { self.at[end] };
        inside.push(exit);
        Run { entry, exit, is_entry_cut, end, left }
    }

    #[inline]
    fn next(&self, i: usize) -> usize {
        if i + 1 == self.count { 0 } else { i + 1 }
    }

    #[inline]
    fn push(&mut self, corner: [f64; 2]) {
        self.at[self.count] = corner;
        self.count += 1;
    }

    /// Where the side from corner i to corner j meets the line.
    #[inline]
    fn crossing(&self, sides: &Sides, i: usize, j: usize) -> [f64; 2] {
        let (a, b) = (self.at[i], self.at[j]);
        let part = sides.values[i] / (sides.values[i] - sides.values[j]);
        [a[0] + (b[0] - a[0]) * part, a[1] + (b[1] - a[1]) * part]
    }
}
