//! What drawing an object is predicted to take, and how that is found out.
//!
//! The model is linear in what is known before a pixel is drawn: vertices, triangles, the pixels that the boxes of the object's subobjects would cover
//! as seen from all sides on the average, and those again that light passes through. Boxes, since balls of what is flat, like ground, cover a hundred times
//! what it does. Its numbers are fitted to measured times of whole frames by least squares of the *relative* error
//! (a frame of 2 ms counts as much as one of 200), and are never negative: `cyclorama bench lists --fit` does it again on the machine it runs on.
//! It predicts shares of work, not deadlines: what is hidden costs less than it says, so an object in the last row is overrated.

use crate::scene::blocks::Content;

/// Numbers of the model.
pub const TERMS: usize = 5;

/// ns of one thread, each.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CostModel {
    /// Of a vertex.
    pub vertex: f64,
    /// Of a triangle.
    pub triangle: f64,
    /// Of a pixel that a subobject's box covers.
    pub pixel: f64,
    /// Of such a pixel beyond that, if the subobject has a picture.
    pub textured: f64,
    /// Of such a pixel beyond that, if light passes through the subobject.
    pub layer: f64,
}

impl CostModel {
    /// Fitted on a machine with AVX-512: six built-in scenes at 1280 × 720 and 16 points, one thread. The root mean square of the relative error is
    /// 0.37 on frames that did not take part in the fit: 0.14 to 0.21 by scene, but 0.84 (too little) for `runway`, whose pixels are all seen, while
    /// most of the others' are hidden. Triangles add nothing to what vertices say.
    pub const MEASURED: Self = Self { vertex: 500.0, triangle: 0.0, pixel: 0.23, textured: 15.6, layer: 15.6 };

    /// From the model's terms.
    pub fn of([vertex, triangle, pixel, textured, layer]: [f64; TERMS]) -> Self {
        Self { vertex, triangle, pixel, textured, layer }
    }

    /// What doesn't depend on where an object is, ns; and what it takes for each pixel that a square metre covers, ns.
    pub fn parts(&self, content: Content) -> [f64; 2] {
        let fixed = self.vertex * f64::from(content.vertices) + self.triangle * f64::from(content.triangles);
        let own = [(self.pixel, content.area), (self.textured, content.textured), (self.layer, content.translucent)];
        [fixed, own.into_iter().map(|(number, area)| number * f64::from(area)).sum()]
    }
}

/// Pixels that a square metre covers at an object's distance, for `elements` of them to a radian. `squared` is the square of the distance of its
/// ball's centre, m²; within the ball it's as far as the ball's surface.
#[inline(always)]
pub fn covered(radius: f64, squared: f64, elements: f64) -> f64 {
    let far = if squared > radius * radius { squared } else { radius * radius };
    // A point has no pixels, not even of its own distance.
    if far > 0.0 { elements * elements / far } else { 0.0 }
}

/// Non-negative numbers that make Σ number · term the nearest to the measured value, relative to that, over all rows; and the root mean square of
/// the relative errors that are left. `None` if the rows don't determine them.
pub fn fit(rows: &[([f64; TERMS], f64)]) -> Option<([f64; TERMS], f64)> {
    let scaled: Vec<[f64; TERMS]> = rows.iter().map(|(terms, value)| terms.map(|term| term / value)).collect();
    let mut used = [true; TERMS];
    loop {
        let mut normal = [[0.0; TERMS]; TERMS];
        let mut right = [0.0; TERMS];
        for row in &scaled {
            for i in (0..TERMS).filter(|&i| used[i]) {
                right[i] += row[i];
                (0..TERMS).filter(|&j| used[j]).for_each(|j| normal[i][j] += row[i] * row[j]);
            }
        }
        // Terms that are left out have the equation number = 0.
        (0..TERMS).filter(|&i| !used[i]).for_each(|i| normal[i][i] = 1.0);
        // Terms differ by orders of magnitude: brought to one scale first.
        let size: [f64; TERMS] = std::array::from_fn(|i| normal[i][i].sqrt());
        if size.iter().any(|&size| !size.is_finite() || size <= 0.0) {
            return None;
        }
        let even: [[f64; TERMS]; TERMS] =
            std::array::from_fn(|i| std::array::from_fn(|j| normal[i][j] / (size[i] * size[j])));
        let solved = solve(even, std::array::from_fn(|i| right[i] / size[i]))?;
        let numbers: [f64; TERMS] = std::array::from_fn(|i| solved[i] / size[i]);
        let worst = (0..TERMS).filter(|&i| used[i]).min_by(|&a, &b| numbers[a].total_cmp(&numbers[b]))?;
        if numbers[worst] < 0.0 {
            used[worst] = false;
            continue;
        }
        let error = |row: &[f64; TERMS]| row.iter().zip(&numbers).map(|(a, b)| a * b).sum::<f64>() - 1.0;
        let squares: f64 = scaled.iter().map(|row| error(row).powi(2)).sum();
        return Some((numbers, (squares / rows.len().max(1) as f64).sqrt()));
    }
}

/// The solution of a symmetric positive definite system of diagonal 1, by elimination; `None` if it has hardly one.
fn solve(mut rows: [[f64; TERMS]; TERMS], mut right: [f64; TERMS]) -> Option<[f64; TERMS]> {
    for k in 0..TERMS {
        if rows[k][k] < 1e-9 {
            return None;
        }
        for i in k + 1..TERMS {
            let part = rows[i][k] / rows[k][k];
            let above = rows[k];
            rows[i].iter_mut().zip(above).skip(k).for_each(|(own, above)| *own -= part * above);
            right[i] -= part * right[k];
        }
    }
    for k in (0..TERMS).rev() {
        let known: f64 = (k + 1..TERMS).map(|j| rows[k][j] * right[j]).sum();
        right[k] = (right[k] - known) / rows[k][k];
    }
    Some(right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_square_metre_covers_its_solid_angle_and_within_the_ball_no_more_than_at_its_surface() {
        assert!((covered(1.0, 100.0, 1000.0) - 1e4).abs() < 1e-9);
        assert_eq!(covered(2.0, 0.0, 10.0), covered(2.0, 4.0, 10.0));
        assert_eq!(covered(0.0, 0.0, 10.0), 0.0);
    }

    #[test]
    fn what_a_term_takes_away_is_left_out() {
        let rows: Vec<_> = (1..20)
            .map(|i| {
                let x = f64::from(i);
                let terms = [x, x * x % 7.0 + 1.0, 40.0 - x, x.sqrt(), x * x % 11.0 + 2.0];
                (terms, 5.0 * terms[0] + 100.0 - 0.01 * terms[2])
            })
            .collect();
        let (numbers, _) = fit(&rows).unwrap();
        assert!(numbers.iter().all(|&number| number >= 0.0), "{numbers:?}");
        assert_eq!(fit(&[([1.0; TERMS], 1.0)]), None, "one row is too few");
    }

    proptest! {
        #[test]
        fn what_is_linear_is_found_again(
            numbers in prop::array::uniform5(0.1..100.0f64),
            rows in prop::collection::vec(prop::array::uniform5(1.0..1000.0f64), 15..40),
        ) {
            let value = |terms: &[f64; TERMS]| terms.iter().zip(&numbers).map(|(a, b)| a * b).sum();
            let rows: Vec<_> = rows.into_iter().map(|terms| (terms, value(&terms))).collect();
            let (found, error) = fit(&rows).unwrap();
            prop_assert!(error < 1e-6, "error {error}");
            for (a, b) in found.iter().zip(&numbers) {
                prop_assert!((a / b - 1.0).abs() < 1e-4, "{found:?}, {numbers:?}");
            }
        }
    }
}
