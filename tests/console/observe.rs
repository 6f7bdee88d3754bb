//! What monitoring reads: metrics and the dashboard that is drawn from them, health, traces, logs.

use crate::program::{Rig, cyclorama, daemon, get, kill, manager, wait_for};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::process::{Child, Stdio};

const SMALL: [&str; 8] = ["--views", "2", "--boards", "2", "--size", "96x64", "--samples", "1"];

/// The samples of a metrics page, as Prometheus asks for it: name and labels as written, and value.
fn metrics(rig: &Rig) -> BTreeMap<String, f64> {
    let asked = minreq::get(format!("http://{}/metrics", rig.console()));
    let answer =
        asked.with_header("Accept", "application/openmetrics-text;version=1.0.0,text/plain;q=0.5").send().unwrap();
    let kind = answer.headers.iter().find(|(name, _)| name.eq_ignore_ascii_case("content-type"));
    let is_open = kind.is_some_and(|(_, kind)| kind.contains("application/openmetrics-text; version=1.0.0"));
    assert!(answer.status_code == 200 && is_open, "{:?}", answer.headers);
    let text = answer.as_str().unwrap();
    assert!(text.ends_with("# EOF\n"), "{text}");
    samples(text)
}

fn samples(text: &str) -> BTreeMap<String, f64> {
    let sample = |line: &str| {
        let (name, value) = line.rsplit_once(' ').unwrap();
        (name.to_owned(), value.parse().unwrap_or_else(|_| panic!("{line}")))
    };
    text.lines().filter(|line| !line.starts_with('#')).map(sample).collect()
}

/// The names alone.
fn names(metrics: &BTreeMap<String, f64>) -> BTreeSet<String> {
    metrics.keys().map(|name| name.split('{').next().unwrap().to_owned()).collect()
}

fn flying(args: &[&str]) -> Rig {
    let rig = Rig::start(args);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(30) && stats["latency_ms"]["p50"].as_f64() > Some(0.0));
    rig
}

#[test]
fn metrics_are_the_statistics_with_units_in_their_names() {
    let rig = flying(&SMALL);
    let before = rig.stats().unwrap();
    // What is written may be a tenth of a second old.
    std::thread::sleep(std::time::Duration::from_millis(300));
    let found = metrics(&rig);
    let after = rig.stats().unwrap();
    for (name, path) in [
        ("cyclorama_frames_total", "/frames"),
        ("cyclorama_triangles_total", "/triangles"),
        ("cyclorama_skipped_total{what=\"backface\"}", "/skipped/backface"),
        ("cyclorama_link_bytes_total{link=\"tiles\"}", "/link_bytes/tiles"),
        ("cyclorama_scene_bytes", "/scene_bytes"),
        ("cyclorama_boards", "/boards"),
        ("cyclorama_epochs_total", "/epochs"),
    ] {
        let number = |stats: &Value| stats.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}"));
        let value = *found.get(name).unwrap_or_else(|| panic!("{name} of {:?}", names(&found)));
        assert!((number(&before)..=number(&after)).contains(&value), "{name} {value}");
    }
    assert_eq!(found["cyclorama_ready"], 1.0);
    let shares: f64 =
        ["0", "1"].iter().map(|board| found[&format!("cyclorama_board_share_ratio{{board=\"{board}\"}}")]).sum();
    assert!((shares - 1.0).abs() < 0.005, "{shares}");
}

#[test]
fn who_asks_for_nothing_else_gets_the_older_text() {
    let rig = flying(&SMALL);
    let (head, body) = rig.get("/metrics").unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.contains("text/plain; version=0.0.4"), "{head}");
    let text = String::from_utf8(body).unwrap();
    let there = samples(&text);
    assert_eq!(names(&there), names(&metrics(&rig)), "the same samples");
    for name in names(&there).iter().filter(|name| name.ends_with("_total")) {
        assert!(text.contains(&format!("# TYPE {name} counter\n")), "{name}: {text}");
    }
}

#[test]
fn histograms_add_up() {
    let found = metrics(&flying(&SMALL));
    for (family, labels) in
        [("frame", ""), ("latency", ""), ("stage", "stage=\"raster\""), ("stage", "stage=\"stitch\"")]
    {
        let with = |kind: &str| {
            format!(
                "cyclorama_{family}_seconds_{kind}{}",
                if labels.is_empty() { String::new() } else { format!("{{{labels}}}") }
            )
        };
        let (count, sum) = (found[&with("count")], found[&with("sum")]);
        let is_ours =
            |name: &&String| name.starts_with(&format!("cyclorama_{family}_seconds_bucket{{")) && name.contains(labels);
        let mut buckets: Vec<(f64, f64)> = found
            .keys()
            .filter(is_ours)
            .map(|name| {
                let end = name.split("le=\"").nth(1).unwrap().split('"').next().unwrap();
                (if end == "+Inf" { f64::INFINITY } else { end.parse().unwrap() }, found[name])
            })
            .collect();
        buckets.sort_by(|a, b| a.0.total_cmp(&b.0));
        assert_eq!(buckets.len(), 16, "{family} {labels}");
        assert!(buckets.is_sorted_by(|a, b| a.1 <= b.1), "{buckets:?}");
        assert_eq!(buckets[15], (f64::INFINITY, count));
        assert!(count > 0.0 && sum > 0.0 && sum / count < 10.0, "{family} {labels}: {sum} s in {count}");
    }
}

#[test]
fn every_metric_of_the_dashboard_exists() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("dashboards/cyclorama.json");
    let dashboard: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    let there = names(&metrics(&flying(&SMALL)));
    let mut used = BTreeSet::new();
    for panel in dashboard["panels"].as_array().unwrap() {
        assert!(
            !panel["title"].as_str().unwrap().is_empty() && panel["fieldConfig"]["defaults"]["unit"].is_string(),
            "{panel}"
        );
        for target in panel["targets"].as_array().unwrap() {
            let expression = target["expr"].as_str().unwrap();
            let words = expression.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
            used.extend(words.filter(|word| word.starts_with("cyclorama_")).map(str::to_owned));
        }
    }
    assert!(used.len() > 25, "{used:?}");
    let missing: Vec<_> = used.difference(&there).collect();
    assert!(missing.is_empty(), "{missing:?} are in the dashboard and not among {there:?}");
}

fn ready(console: SocketAddr) -> Option<(bool, String)> {
    let (head, body) = get(console, "/ready")?;
    Some((head.starts_with("HTTP/1.1 200"), String::from_utf8_lossy(&body).into_owned()))
}

#[test]
fn ready_says_what_is_missing() {
    let rig = flying(&SMALL);
    wait_for("ready", || ready(rig.console()).filter(|(is, _)| *is));
    let (head, body) = rig.get("/health").unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && body == b"ok\n");
    kill(rig.children(&["compositor"])[0]);
    wait_for("no compositor", || ready(rig.console()).filter(|(is, why)| !is && why == "no compositor is connected\n"));
    rig.children(&["channel"]).into_iter().for_each(kill);
    wait_for("no board", || ready(rig.console()).filter(|(is, why)| !is && why == "no board is in the row\n"));
    assert!(rig.get("/health").unwrap().0.starts_with("HTTP/1.1 200"), "a new manager would change nothing");
    let found = metrics(&rig);
    assert_eq!((found["cyclorama_ready"], found["cyclorama_boards"]), (0.0, 0.0));
}

#[test]
fn a_trace_holds_frames_boards_and_stages_in_order() {
    let rig = flying(&SMALL);
    let trace: Value = serde_json::from_slice(&rig.get("/api/v1/trace").unwrap().1).unwrap();
    let events = trace["traceEvents"].as_array().unwrap();
    let titles: BTreeMap<u64, &str> = events
        .iter()
        .filter(|event| event["name"] == "thread_name")
        .map(|event| (event["tid"].as_u64().unwrap(), event["args"]["name"].as_str().unwrap()))
        .collect();
    for title in ["frames", "board 0", "board 1", "compositor", "host: packets that wait"] {
        assert!(titles.values().any(|found| *found == title), "{title} of {titles:?}");
    }
    let spans: Vec<&Value> = events.iter().filter(|event| event["ph"] == "X").collect();
    let number = |event: &Value, name: &str| event[name].as_f64().unwrap();
    let (mut frames, mut stages) = (0, BTreeSet::new());
    for tid in titles.keys() {
        // On a track, a span lies within the last one that isn't over, or begins after it. Times are written in thousandths of a microsecond.
        let mut open: Vec<(f64, f64)> = Vec::new();
        let mut last = 0.0;
        for span in spans.iter().filter(|span| span["tid"].as_u64() == Some(*tid)) {
            let (begin, length) = (number(span, "ts"), number(span, "dur"));
            assert!(begin >= last - 0.01 && length >= 0.0, "{span} begins before {last}");
            last = begin;
            while open.last().is_some_and(|(_, end)| *end <= begin + 0.01) {
                open.pop();
            }
            if let Some((_, end)) = open.last() {
                assert!(begin + length <= end + 0.01, "{span} ends after {end}, when what it lies in does");
            }
            open.push((begin, begin + length));
            frames += u64::from(span["name"] == "frame");
            stages.insert(span["name"].as_str().unwrap().to_owned());
            assert!(span["args"]["frame"].is_u64());
        }
    }
    assert!(frames >= 30, "{frames} frames");
    for stage in ["select", "stream", "draw", "geometry", "raster", "resolve", "transfer", "stitch", "wait"] {
        assert!(stages.contains(stage), "{stage} of {stages:?}");
    }
    // Each stage says of which view it is, and all that a board did between them is little: they are measured, not laid end to end.
    let views: BTreeSet<u64> = spans
        .iter()
        .filter(|span| span["name"] == "raster")
        .map(|span| span["args"]["view"].as_u64().unwrap())
        .collect();
    assert_eq!(views, BTreeSet::from([0, 1]));
    let queued = spans.iter().filter(|span| span["name"] == "queue").count();
    assert!(queued > 10, "{queued} of the boards' frames waited for the painter");
    // What a board drew lies within its frame.
    let of = |name: &str, frame: &Value| {
        spans
            .iter()
            .filter(|span| span["name"] == name && span["args"]["frame"] == *frame)
            .map(|span| (number(span, "ts"), number(span, "ts") + number(span, "dur")))
            .collect::<Vec<_>>()
    };
    let whole = spans.iter().rev().find(|span| span["name"] == "frame").unwrap();
    let [(opened, swapped)] = of("frame", &whole["args"]["frame"])[..] else { panic!("{whole}") };
    for (begin, end) in of("draw", &whole["args"]["frame"]) {
        assert!(begin >= opened - 0.01 && end <= swapped + 0.01, "{begin} to {end} of {opened} to {swapped}");
    }
}

#[test]
fn a_picture_is_waited_for_and_never_black() {
    let scene = ["--scene", "airport", "--views", "1", "--size", "96x64", "--samples", "1"];
    let ports = ["--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0", "--console", "127.0.0.1:0"];
    let (_manager, [backplane, _, console]) = manager(&[&scene[..], &ports].concat());
    // Nobody is there to draw one.
    let (head, body) = get(console, "/picture.jpg").unwrap();
    assert!(head.starts_with("HTTP/1.1 503") && head.to_lowercase().contains("retry-after: 1"), "{head}");
    assert!(String::from_utf8_lossy(&body).contains("no frame has been shown as a whole"), "{body:?}");
    let backplane = backplane.to_string();
    let _others = [
        daemon(&["compositor", "--backplane", &backplane]),
        daemon(&["channel", "--backplane", &backplane, "--threads", "1"]),
    ];
    // Whoever asks again and again gets no black one first.
    let jpeg = wait_for("the first picture", || {
        let (head, body) = get(console, "/picture.jpg")?;
        head.starts_with("HTTP/1.1 200").then_some(body)
    });
    let picture = image::load_from_memory(&jpeg).unwrap().into_rgb8();
    let black = picture.pixels().filter(|pixel| pixel.0.iter().all(|value| *value < 24)).count();
    assert!(black < 96 * 64 / 10, "{black} black pixels of the airport by day");
}

/// A manager whose log is read.
struct Logging(Child);

impl Drop for Logging {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn logs_are_json_for_who_asks() {
    use std::io::{BufRead, BufReader};
    let mut command = cyclorama();
    command.args(["channel", "--backplane", "127.0.0.1:9", "--log-format", "json"]);
    let mut board = Logging(command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap());
    let mut lines = BufReader::new(board.0.stderr.take().unwrap()).lines();
    let first: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
    assert!(first["timestamp"].is_string() && first["level"] == "INFO" && first["message"].is_string(), "{first}");
    assert!(first["address"].is_string(), "fields are fields: {first}");
}
