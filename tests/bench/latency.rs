//! From the host's packet to the swap, in a rig that flies in real time.

use crate::{Figure, at_least, at_most};
use serde::Serialize;

/// A distribution, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Times {
    /// Median.
    pub p50: f64,
    /// 99 % are below.
    pub p99: f64,
    /// 99.9 % are below.
    pub p999: f64,
    /// The largest.
    pub max: f64,
}

/// What displays said of their changes of picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Displays {
    /// Swaps.
    pub swaps: u64,
    /// Of these, those after which every view showed that frame.
    pub same: u64,
    /// From the first display's change to the last one's, where they showed the same frame.
    pub skew: Times,
}

/// A flight.
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
    /// Frames a second.
    pub rate_hz: f64,
    /// How long it took.
    pub seconds: f64,
    /// Frames swapped.
    pub frames: u64,
    /// Of these, with a view that repeated.
    pub late_frames: u64,
    /// How many periods a frame took at the end: more than one is overload.
    pub rate_divider: u64,
    /// From the host's packet to the swap.
    pub latency: Times,
    /// From opening a frame to its swap.
    pub frame: Times,
    /// Where each view has a display of its own.
    pub displays: Option<Displays>,
    /// By stage, in the order of a frame.
    pub stages: Vec<(String, Times)>,
}

/// The row as a table.
pub fn table(row: &Row) -> String {
    let [width, height] = row.size;
    let mut text = format!(
        "{}, {} views of {width}x{height}, {} boards, {} Hz, {:.0} s: {} frames, {} late, at the end every period of {}\n",
        row.scene, row.views, row.boards, row.rate_hz, row.seconds, row.frames, row.late_frames, row.rate_divider
    );
    text += &format!("{:<16} {:>9} {:>9} {:>9} {:>9}\n", "ms", "p50", "p99", "p99.9", "max");
    let whole = [("packet to swap".to_owned(), row.latency), ("open to swap".to_owned(), row.frame)];
    let skew = row.displays.map(|displays| ("display skew".to_owned(), displays.skew));
    for (name, Times { p50, p99, p999, max }) in whole.iter().chain(&skew).chain(&row.stages) {
        text += &format!("{name:<16} {p50:>9.3} {p99:>9.3} {p999:>9.3} {max:>9.3}\n");
    }
    text
}

/// proof.md's figures of latency and swaps.
pub fn figures(row: &Row) -> Vec<Figure> {
    let period = 1e3 / row.rate_hz;
    let long_enough = |value: f64| {
        if row.seconds >= 599.0 { Ok(value) } else { Err("the target is for ten minutes or more".to_owned()) }
    };
    let displays = || row.displays.filter(|displays| displays.swaps > 0).ok_or("no two displays were there".to_owned());
    let same = displays().map(|displays| 100.0 * displays.same as f64 / displays.swaps as f64);
    let skew = displays().and_then(|displays| long_enough(displays.skew.p999));
    vec![
        at_most("latency.p50_periods", "", "<= 1.5", 1.5, Ok(row.latency.p50 / period)),
        at_most("latency.p999_periods", "", "<= 2", 2.0, long_enough(row.latency.p999 / period)),
        at_most("latency.max_ms", "ms", "<= 50", 50.0, long_enough(row.latency.max)),
        at_least("swap.same_frame", "%", "100 %", 100.0, same),
        at_most("swap.skew_p999_ms", "ms", "<= 1", 1.0, skew),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_of_the_rate_and_short_flights_say_nothing_of_rare_frames() {
        let latency = Times { p50: 20.0, p99: 30.0, p999: 45.0, max: 49.0 };
        let row = Row {
            scene: "city".into(),
            views: 1,
            boards: 1,
            size: [96, 54],
            rate_hz: 50.0,
            seconds: 600.0,
            frames: 30_000,
            late_frames: 0,
            rate_divider: 1,
            latency,
            frame: latency,
            displays: Some(Displays { swaps: 1000, same: 999, skew: Times { p999: 0.5, ..Times::default() } }),
            stages: Vec::new(),
        };
        let found = figures(&row);
        assert_eq!((found[0].value, found[0].met), (Some(1.0), Some(true)));
        assert_eq!((found[1].value, found[1].met), (Some(2.25), Some(false)));
        assert_eq!((found[3].value, found[3].met), (Some(99.9), Some(false)), "each swap counts");
        assert_eq!((found[4].value, found[4].met), (Some(0.5), Some(true)));
        let short = figures(&Row { seconds: 10.0, ..row });
        assert_eq!((short[0].met, short[2].value), (Some(true), None));
    }
}
