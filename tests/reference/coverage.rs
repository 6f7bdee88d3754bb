//! Which points a triangle on the screen hits: point in polygon, with the top-left rule.
//!
//! A point is inside if it lies on the inner side of all three edges. On an edge it belongs to the triangle only if
//! the edge is a left one, or a horizontal one with the inside below (top), so that of two triangles that share an
//! edge exactly one has it. The sign of a point's side is computed with the edge's ends in one order, whichever
//! triangle asks; both triangles then see the same number with opposite signs, and rounding can open no gap. On a
//! grid of 1/256 pixel every product and sum is exact in f64 up to coordinates of 2¹⁷ pixels (2·(17 + 8 + 1) bits).

/// Twice the signed area of a, b, c: positive if they run clockwise as seen, y being downwards. Exactly opposite for
/// the same three points with a and b exchanged.
pub fn side(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    let ordered = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if (a[0], a[1]) <= (b[0], b[1]) { ordered(a, b) } else { -ordered(b, a) }
}

/// Whether an edge of a clockwise triangle owns the points on it.
fn owns_its_points(a: [f64; 2], b: [f64; 2]) -> bool {
    let (right, down) = (b[0] - a[0], b[1] - a[1]);
    let is_left = down < 0.0;
    let is_top = down == 0.0 && right > 0.0;
    is_left || is_top
}

/// Whether a triangle, its corners clockwise as seen, hits a point.
pub fn hits(corners: &[[f64; 2]; 3], point: [f64; 2]) -> bool {
    (0..3).all(|k| {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        let side = side(a, b, point);
        side > 0.0 || (side == 0.0 && owns_its_points(a, b))
    })
}

/// How a rectangle lies with respect to a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Overlap {
    /// No point of it is hit.
    Nothing,
    /// Some may be.
    Part,
    /// All are.
    Whole,
}

/// How the rectangle `min..=max` lies. Exact enough to be a shortcut only: what is near an edge is [`Overlap::Part`].
pub fn overlap(corners: &[[f64; 2]; 3], min: [f64; 2], max: [f64; 2]) -> Overlap {
    let rectangle = [min, [max[0], min[1]], max, [min[0], max[1]]];
    let mut whole = true;
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        // A millionth of a pixel from the edge, far more than rounding can be wrong by.
        let margin = 1e-6 * ((b[0] - a[0]).abs() + (b[1] - a[1]).abs());
        let sides = rectangle.map(|corner| side(a, b, corner));
        if sides.iter().all(|side| *side < -margin) {
            return Overlap::Nothing;
        }
        whole &= sides.iter().all(|side| *side > margin);
    }
    if whole { Overlap::Whole } else { Overlap::Part }
}

/// The extent along x of the part of a triangle between two horizontal lines; `None` if there is none.
pub fn extent_in_band(corners: &[[f64; 2]; 3], top: f64, bottom: f64) -> Option<[f64; 2]> {
    let mut extent: Option<[f64; 2]> = None;
    let mut include = |x: f64| {
        extent = Some(extent.map_or([x, x], |[low, high]| [low.min(x), high.max(x)]));
    };
    for k in 0..3 {
        let (a, b) = (corners[k], corners[(k + 1) % 3]);
        if a[1] >= top && a[1] <= bottom {
            include(a[0]);
        }
        for line in [top, bottom] {
            if (a[1] < line) != (b[1] < line) {
                let part = (line - a[1]) / (b[1] - a[1]);
                include(a[0] + (b[0] - a[0]) * part);
            }
        }
    }
    extent
}
