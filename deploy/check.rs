//! `cyclorama check`: is this rig right, and what does each view see?
//!
//! Every view's field, its resolution at the middle, and the gap or overlap to its neighbour at the horizon; a drawing
//! of all frusta from above, as SVG.

use crate::cli::CheckArgs;
use crate::error::CommandError;
use crate::output::say;
use crate::rig_file::RigFile;
use crate::{settings, source};
use glam::DVec3;
use proto::view::ViewSetup;
use serde::Serialize;
use std::fmt::Write;

/// A gap or overlap smaller than this is none, degrees: a hundredth of a pixel of a usual projector.
const ANGLE_TOLERANCE_DEG: f64 = 5e-4;
/// Pixels that differ more from squares than this are worth a word.
const ASPECT_TOLERANCE: f64 = 0.01;

/// What one view sees.
#[derive(Debug, Serialize)]
struct Seen {
    name: String,
    size: [u32; 2],
    /// Degrees.
    horizontal_fov_deg: f64,
    vertical_fov_deg: f64,
    /// Of the window's middle: to the right of straight ahead, and above it, degrees.
    yaw_deg: f64,
    pitch_deg: f64,
    /// Of one pixel at the window's middle, minutes of arc.
    pixel_arcmin: f64,
    /// From its left to its right border at the horizon, degrees to the right of straight ahead.
    #[serde(skip)]
    span: [f64; 2],
}

#[derive(Debug, Serialize)]
struct Findings {
    views: Vec<Seen>,
    warnings: Vec<String>,
}

/// Runs the command.
pub(crate) fn run(args: &CheckArgs) -> Result<(), CommandError> {
    let file = RigFile::read(&args.rig)?;
    let views = named_views(&file)?;
    settings::environment(&crate::cli::AirArgs::default(), &file.air)?;
    if let Some(scene) = &file.scene {
        source::load(scene, file.camera.as_deref().map(std::path::Path::new))?;
    }
    let findings = examine(&views);
    if let Some(drawing) = &args.output {
        std::fs::write(drawing, draw(&views, &findings.views)).map_err(|error| CommandError::file(drawing, error))?;
    }
    if args.json {
        let text = serde_json::to_string_pretty(&findings);
        say(&text.map_err(|error| CommandError::said(error.to_string()))?);
    } else {
        say(table(&findings).trim_end());
    }
    Ok(())
}

fn named_views(file: &RigFile) -> Result<Vec<(String, ViewSetup)>, CommandError> {
    if file.views.is_empty() {
        let args = crate::cli::RowArgs { views: None, size: None, samples: None };
        let row = settings::row(&args, None, file)?;
        let fov = manager::host::camera::FOV_DEFAULT_DEG;
        let views = row.views(proto::view::Tangents::symmetric(fov, row.width, row.height));
        return Ok(views.into_iter().enumerate().map(|(i, view)| (format!("view {i}"), view)).collect());
    }
    file.views.iter().map(|entry| Ok((entry.name.clone(), settings::view(entry)?))).collect()
}

/// Degrees to the right of straight ahead (−Z).
fn yaw_deg(direction: DVec3) -> f64 {
    direction.x.atan2(-direction.z).to_degrees()
}

fn examine(views: &[(String, ViewSetup)]) -> Findings {
    let mut warnings = Vec::new();
    let seen: Vec<Seen> = views
        .iter()
        .map(|(name, setup)| {
            let (view, t) = (&setup.view, &setup.view.tangents);
            let [width, height] = [f64::from(view.width), f64::from(view.height)];
            let turn = |x: f64, y: f64| view.offset.orientation * DVec3::new(x, y, -1.0);
            let middle_y = f64::midpoint(t.bottom, t.top);
            let middle = turn(f64::midpoint(t.left, t.right), middle_y).normalize();
            let (pixel_x, pixel_y) = ((t.right - t.left) / width, (t.top - t.bottom) / height);
            if (pixel_x / pixel_y - 1.0).abs() > ASPECT_TOLERANCE {
                warnings.push(format!("{name}: its pixels are not square ({:.3} wide for 1 high)", pixel_x / pixel_y));
            }
            Seen {
                name: name.clone(),
                size: [view.width, view.height],
                horizontal_fov_deg: (t.right.atan() - t.left.atan()).to_degrees(),
                vertical_fov_deg: (t.top.atan() - t.bottom.atan()).to_degrees(),
                yaw_deg: yaw_deg(middle),
                pitch_deg: middle.y.asin().to_degrees(),
                pixel_arcmin: pixel_y.atan().to_degrees() * 60.0,
                span: [yaw_deg(turn(t.left, 0.0)), yaw_deg(turn(t.right, 0.0))],
            }
        })
        .collect();
    let mut order: Vec<&Seen> = seen.iter().collect();
    order.sort_by(|a, b| a.yaw_deg.total_cmp(&b.yaw_deg));
    for pair in order.windows(2) {
        // From the right border of one to the left border of the next, the short way round.
        let gap = (pair[1].span[0] - pair[0].span[1] + 540.0).rem_euclid(360.0) - 180.0;
        let (left, right) = (&pair[0].name, &pair[1].name);
        if gap > ANGLE_TOLERANCE_DEG {
            warnings.push(format!("{left} and {right}: a gap of {gap:.3} degrees at the horizon"));
        } else if gap < -ANGLE_TOLERANCE_DEG {
            warnings.push(format!("{left} and {right}: they overlap by {:.3} degrees at the horizon", -gap));
        }
    }
    Findings { views: seen, warnings }
}

fn table(findings: &Findings) -> String {
    let mut out = format!(
        "{:<12} {:>11} {:>9} {:>9} {:>8} {:>8} {:>10}\n",
        "view", "size", "fov h", "fov v", "yaw", "pitch", "pixel"
    );
    for view in &findings.views {
        let size = format!("{}x{}", view.size[0], view.size[1]);
        // Writing to a string can't fail.
        let _ = writeln!(
            out,
            "{:<12} {size:>11} {:>8.2}° {:>8.2}° {:>7.2}° {:>7.2}° {:>9.3}'",
            view.name, view.horizontal_fov_deg, view.vertical_fov_deg, view.yaw_deg, view.pitch_deg, view.pixel_arcmin
        );
    }
    for warning in &findings.warnings {
        let _ = writeln!(out, "warning: {warning}");
    }
    if findings.warnings.is_empty() {
        out.push_str("no gap and no overlap at the horizon\n");
    }
    out
}

/// All frusta from above, straight ahead upwards; 800 units square.
fn draw(views: &[(String, ViewSetup)], seen: &[Seen]) -> String {
    const COLOURS: [&str; 6] = ["#2f6fb0", "#b0562f", "#3f8f4f", "#8a4fa8", "#a88b2f", "#2f9c9c"];
    let largest = views.iter().map(|(_, setup)| setup.view.offset.position.length()).fold(0.0, f64::max);
    // The eyepoints take at most a quarter of the picture's radius, however far apart they are.
    let scale = if largest > 0.0 { 90.0 / largest } else { 0.0 };
    let point = |p: DVec3| format!("{:.2},{:.2}", 400.0 + p.x, 400.0 + p.z);
    let mut out = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 800 800\" font-family=\"sans-serif\" font-size=\"16\">\n\
         <rect width=\"800\" height=\"800\" fill=\"white\"/>\n\
         <circle cx=\"400\" cy=\"400\" r=\"360\" fill=\"none\" stroke=\"#ccc\"/>\n\
         <path d=\"M400 30 V770 M30 400 H770\" stroke=\"#eee\"/>\n\
         <text x=\"400\" y=\"22\" text-anchor=\"middle\" fill=\"#777\">straight ahead</text>\n",
    );
    for (i, (name, setup)) in views.iter().enumerate() {
        let (view, colour) = (&setup.view, COLOURS[i % COLOURS.len()]);
        let eye = view.offset.position * scale;
        let border = |tangent: f64| {
            let direction = view.offset.orientation * DVec3::new(tangent, 0.0, -1.0);
            eye + DVec3::new(direction.x, 0.0, direction.z).normalize_or_zero() * 300.0
        };
        let steps = 24;
        let t = &view.tangents;
        let arc: Vec<String> =
            (0..=steps).map(|k| point(border(t.left + (t.right - t.left) * f64::from(k) / f64::from(steps)))).collect();
        let label = border(f64::midpoint(t.left, t.right)) * 0.7;
        let _ = writeln!(
            out,
            "<polygon points=\"{} {}\" fill=\"{colour}\" fill-opacity=\"0.2\" stroke=\"{colour}\"/>",
            point(eye),
            arc.join(" ")
        );
        let _ = writeln!(
            out,
            "<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{colour}\">{}</text>\n<text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#555\" font-size=\"12\">{:.1}° × {:.1}°</text>",
            400.0 + label.x,
            400.0 + label.z,
            escape(name),
            400.0 + label.x,
            418.0 + label.z,
            seen[i].horizontal_fov_deg,
            seen[i].vertical_fov_deg
        );
    }
    out.push_str("</svg>\n");
    out
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn example(name: &str) -> Findings {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs").join(name);
        let file = RigFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
        examine(&named_views(&file).unwrap_or_else(|error| panic!("{error}")))
    }

    #[test]
    fn the_cave_closes_and_the_default_row_does_too() {
        for name in ["cave.toml", "annotated.toml"] {
            let findings = example(name);
            assert!(findings.warnings.is_empty(), "{name}: {:?}", findings.warnings);
            assert_eq!(findings.views.len(), 3, "{name}");
        }
        let cave = example("cave.toml");
        assert!((cave.views[1].horizontal_fov_deg - 90.0).abs() < 1e-9 && cave.views[1].yaw_deg.abs() < 1e-9);
    }

    #[test]
    fn a_gap_and_an_overlap_are_measured() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs/cave.toml");
        let file = RigFile::read(&path).unwrap_or_else(|error| panic!("{error}"));
        let mut views = named_views(&file).unwrap_or_else(|error| panic!("{error}"));
        views[0].1.view.offset.orientation = glam::DQuat::from_rotation_y(95f64.to_radians());
        views[2].1.view.offset.orientation = glam::DQuat::from_rotation_y(-88f64.to_radians());
        let warnings = examine(&views).warnings.join("; ");
        assert!(warnings.contains("left and front: a gap of 5.000 degrees"), "{warnings}");
        assert!(warnings.contains("front and right: they overlap by 2.000 degrees"), "{warnings}");
        let svg = draw(&views, &examine(&views).views);
        assert_eq!(svg.matches("<polygon").count(), 3, "{svg}");
    }
}
