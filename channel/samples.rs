//! Where a pixel is looked at: the fixed, published sample patterns.
//!
//! Points are integers in 1/256 pixel from the pixel's upper left corner, x to the right and y downwards, so that
//! coverage is decided in integers. Each pattern of n = 2^m points (4, 8, 16, 64) is a (0, m, 2)-net in base 2: however
//! the pixel is cut into n equal rectangles of a × b with a and b powers of two, each holds exactly one point. Hence every
//! column and every row of the n × n grid holds one point, vertical and horizontal edges are seen in n steps, and
//! the points' mean is the pixel's centre to the last bit. Among nets (Owen scramblings of the Hammersley net, about
//! 10⁵ per pattern by random search and annealing) the one was taken that has the smallest root-mean-square error in the
//! area of half-planes, weighted against the smallest distance between points (on the torus, as the pattern repeats with
//! each pixel): a regular grid of 64 points would be wrong by up to 1/8 for a vertical edge.

use proto::view::Samples;

/// Sub-pixel positions per pixel, as a power of two: vertices and samples lie on a grid of 1/256 pixel.
pub const SUBPIXEL_BITS: u32 = 8;
/// Sub-pixel positions per pixel.
pub const SUBPIXELS: i32 = 1 << SUBPIXEL_BITS;

/// How far beyond a pixel one looks for faces that have an area in it, sub. A face has its corners where rounding put them: half
/// a sub-pixel aside along each axis, and one that rounding left without an area has a corner a sub-pixel farther off. So no
/// point of it is farther than 1.8 sub-pixels from its place; what touches a pixel touches it with this margin, and what
/// covers it with this margin covers it.
pub const EXACT_MARGIN: i32 = 2;

/// One pattern: the same points in every pixel of a view.
#[derive(Debug)]
pub struct Pattern {
    /// Number of points.
    pub count: usize,
    /// The points as x, y in 1/256 pixel, by distance from the pixel's centre, nearest first (ties: in the order of the
    /// published list); bit i of a coverage mask is point i, so that the lowest bit of a mask is the covered point nearest
    /// to the centre. Only the first `count` mean anything.
    pub points: [[i32; 2]; 64],
    /// Their x alone.
    pub points_x: [i32; 64],
    /// Their y alone.
    pub points_y: [i32; 64],
    /// Both once more, as numbers that positions are computed with.
    pub points_f64: [[f64; 64]; 2],
    /// The mask that has all points.
    pub full: u64,
    /// Smallest coordinate of any point; by symmetry 256 − `low` is the largest. What asks for a pixel's samples asks for this range. For
    /// [`Samples::Exact`] it reaches beyond the pixel, by [`EXACT_MARGIN`].
    pub low: i32,
}

impl Pattern {
    /// The published pattern of that many samples.
    pub fn of(samples: Samples) -> &'static Self {
        match samples {
            Samples::One => &ONE,
            Samples::Four => &FOUR,
            Samples::Eight => &EIGHT,
            Samples::Sixteen => &SIXTEEN,
            Samples::SixtyFour => &SIXTY_FOUR,
            Samples::Exact => &EXACT,
        }
    }

    /// Largest coordinate of any point.
    pub const fn high(&self) -> i32 {
        SUBPIXELS - self.low
    }

    /// Whether pixels are computed by areas where points don't do: see [`crate::exact::stage`].
    #[inline(always)]
    pub const fn is_exact(&self) -> bool {
        self.low < 0
    }

    const fn new(points: &[[u8; 2]]) -> Self {
        let count = points.len();
        let mut pattern = Self {
            count,
            points: [[0; 2]; 64],
            points_x: [0; 64],
            points_y: [0; 64],
            points_f64: [[0.0; 64]; 2],
            full: u64::MAX >> (64 - count),
            low: SUBPIXELS / 2 / count as i32,
        };
        let mut i = 0;
        while i < count {
            let point = [points[i][0] as i32, points[i][1] as i32];
            // Insertion sort, stable; runs when the program is compiled.
            let mut place = i;
            while place > 0 && centre_distance(pattern.points[place - 1]) > centre_distance(point) {
                pattern.points[place] = pattern.points[place - 1];
                place -= 1;
            }
            pattern.points[place] = point;
            i += 1;
        }
        i = 0;
        while i < count {
            [pattern.points_x[i], pattern.points_y[i]] = pattern.points[i];
            pattern.points_f64[0][i] = pattern.points_x[i] as f64;
            pattern.points_f64[1][i] = pattern.points_y[i] as f64;
            i += 1;
        }
        pattern
    }
}

/// Square of a point's distance from the pixel's centre.
const fn centre_distance(point: [i32; 2]) -> i32 {
    let (x, y) = (point[0] - SUBPIXELS / 2, point[1] - SUBPIXELS / 2);
    x * x + y * y
}

static ONE: Pattern = Pattern::new(&[[128, 128]]);
static FOUR: Pattern = Pattern::new(&POINTS_4);
static EIGHT: Pattern = Pattern::new(&POINTS_8);
static SIXTEEN: Pattern = Pattern::new(&POINTS_16);
static SIXTY_FOUR: Pattern = Pattern::new(&POINTS_64);
/// The points of 64, asked about with a margin round the pixel.
static EXACT: Pattern = Pattern { low: -EXACT_MARGIN, ..Pattern::new(&POINTS_64) };

#[rustfmt::skip]
static POINTS_4: [[u8; 2]; 4] = [
    [32, 96], [96, 224], [160, 32], [224, 160],
];
#[rustfmt::skip]
static POINTS_8: [[u8; 2]; 8] = [
    [16, 80], [48, 240], [80, 144], [112, 48], [144, 208], [176, 112], [208, 16], [240, 176],
];
#[rustfmt::skip]
static POINTS_16: [[u8; 2]; 16] = [
    [8, 248], [24, 56], [40, 184], [56, 120], [72, 24], [88, 216], [104, 88], [120, 152],
    [136, 8], [152, 200], [168, 72], [184, 136], [200, 232], [216, 40], [232, 168], [248, 104],
];
#[rustfmt::skip]
static POINTS_64: [[u8; 2]; 64] = [
    [2, 82], [6, 194], [10, 50], [14, 166], [18, 18], [22, 134], [26, 242], [30, 102],
    [34, 210], [38, 70], [42, 182], [46, 38], [50, 150], [54, 6], [58, 230], [62, 118],
    [66, 90], [70, 202], [74, 170], [78, 58], [82, 26], [86, 142], [90, 250], [94, 110],
    [98, 218], [102, 78], [106, 46], [110, 186], [114, 154], [118, 14], [122, 126], [126, 238],
    [130, 94], [134, 206], [138, 62], [142, 174], [146, 30], [150, 138], [154, 254], [158, 106],
    [162, 222], [166, 74], [170, 190], [174, 42], [178, 158], [182, 10], [186, 122], [190, 234],
    [194, 86], [198, 198], [202, 54], [206, 162], [210, 22], [214, 130], [218, 246], [222, 98],
    [226, 214], [230, 66], [234, 178], [238, 34], [242, 146], [246, 2], [250, 114], [254, 226],
];

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Samples; 5] = [Samples::One, Samples::Four, Samples::Eight, Samples::Sixteen, Samples::SixtyFour];

    #[test]
    fn every_elementary_rectangle_holds_one_point() {
        for pattern in ALL.map(Pattern::of) {
            let n = pattern.count;
            let m = n.trailing_zeros();
            for columns_log in 0..=m {
                // 2^columns_log columns of 2^(m − columns_log) rows.
                let mut hits = vec![0; n];
                for [x, y] in &pattern.points[..n] {
                    let column = (*x as usize) >> (SUBPIXEL_BITS - columns_log);
                    let row = (*y as usize) >> (SUBPIXEL_BITS - (m - columns_log));
                    hits[column + (row << columns_log)] += 1;
                }
                assert!(hits.iter().all(|h| *h == 1), "{n} points, {columns_log}: {hits:?}");
            }
        }
    }

    #[test]
    fn the_mean_is_the_centre_and_the_bounds_are_true() {
        for pattern in ALL.map(Pattern::of) {
            let points = &pattern.points[..pattern.count];
            for axis in 0..2 {
                let coordinates = || points.iter().map(|p| p[axis]);
                assert_eq!(coordinates().sum::<i32>(), 128 * pattern.count as i32);
                assert_eq!(coordinates().min(), Some(pattern.low));
                assert_eq!(coordinates().max(), Some(pattern.high()));
            }
            assert_eq!(pattern.full.count_ones() as usize, pattern.count);
        }
    }

    #[test]
    fn points_keep_their_distance_across_pixel_borders() {
        // Smallest toroidal distance in units of the n × n grid; a random net of 64 points has about 5 (squared).
        for (samples, least) in
            [(Samples::Four, 2), (Samples::Eight, 8), (Samples::Sixteen, 13), (Samples::SixtyFour, 50)]
        {
            let pattern = Pattern::of(samples);
            let points = &pattern.points[..pattern.count];
            let wrapped = |d: i32| d.abs().min(SUBPIXELS - d.abs());
            let mut smallest = i32::MAX;
            for (i, a) in points.iter().enumerate() {
                for b in &points[..i] {
                    let (x, y) = (wrapped(a[0] - b[0]), wrapped(a[1] - b[1]));
                    smallest = smallest.min(x * x + y * y);
                }
            }
            let unit = SUBPIXELS / pattern.count as i32;
            assert!(smallest / (unit * unit) >= least, "{samples:?}: {}", smallest / (unit * unit));
        }
    }

    #[test]
    fn points_are_ordered_by_distance_from_the_centre() {
        for pattern in ALL.map(Pattern::of) {
            assert!(pattern.points[..pattern.count].is_sorted_by_key(|p| centre_distance(*p)), "{:?}", pattern.points);
        }
    }

    #[test]
    fn what_covers_every_point_covers_the_centre() {
        // Convex faces: the centre lies inside the hull, because in every direction there is a point beyond it.
        for pattern in ALL.map(Pattern::of).into_iter().filter(|p| p.count > 1) {
            for step in 0..360 {
                let (sin, cos) = f64::sin_cos(f64::from(step).to_radians());
                let reach = pattern.points[..pattern.count]
                    .iter()
                    .map(|p| f64::from(p[0] - 128) * cos + f64::from(p[1] - 128) * sin)
                    .fold(f64::MIN, f64::max);
                assert!(reach > 0.0, "{} points, {step}°", pattern.count);
            }
        }
    }
}
