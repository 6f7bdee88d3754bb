//! The profile `metrics` of `deploy/compose.yaml`, with Debian's Prometheus: what it reads of the rig, and whether everything that
//! dashboard and rules ask of it has an answer. Grafana itself isn't here; what it is given is held against the rest.

use crate::engine::{Image, docker, root, run, succeeds};
use crate::project::Project;
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::Write;
use std::process::{Command, Stdio};

/// The rig's Prometheus.
pub(crate) struct Monitor<'a> {
    rig: &'a Project,
    id: String,
    /// `http://ADDRESS:9090`: it isn't published, but containers can be reached from their machine.
    url: String,
}

impl<'a> Monitor<'a> {
    pub(crate) fn up(rig: &'a Project) -> Self {
        rig.compose(&["--profile", "metrics", "up", "--detach", "--no-deps", "prometheus"]);
        let id = rig.containers("prometheus").remove(0);
        let address = format!("{{{{(index .NetworkSettings.Networks {:?}).IPAddress}}}}", rig.network());
        let url = format!("http://{}:9090", docker(&["inspect", "--format", &address, &id]));
        Self { rig, id, url }
    }

    pub(crate) fn check(&self) {
        self.check_files();
        self.rig.wait_for("a target that is up", || {
            let targets = self.ask("targets", &[])?;
            let target = targets["activeTargets"].as_array()?.first()?;
            assert_eq!(target["scrapePool"], "cyclorama", "the job of prometheus.yml");
            (target["health"] == "up").then_some(())
        });
        self.check_page();
        self.check_dashboard();
        self.check_rules();
        self.check_grafana();
    }

    /// An answer of its API, once there is one.
    fn ask(&self, what: &str, params: &[(&str, &str)]) -> Option<Value> {
        let encode = |text: &str| text.bytes().map(|byte| format!("%{byte:02X}")).collect::<String>();
        let params: Vec<_> = params.iter().map(|(name, value)| format!("{name}={}", encode(value))).collect();
        let answer =
            minreq::get(format!("{}/api/v1/{what}?{}", self.url, params.join("&"))).with_timeout(10).send().ok()?;
        let answer: Value = serde_json::from_str(answer.as_str().ok()?).unwrap();
        assert_eq!(answer["status"], "success", "{what} {params:?}: {answer}");
        Some(answer["data"].clone())
    }

    fn promtool(&self, args: &[&str]) {
        // Its container has one folder that can be written to.
        docker(&[&["exec", "--env", "TMPDIR=/prometheus", &self.id, "/bin/promtool"], args].concat());
    }

    fn check_files(&self) {
        self.promtool(&["check", "config", "/etc/prometheus/prometheus.yml"]);
        let rules = root().join("tests/compose/rules.yaml");
        docker(&["cp", rules.to_str().unwrap(), &format!("{}:/prometheus/", self.id)]);
        self.promtool(&["test", "rules", "/prometheus/rules.yaml"]);
    }

    /// The page as Prometheus' own linter sees it.
    fn check_page(&self) {
        let page = self.rig.metrics();
        let mut lint = Command::new("docker");
        lint.args(["exec", "--interactive", &self.id, "/bin/promtool", "check", "metrics"]);
        let mut lint = lint.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        lint.stdin.take().unwrap().write_all(page.as_bytes()).unwrap();
        let said = lint.wait_with_output().unwrap();
        assert!(said.status.success() && said.stderr.is_empty(), "{}", String::from_utf8_lossy(&said.stderr));
    }

    /// Waits until an expression has at least one value that is a number: rates need two readings.
    fn wait_for_values(&self, place: &str, expression: &str) {
        self.rig.wait_for(&format!("{place}: {expression}"), || {
            let found = self.ask("query", &[("query", expression)])?;
            let mut values = found["result"].as_array()?.iter().filter_map(|series| series["value"][1].as_str());
            values.any(|value| value.parse::<f64>().is_ok_and(f64::is_finite)).then_some(())
        });
    }

    /// Every panel has something to draw, and the list of rigs has this one.
    fn check_dashboard(&self) {
        let text = std::fs::read_to_string(root().join("deploy/dashboards/cyclorama.json")).unwrap();
        let dashboard: Value = serde_json::from_str(&text).unwrap();
        let mut count = 0;
        for panel in dashboard["panels"].as_array().unwrap() {
            for target in panel["targets"].as_array().unwrap() {
                // What is chosen at first: all of them.
                let expression = target["expr"].as_str().unwrap().replace("$instance", ".*");
                self.wait_for_values(panel["title"].as_str().unwrap(), &expression);
                count += 1;
            }
        }
        assert!(count >= dashboard["panels"].as_array().unwrap().len(), "{count} expressions");
        let rigs = self.ask("label/instance/values", &[("match[]", "cyclorama_frames_total")]).unwrap();
        assert_eq!(rigs, serde_json::json!(["manager:7480"]), "rigs to choose from");
        println!("{count} expressions of the dashboard have values");
    }

    /// All rules can be evaluated, and what they name is read.
    fn check_rules(&self) {
        let found = self.rig.wait_for("rules that were evaluated", || {
            let rules = self.ask("rules", &[])?["groups"][0]["rules"].as_array()?.clone();
            rules.iter().all(|rule| rule["health"] == "ok").then_some(rules)
        });
        let names: BTreeSet<String> = found
            .iter()
            .flat_map(|rule| rule["query"].as_str().unwrap().split(|c: char| !(c.is_ascii_alphanumeric() || c == '_')))
            .filter(|word| word.starts_with("cyclorama_"))
            .map(str::to_owned)
            .collect();
        assert!(names.len() >= 5, "{names:?}");
        for name in names {
            self.wait_for_values("rules", &name);
        }
    }

    /// Grafana asks where Prometheus is, and looks for the dashboard where it is mounted.
    fn check_grafana(&self) {
        let read = |name: &str| -> Value {
            serde_yaml_ng::from_str(&std::fs::read_to_string(root().join("deploy").join(name)).unwrap()).unwrap()
        };
        let source = read("grafana/datasources.yml")["datasources"][0].clone();
        let health = format!("{}/-/healthy", source["url"].as_str().unwrap());
        let manager = &self.rig.containers("manager")[0];
        run(Command::new("docker").args(["exec", manager, "/cyclorama", "health", &health]));
        let folder = read("grafana/dashboards.yml")["providers"][0]["options"]["path"].clone();
        let mounts = read("compose.yaml")["services"]["grafana"]["volumes"].clone();
        let wanted = format!("./dashboards:{}:ro", folder.as_str().unwrap());
        assert!(mounts.as_array().unwrap().iter().any(|mount| *mount == wanted), "{wanted} in {mounts}");
    }
}

/// What is built of Debian's package, where there is a Debian.
pub(crate) fn image() -> Option<Image> {
    if !succeeds(Command::new("apt-get").arg("--version")) {
        println!("SKIPPED: no apt-get, which Prometheus comes by");
        return None;
    }
    Some(Image::of("cyclorama-prometheus", |tag| {
        run(Command::new(root().join("deploy/prometheus/image.sh")).args(["--tag", tag]));
    }))
}
