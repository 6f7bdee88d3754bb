//! proof.md's figures of lists, from rows.

use super::{Change, Row, What};
use crate::{Figure, at_most};

/// All figures, each with a value or the reason why it has none.
pub fn figures(rows: &[Row]) -> Vec<Figure> {
    let frame = |objects: usize| {
        let is = |row: &&Row| {
            (row.what, row.change, row.processors, row.objects) == (What::Frame, Change::Eye, 1, objects)
                && row.least_elements.is_some()
        };
        rows.iter().find(is).ok_or_else(|| format!("no row of {objects} objects, one processor, moving eye"))
    };
    let tree = |what: What| rows.iter().find(|row| row.what == what).ok_or_else(|| "run without --no-tree".to_owned());
    let growth = || {
        let (few, many) = (frame(10_000)?, frame(1_000_000)?);
        Ok((many.ms.median / few.ms.median).ln() / (many.objects as f64 / few.objects as f64).ln())
    };
    let ratio = || Ok(tree(What::Tree)?.ms.median / tree(What::TreeAlone)?.ms.median);
    vec![
        at_most("lists.million_ms", "ms", "<= 16", 16.0, frame(1_000_000).map(|row| row.ms.median)),
        at_most("lists.growth", "", "<= 1.1", 1.1, growth()),
        at_most("lists.tree_ratio", "", "<= 2", 2.0, ratio()),
        at_most("lists.bytes_per_object", "bytes", "<= 200", 200.0, frame(1_000_000).map(|row| row.bytes_per_object)),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Spread;

    fn row(objects: usize, median: f64) -> Row {
        Row {
            what: What::Frame,
            objects,
            change: Change::Eye,
            processors: 1,
            lists: 2,
            variant: None,
            least_elements: Some(1.0),
            ms: Spread { min: median, median, max: median },
            cpu_ms: None,
            stage_ms: None,
            in_view: 0,
            visible: 0,
            subobjects: 0,
            overlapping: 0,
            groups: 0,
            bytes_per_object: 120.0,
            operations: None,
        }
    }

    #[test]
    fn growth_is_the_exponent_and_what_is_missing_says_so() {
        let rows = [row(10_000, 0.1), row(1_000_000, 10.0)];
        let found = figures(&rows);
        assert!((found[1].value.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!((found[0].value, found[0].met), (Some(10.0), Some(true)));
        assert_eq!(found[2].value, None);
        assert!(found[2].why.is_some());
    }
}
