//! One rig of `deploy/compose.yaml`, with its console.

use crate::engine::{self, Image, docker, run};
use crate::flight::{Flight, RATE, SAMPLES, SIZE, VIEWS};
use serde_json::Value;
use std::process::Command;
use std::time::{Duration, Instant};

/// A hang becomes a failure after this long; no test depends on being faster.
const HANG: Duration = Duration::from_secs(120);
/// Frames in a row without a repeated view, to be called whole.
const WHOLE: u64 = 10;

/// A composed rig, taken down when dropped.
pub(crate) struct Project {
    name: String,
    console: String,
    environment: Vec<(&'static str, String)>,
}

/// A count of the statistics, by name or pointer.
pub(crate) fn number(stats: &Value, name: &str) -> u64 {
    let value = if name.starts_with('/') { stats.pointer(name) } else { stats.get(name) };
    value.and_then(Value::as_u64).unwrap_or_else(|| panic!("no {name} in {stats}"))
}

fn free_port() -> u16 {
    std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

impl Project {
    pub(crate) fn up(image: &Image, prometheus: Option<&Image>, flight: &Flight, boards: u64) -> Self {
        let name = format!("cyclorama-test-{}", std::process::id());
        let (console, pose) = (free_port(), free_port());
        let environment = vec![
            ("CYCLORAMA_IMAGE", image.name().to_owned()),
            ("PROMETHEUS_IMAGE", prometheus.map(Image::name).unwrap_or_default().to_owned()),
            ("CYCLORAMA_VIEWS", VIEWS.to_string()),
            ("CYCLORAMA_SIZE", SIZE.into()),
            ("CYCLORAMA_SAMPLES", SAMPLES.into()),
            ("CYCLORAMA_RATE", RATE.to_string()),
            ("CYCLORAMA_CONSOLE_PORT", console.to_string()),
            ("CYCLORAMA_POSE_PORT", pose.to_string()),
            ("CYCLORAMA_SCENES", flight.folder().to_str().unwrap().to_owned()),
            ("CYCLORAMA_FLIGHT", "/scenes/flight.json".into()),
            ("CYCLORAMA_TEST_OUT", flight.out().to_str().unwrap().to_owned()),
        ];
        let project = Self { name, console: format!("http://127.0.0.1:{console}"), environment };
        project.compose(&["up", "--detach", "--scale", &format!("channel={boards}")]);
        project
    }

    fn composer(&self) -> Command {
        let mut command = engine::composer().unwrap();
        for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("CYCLORAMA_")) {
            command.env_remove(name);
        }
        command.envs(self.environment.iter().map(|(name, value)| (name, value)));
        command.arg("--project-name").arg(&self.name);
        for file in ["deploy/compose.yaml", "tests/compose/override.yaml"] {
            command.arg("--file").arg(engine::root().join(file));
        }
        command
    }

    pub(crate) fn compose(&self, args: &[&str]) -> String {
        run(self.composer().args(args))
    }

    pub(crate) fn scale(&self, boards: u64) {
        self.compose(&["up", "--detach", "--no-recreate", "--scale", &format!("channel={boards}")]);
    }

    /// What marks all that belongs to this rig.
    pub(crate) fn label(&self) -> String {
        format!("com.docker.compose.project={}", self.name)
    }

    /// Where all of the rig meet.
    pub(crate) fn network(&self) -> String {
        format!("{}_rig", self.name)
    }

    /// Running containers of a service.
    pub(crate) fn containers(&self, service: &str) -> Vec<String> {
        let (own, service) = (format!("label={}", self.label()), format!("label=com.docker.compose.service={service}"));
        let found = docker(&["ps", "--quiet", "--filter", &own, "--filter", &service]);
        let found: Vec<_> = found.lines().map(str::to_owned).collect();
        assert!(!found.is_empty(), "no container of {service}");
        found
    }

    /// Containers, networks and volumes that are still there.
    pub(crate) fn remains(&self) -> Vec<String> {
        let own = format!("label={}", self.label());
        let kinds: [&[&str]; 3] = [&["ps", "--all"], &["network", "ls"], &["volume", "ls"]];
        let found = kinds.map(|list| docker(&[list, &["--quiet", "--filter", &own]].concat()));
        found.iter().flat_map(|list| list.lines()).map(str::to_owned).collect()
    }

    pub(crate) fn wait_for<T>(&self, what: &str, mut probe: impl FnMut() -> Option<T>) -> T {
        let started = Instant::now();
        loop {
            if let Some(found) = probe() {
                return found;
            }
            if started.elapsed() > HANG {
                let said = self.composer().args(["logs", "--no-color", "--tail", "60"]).output();
                let said = said.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
                panic!("{what} didn't happen in {HANG:?}: {:?}\n{}", self.stats(), said.unwrap_or_default());
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub(crate) fn stats(&self) -> Option<Value> {
        let answer = minreq::get(format!("{}/api/v1/stats", self.console)).with_timeout(10).send().ok()?;
        serde_json::from_str(answer.as_str().ok()?).ok()
    }

    /// The page for Prometheus, as who doesn't say what is accepted gets it.
    pub(crate) fn metrics(&self) -> String {
        let answer = minreq::get(format!("{}/metrics", self.console)).with_timeout(10).send().unwrap();
        answer.as_str().unwrap().to_owned()
    }

    /// Waits until the statistics are so.
    pub(crate) fn wait(&self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        self.wait_for(what, || self.stats().filter(|stats| is_so(stats)))
    }

    /// Waits until frames are shown whole, one after the other.
    pub(crate) fn wait_whole(&self) {
        let mut last = self.wait("statistics", |_| true);
        self.wait_for("frames without a repeated view", || {
            let now = self.stats()?;
            if number(&now, "repeated_views") != number(&last, "repeated_views") {
                last = now;
                return None;
            }
            (number(&now, "frames") >= number(&last, "frames") + WHOLE).then_some(())
        });
    }

    /// Waits for a picture of something: before the first frame the canvas is black.
    pub(crate) fn picture(&self) {
        let (width, height) = SIZE.split_once('x').unwrap();
        let stitched = (VIEWS * width.parse::<u32>().unwrap(), height.parse().unwrap());
        self.wait_for("a picture", || {
            let decoded = image::load_from_memory(&self.ask_picture()?.into_bytes()).unwrap();
            assert_eq!((decoded.width(), decoded.height()), stitched, "all views side by side");
            let grey = decoded.into_luma8();
            let contrast = grey.iter().max().unwrap() - grey.iter().min().unwrap();
            (contrast > 50).then_some(())
        });
    }

    fn ask_picture(&self) -> Option<minreq::Response> {
        let answer = minreq::get(format!("{}/picture.jpg", self.console)).with_timeout(10).send().ok()?;
        (answer.status_code == 200).then_some(answer)
    }

    /// Number of the frame that is shown, 0 without one.
    pub(crate) fn frame_of_picture(&self) -> u64 {
        let answer = self.ask_picture();
        let frame =
            answer.iter().flat_map(|answer| &answer.headers).find(|(name, _)| name.eq_ignore_ascii_case("x-frame"));
        frame.map_or(0, |(_, number)| number.parse().unwrap())
    }

    /// Names of the events that `later` has and `earlier` hasn't.
    pub(crate) fn events_since<'a>(&self, later: &'a Value, earlier: &Value) -> Vec<&'a str> {
        let since = earlier["time_s"].as_f64().unwrap();
        let events = later["events"].as_array().unwrap().iter();
        let new = events.filter(|event| event["time_s"].as_f64() > Some(since));
        new.map(|event| event["event"].as_str().unwrap()).collect()
    }

    /// What the newest event of this name says.
    pub(crate) fn last_event(&self, stats: &Value, name: &str) -> String {
        let events = stats["events"].as_array().unwrap().iter();
        let last = events.rev().find(|event| event["event"] == name).unwrap();
        last["detail"].as_str().unwrap().to_owned()
    }

    /// Waits until the engine calls all containers of these services healthy.
    pub(crate) fn wait_healthy(&self, services: &[&str]) {
        for id in services.iter().flat_map(|service| self.containers(service)) {
            self.wait_for("health", || {
                let said = docker(&["inspect", "--format", "{{.State.Health.Status}}", &id]);
                (said == "healthy").then_some(())
            });
        }
    }
}

impl Drop for Project {
    fn drop(&mut self) {
        // After a failure; otherwise there is nothing left to take down.
        let _ = self.composer().args(["--profile", "metrics", "down", "--volumes", "--remove-orphans"]).output();
        let strangers = docker(&["ps", "--all", "--quiet", "--filter", &format!("label={}", self.label())]);
        for id in strangers.lines() {
            let _ = Command::new("docker").args(["rm", "--force", id]).output();
        }
    }
}
