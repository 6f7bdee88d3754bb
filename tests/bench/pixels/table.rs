//! The rows and figures as a person reads them.

use super::{Renderer, Row, Sampling};
use crate::Figure;
use std::fmt::Write;
use std::path::Path;

/// The rows, ours in detail below, and the figures at the end.
pub fn table(rows: &[Row], figures: &[Figure]) -> String {
    let mut out = String::new();
    // Writing to a string can't fail.
    let _ = writeln!(
        out,
        "{:<16} {:<10} {:>5} {:>7} {:>9} {:>9} {:>9} {:>8} {:>8} {:>10} {:>10} {:>9}",
        "scene",
        "renderer",
        "n",
        "threads",
        "ms min",
        "median",
        "max",
        "/peer 0",
        "/peer 4",
        "rms edges",
        "rms all",
        "instr/px"
    );
    for row in rows {
        let against = |n: usize| {
            let peer = rows.iter().find(|other| {
                other.scene == row.scene
                    && other.renderer == Renderer::Llvmpipe
                    && other.samples == Some(Sampling::Points(n))
                    && other.threads == row.threads
            });
            number(peer.map(|peer| row.ms.median / peer.ms.median), 3)
        };
        let _ = writeln!(
            out,
            "{:<16} {:<10} {:>5} {:>7} {:>9.2} {:>9.2} {:>9.2} {:>8} {:>8} {:>10} {:>10} {:>9}{}",
            short(&row.scene),
            row.renderer.to_string(),
            row.samples.map_or("-".into(), |samples| samples.to_string()),
            row.threads,
            row.ms.min,
            row.ms.median,
            row.ms.max,
            against(0),
            against(4),
            scientific(row.rms_edges),
            scientific(row.rms_all),
            number(row.instructions.map(|count| count as f64 / f64::from(row.size[0] * row.size[1])), 1),
            row.variant.as_ref().map_or(String::new(), |variant| format!("  {variant}")),
        );
    }
    let _ = writeln!(
        out,
        "\n{:<16} {:>5} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} {:>7}\n{:<16} {:>5} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} {:>7}",
        "cyclorama",
        "n",
        "threads",
        "select",
        "geometry",
        "raster",
        "transl",
        "resolve",
        "uneven",
        "edges",
        "plain",
        "magn",
        "minif",
        "",
        "",
        "",
        "ms",
        "ms",
        "ms",
        "ms",
        "ms",
        "max/mean",
        "rms 255",
        "max",
        "p99",
        "p99"
    );
    for (row, work) in rows.iter().filter_map(|row| Some((row, row.work?))) {
        let stage = work.stage_ms;
        let errors = row.errors_255;
        let _ = writeln!(
            out,
            "{:<16} {:>5} {:>7} {:>8.2} {:>8.2} {:>8.2} {:>8.2} {:>8.2} {:>8.2} | {:>7} {:>7} {:>7} {:>7}",
            short(&row.scene),
            row.samples.map_or("-".into(), |samples| samples.to_string()),
            row.threads,
            stage.select,
            stage.geometry,
            stage.raster,
            stage.translucency,
            stage.resolve,
            work.imbalance,
            number(errors.map(|e| e.edges_rms), 2),
            number(errors.map(|e| e.untextured_max), 2),
            number(errors.map(|e| e.magnified_p99), 2),
            number(errors.map(|e| e.minified_p99), 2),
        );
    }
    let _ = writeln!(out, "\n{:<28} {:>10} {:<10} target", "figure", "value", "");
    for figure in figures {
        let _ = writeln!(out, "{figure}");
    }
    out
}

/// A scene's name without folder and extension.
fn short(scene: &str) -> String {
    Path::new(scene).file_stem().map_or_else(|| scene.to_owned(), |stem| stem.to_string_lossy().into_owned())
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".into(), |value| format!("{value:.digits$}"))
}

fn scientific(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.2e}"))
}

#[cfg(test)]
mod tests {
    use super::super::figures::{Setting, figures, tests::rows};
    use super::*;

    #[test]
    fn every_row_has_its_ratios_and_every_figure_its_verdict() {
        let rows = rows();
        let figures = figures(&rows, &Setting { threads: 2, ..Setting::default() });
        let text = table(&rows, &figures);
        let line = |parts: [&str; 3]| {
            let found = text.lines().find(|line| line.split_whitespace().zip(parts).all(|(a, b)| a == b));
            found.unwrap_or_else(|| panic!("no {parts:?} in\n{text}"))
        };
        assert!(line(["overdraw", "cyclorama", "64"]).contains("0.400    0.100    6.00e-3"), "{text}");
        assert!(line(["runway", "memory", "-"]).contains("0.50"), "{text}");
        assert!(line(["city", "cyclorama", "1"]).ends_with("without something"), "{text}");
        for figure in &figures {
            let verdict = if figure.met.unwrap() { "met" } else { "missed" };
            assert!(text.lines().any(|line| line.starts_with(figure.figure) && line.ends_with(verdict)), "{text}");
        }
    }
}
