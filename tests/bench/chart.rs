//! A chart of error against time as SVG: both axes logarithmic, one curve per renderer, one point per sample count.

use std::fmt::Write;

/// A renderer's points.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name.
    pub name: String,
    /// Time in ms, error, and a label such as the number of samples.
    pub points: Vec<(f64, f64, String)>,
}

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 440.0;
const LEFT: f64 = 80.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 60.0;
const COLOURS: [&str; 5] = ["#1f6fb4", "#c2571a", "#3a8f4d", "#8b4fa6", "#666666"];

/// Whole decades that hold all values.
fn decades(values: impl Iterator<Item = f64> + Clone) -> (i32, i32) {
    let usable = values.filter(|v| v.is_finite() && *v > 0.0);
    let low = usable.clone().fold(f64::INFINITY, f64::min);
    let high = usable.fold(0.0, f64::max);
    if low > high {
        return (0, 1);
    }
    let (from, to) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    (from, to.max(from + 1))
}

/// The chart.
pub fn error_against_time(title: &str, curves: &[Curve]) -> String {
    let points = || curves.iter().flat_map(|curve| curve.points.iter());
    let (x0, x1) = decades(points().map(|p| p.0));
    let (y0, y1) = decades(points().map(|p| p.1));
    let place = |value: f64, from: i32, to: i32| (value.log10() - f64::from(from)) / f64::from(to - from);
    let x = |time: f64| LEFT + place(time, x0, x1) * (WIDTH - LEFT - RIGHT);
    let y = |error: f64| HEIGHT - BOTTOM - place(error, y0, y1) * (HEIGHT - TOP - BOTTOM);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n\
         <text x=\"{LEFT}\" y=\"24\" font-size=\"16\">{title}</text>\n"
    );
    // Writing to a string can't fail.
    for decade in x0..=x1 {
        let at = x(10f64.powi(decade));
        let bottom = HEIGHT - BOTTOM;
        let _ = writeln!(
            out,
            "<path d=\"M{at:.1} {TOP} V{bottom}\" stroke=\"#ddd\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
            bottom + 18.0,
            label(decade)
        );
    }
    for decade in y0..=y1 {
        let at = y(10f64.powi(decade));
        let right = WIDTH - RIGHT;
        let _ = writeln!(
            out,
            "<path d=\"M{LEFT} {at:.1} H{right}\" stroke=\"#ddd\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 8.0,
            at + 4.0,
            label(decade)
        );
    }
    let _ = writeln!(
        out,
        "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\">time per frame, ms</text>",
        (LEFT + WIDTH - RIGHT) / 2.0,
        HEIGHT - 16.0
    );
    let _ = writeln!(
        out,
        "<text transform=\"translate(20 {:.1}) rotate(-90)\" text-anchor=\"middle\">rms error of edge pixels, linear full scale</text>",
        (TOP + HEIGHT - BOTTOM) / 2.0
    );
    for (i, curve) in curves.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let drawn: Vec<_> = curve.points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).collect();
        let path: Vec<String> = drawn.iter().map(|p| format!("{:.1},{:.1}", x(p.0), y(p.1))).collect();
        let _ = writeln!(
            out,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>",
            path.join(" ")
        );
        for (time, error, label) in drawn {
            let (px, py) = (x(*time), y(*error));
            let _ = writeln!(
                out,
                "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"4\" fill=\"{colour}\"/><text x=\"{:.1}\" y=\"{:.1}\" fill=\"{colour}\">{label}</text>",
                px + 7.0,
                py - 6.0
            );
        }
        let at = TOP + 18.0 * i as f64;
        let left = WIDTH - RIGHT + 14.0;
        let _ = writeln!(
            out,
            "<path d=\"M{left} {at:.1} h18\" stroke=\"{colour}\" stroke-width=\"2\"/><text x=\"{:.1}\" y=\"{:.1}\">{}</text>",
            left + 24.0,
            at + 4.0,
            curve.name
        );
    }
    out.push_str("</svg>\n");
    out
}

fn label(decade: i32) -> String {
    if (-3..=4).contains(&decade) { format!("{}", 10f64.powi(decade)) } else { format!("1e{decade}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_lies_on_the_chart() {
        let points = vec![(0.5, 0.2, "1".into()), (30.0, 0.003, "64".into()), (3.0, 0.0, "exact".into())];
        let svg = error_against_time("city", &[Curve { name: "cyclorama".into(), points }]);
        assert_eq!(svg.matches("<circle").count(), 2, "an error of zero has no place on a logarithmic axis");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }
}
