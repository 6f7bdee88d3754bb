//! What drawing an object is predicted to take, and how that is found out.
//!
//! The model is linear in what is known before a pixel is drawn: vertices, triangles, the pixels that the object's ball would cover,
//! and those pixels again for each of its translucent subobjects. Its numbers are fitted to measured times of whole frames by least squares of the *relative* error
//! (a frame of 2 ms counts as much as one of 200), and are never negative: `cyclorama bench lists --fit` does it again on the machine it runs on.
//! It predicts shares of work, not deadlines: what is hidden costs less than it says, so an object in the last row is overrated.

use crate::scene::blocks::Content;
use glam::DMat4;

/// Numbers of the model.
pub const TERMS: usize = 4;

/// ns of one thread, each.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct CostModel {
    /// Of a vertex.
    pub vertex: f64,
    /// Of a triangle.
    pub triangle: f64,
    /// Of a pixel that the ball covers.
    pub pixel: f64,
    /// Of such a pixel, for each translucent subobject.
    pub layer: f64,
}

impl CostModel {
    /// PLACEHOLDER
    pub const MEASURED: Self = Self { vertex: 10.0, triangle: 20.0, pixel: 1.0, layer: 2.0 };

    /// From the model's terms.
    pub fn of([vertex, triangle, pixel, layer]: [f64; TERMS]) -> Self {
        Self { vertex, triangle, pixel, layer }
    }

    /// What doesn't depend on where an object is, ns; and what each of its pixels takes, ns.
    pub fn parts(&self, content: Content) -> [f64; 2] {
        let fixed = self.vertex * f64::from(content.vertices) + self.triangle * f64::from(content.triangles);
        [fixed, self.pixel + self.layer * f64::from(content.translucent)]
    }
}

/// Pixels that a ball covers, for `elements` of them to a radian; all that it could if the eye is in it. `squared` is the square of the
/// centre's distance, m².
#[inline(always)]
pub fn covered(radius: f64, squared: f64, elements: f64) -> f64 {
    let spanned = radius * radius / if squared > radius * radius { squared } else { radius * radius };
    // A point has no pixels, not even of its own distance.
    let spanned = if spanned > 0.0 { spanned } else { 0.0 };
    std::f64::consts::PI * elements * elements * spanned
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
        let matrix = DMat4::from_cols_array_2d(&even);
        if matrix.determinant().abs() < 1e-9 {
            return None;
        }
        let solved = matrix.inverse() * glam::DVec4::from_array(std::array::from_fn(|i| right[i] / size[i]));
        let numbers: [f64; TERMS] = std::array::from_fn(|i| solved.to_array()[i] / size[i]);
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_ball_covers_its_circle_and_all_of_it_from_inside() {
        assert!((covered(1.0, 100.0, 1000.0) - std::f64::consts::PI * 1e4).abs() < 1e-6);
        assert_eq!(covered(2.0, 0.0, 10.0), covered(2.0, 4.0, 10.0));
        assert_eq!(covered(0.0, 0.0, 10.0), 0.0);
    }

    #[test]
    fn what_a_term_takes_away_is_left_out() {
        let rows: Vec<_> = (1..20)
            .map(|i| {
                let x = f64::from(i);
                let terms = [x, x * x % 7.0 + 1.0, 40.0 - x, x.sqrt()];
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
            numbers in prop::array::uniform4(0.1..100.0f64),
            rows in prop::collection::vec(prop::array::uniform4(1.0..1000.0f64), 12..40),
        ) {
            let value = |terms: &[f64; 4]| terms.iter().zip(&numbers).map(|(a, b)| a * b).sum();
            let rows: Vec<_> = rows.into_iter().map(|terms| (terms, value(&terms))).collect();
            let (found, error) = fit(&rows).unwrap();
            prop_assert!(error < 1e-6, "error {error}");
            for (a, b) in found.iter().zip(&numbers) {
                prop_assert!((a / b - 1.0).abs() < 1e-4, "{found:?}, {numbers:?}");
            }
        }
    }
}
