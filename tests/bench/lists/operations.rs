//! The paper's table of operations (seed 000, section 5), ours beside it.
//!
//! Ours are counted: how often each kernel ran in a frame, as the selection's counters say, times the operations in its body. What a loop costs to go
//! round, and what a processor does four at a time, isn't in it, and wasn't in the paper's.

use super::paper::Operations;

/// Planes of an object in the paper's formulas: an object of ours has four subobjects.
pub const PLANES: f64 = 4.0;
/// Points of a plane.
pub const POINTS: f64 = 4.0;

/// How often the kernels ran.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counted {
    /// Balls against the planes of a view: branches, objects and subobjects.
    pub balls: u64,
    /// Objects of which the distance was worked out.
    pub measured: u64,
    /// Subobjects whose power was worked out and sorted.
    pub sorted: u64,
}

fn operations(comparisons: f64, memory: f64, additions: f64, multiplications: f64, divisions: f64) -> Operations {
    Operations { comparisons, memory, additions, multiplications, divisions }
}

/// Operations of these.
pub fn ours(counted: &Counted) -> Operations {
    // Frustum::ball: from the apex 3 additions; the slack 3 and 1 multiplication; five planes of 3 multiplications, 4 additions and 2 comparisons;
    // the range 3 multiplications, 2 + 4 additions, a root (with the divisions) and 2 comparisons. Reads: the ball, four numbers.
    let ball = operations(12.0, 4.0, 32.0, 19.0, 1.0);
    // Near::load and large: 4 numbers to metres, 6 additions; 3 squares, 2 additions; 2 multiplications and a comparison.
    let measured = operations(1.0, 9.0, 8.0, 9.0, 0.0);
    // The power: as above, the square of the radius, then the step: 2 additions, 1 multiplication, 2 comparisons; 5 reads, 1 write. Parting: 1 comparison,
    // 3 accesses. Counting and placing: 7 accesses, 2 additions. Insertion: 1.5 comparisons, 3 accesses. Out, merged: 1 comparison, 4 accesses.
    let sorted = operations(5.5, 23.0, 13.0, 9.0, 0.0);
    let parts = [(ball, counted.balls), (measured, counted.measured), (sorted, counted.sorted)];
    parts.into_iter().fold(Operations::default(), |sum, (each, count)| {
        let count = count as f64;
        Operations {
            comparisons: sum.comparisons + each.comparisons * count,
            memory: sum.memory + each.memory * count,
            additions: sum.additions + each.additions * count,
            multiplications: sum.multiplications + each.multiplications * count,
            divisions: sum.divisions + each.divisions * count,
        }
    })
}

/// Ours, and the paper's for so many objects of which so many overlap.
pub fn comparison(counted: &Counted, objects: usize, overlapping: f64) -> [Operations; 2] {
    [ours(counted), Operations::of_paper(objects as f64, overlapping, PLANES, POINTS)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_sums_over_what_ran() {
        let one = ours(&Counted { balls: 1, measured: 1, sorted: 1 });
        let ten = ours(&Counted { balls: 10, measured: 10, sorted: 10 });
        assert!((ten.sum() - 10.0 * one.sum()).abs() < 1e-9);
        assert_eq!(ours(&Counted::default()).sum(), 0.0);
    }
}
