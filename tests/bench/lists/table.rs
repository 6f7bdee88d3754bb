//! The rows and figures as a person reads them.

use super::{Row, What};
use crate::Figure;
use std::fmt::Write;

/// The rows, their stages beside; the operations; the figures.
pub fn table(rows: &[Row], figures: &[Figure]) -> String {
    let mut out = String::new();
    // Writing to a string can't fail.
    let _ = writeln!(
        out,
        "{:<10} {:>9} {:>8} {:>3} {:>5} {:>9} {:>9} {:>9} {:>9} | {:>7} {:>7} {:>7} {:>7} {:>7} | {:>8} {:>8} {:>9} {:>7} {:>7}",
        "what",
        "objects",
        "changes",
        "p",
        "lists",
        "ms min",
        "median",
        "max",
        "cpu med.",
        "walk",
        "mark",
        "gather",
        "sort",
        "merge",
        "in view",
        "visible",
        "subobj.",
        "overlap",
        "bytes/o"
    );
    for row in rows {
        let stages = row.stage_ms.unwrap_or_default();
        let _ = writeln!(
            out,
            "{:<10} {:>9} {:>8} {:>3} {:>5} {:>9.3} {:>9.3} {:>9.3} {:>9} | {:>7.2} {:>7.2} {:>7.2} {:>7.2} {:>7.2} | {:>8} {:>8} {:>9} {:>7} {:>7.1}{}",
            row.what,
            row.objects,
            row.change,
            row.processors,
            row.lists,
            row.ms.min,
            row.ms.median,
            row.ms.max,
            row.cpu_ms.map_or_else(|| "-".into(), |cpu| format!("{:.3}", cpu.median)),
            stages.walk,
            stages.mark,
            stages.gather,
            stages.sort,
            stages.merge,
            row.in_view,
            row.visible,
            row.subobjects,
            row.overlapping,
            row.bytes_per_object,
            match (&row.variant, row.least_elements) {
                (Some(variant), _) => format!("  {variant}"),
                (None, None) if row.what == What::Frame => "  nothing dropped for being small".into(),
                _ => String::new(),
            },
        );
    }
    let counted = rows.iter().filter_map(|row| Some((row, row.operations?)));
    let _ = writeln!(
        out,
        "\noperations of a frame, ours as counted / the paper's formulas (planes {}, points {})\n{:>9} {:>21} {:>21} {:>21} {:>21} {:>21} {:>9}",
        super::PLANES,
        super::POINTS,
        "objects",
        "compare",
        "memory",
        "add",
        "multiply",
        "divide",
        "ours/p."
    );
    for (row, [ours, paper]) in counted {
        let pair = |ours: f64, paper: f64| format!("{ours:.2e} / {paper:.2e}");
        let _ = writeln!(
            out,
            "{:>9} {:>21} {:>21} {:>21} {:>21} {:>21} {:>9.4}",
            row.objects,
            pair(ours.comparisons, paper.comparisons),
            pair(ours.memory, paper.memory),
            pair(ours.additions, paper.additions),
            pair(ours.multiplications, paper.multiplications),
            pair(ours.divisions, paper.divisions),
            ours.sum() / paper.sum(),
        );
    }
    let _ = writeln!(out);
    for figure in figures {
        let _ = writeln!(out, "{figure}");
    }
    out
}
