//! What travels on a rig's links.

use crate::{Figure, Spread};
use serde::Serialize;
use std::fmt;

/// A flight in which every pose is a frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Flight {
    /// Frames flown.
    pub frames: u64,
    /// Frame messages to one board: the frame's state, what has moved, changes of lists; mean over frames and boards.
    pub bytes_per_frame: f64,
}

/// What a process of a rig takes while nothing happens.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Process {
    /// Its command: `manager`, `channel`, `compositor` or `host`.
    pub what: String,
    /// Processor time against time, of one core.
    pub cpu_percent: f64,
    /// Its resident set, MiB: what it shares with others, such as the program itself, is counted for each.
    pub memory_mib: f64,
}

/// A scene in which nothing happens; bytes and `cpu_percent` per board.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Still {
    /// How long it was watched.
    pub seconds: f64,
    /// Processor time of a board against time, of one core.
    pub cpu_percent: Spread,
    /// Each process of the rig.
    pub processes: Vec<Process>,
    /// Everything from the manager.
    pub bytes_to_board_per_s: f64,
    /// Everything to the manager.
    pub bytes_from_board_per_s: f64,
    /// To the compositor.
    pub tile_bytes_per_s: f64,
}

/// One rig.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// What was shown.
    pub scene: String,
    /// Number of views.
    pub views: u32,
    /// Number of boards.
    pub boards: usize,
    /// Of each view, pixels.
    pub size: [u32; 2],
    /// With a moving eye.
    pub flight: Flight,
    /// With a still one.
    pub still: Still,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, views, boards, size: [width, height], flight, still } = self;
        writeln!(f, "{scene}, {views} views of {width}x{height}, {boards} boards")?;
        writeln!(f, "flight: {:.0} bytes a frame to each board ({} frames)", flight.bytes_per_frame, flight.frames)?;
        let Still {
            seconds,
            cpu_percent,
            processes,
            bytes_to_board_per_s: to,
            bytes_from_board_per_s: from,
            tile_bytes_per_s: tiles,
        } = still;
        writeln!(
            f,
            "still, {seconds:.1} s: {:.2} % of a core (worst board {:.2} %); {to:.0} bytes/s to each board, {from:.0} back, {tiles:.0} to the compositor",
            cpu_percent.median, cpu_percent.max
        )?;
        processes.iter().try_for_each(|process| {
            let Process { what, cpu_percent, memory_mib } = process;
            writeln!(f, "  {what:<10} {cpu_percent:>5.2} % of a core, {memory_mib:>5.1} MiB")
        })
    }
}

/// The figures of proof.md; of boards the worst counts for time, their mean for bytes.
pub fn figures(row: &Row) -> Vec<Figure> {
    let figure = |figure, value: f64, limit: f64, unit, target| Figure {
        figure,
        value: Some(value),
        unit,
        target,
        met: Some(value < limit),
        why: None,
    };
    let still = &row.still;
    let bytes = still.bytes_to_board_per_s + still.bytes_from_board_per_s + still.tile_bytes_per_s;
    let mut figures = vec![
        figure("still.cpu_percent", still.cpu_percent.max, 1.0, "%", "< 1"),
        figure("still.bytes_per_s", bytes, 1000.0, "B/s", "< 1000"),
        figure("wire.bytes_per_frame", row.flight.bytes_per_frame, 20_000.0, "B", "< 20 000"),
    ];
    if row.scene != "city" {
        // The target is one of that scene.
        figures[2].met = None;
    }
    figures
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worst_board_and_all_directions_count() {
        let still = Still {
            seconds: 10.0,
            cpu_percent: Spread::of(&[0.2, 1.5]),
            processes: vec![Process { what: "manager".into(), cpu_percent: 0.7, memory_mib: 27.0 }],
            bytes_to_board_per_s: 400.0,
            bytes_from_board_per_s: 300.0,
            tile_bytes_per_s: 50.0,
        };
        let flight = Flight { frames: 9, bytes_per_frame: 20_001.0 };
        let row = Row { scene: "city".into(), views: 3, boards: 3, size: [320, 180], flight, still };
        assert!(row.to_string().contains("  manager     0.70 % of a core,  27.0 MiB\n"), "{row}");
        let met = |row: &Row| figures(row).iter().map(|figure| (figure.figure, figure.met)).collect::<Vec<_>>();
        let of = [Some(false), Some(true), Some(false)];
        assert_eq!(met(&row).iter().map(|(_, met)| *met).collect::<Vec<_>>(), of);
        assert_eq!(figures(&row)[1].value, Some(750.0));
        assert_eq!(met(&Row { scene: "airport".into(), ..row })[2], ("wire.bytes_per_frame", None));
    }
}
