//! The Docker engine, and the image under test.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The project's folder.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap().to_owned()
}

pub(crate) fn succeeds(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Why nothing can be tested here.
pub(crate) fn missing() -> Option<&'static str> {
    if !succeeds(Command::new("docker").arg("info")) {
        return Some("no docker");
    }
    composer().is_none().then_some("no docker compose")
}

/// Docker's own command for composed rigs, or the older program.
pub(crate) fn composer() -> Option<Command> {
    let mut plugin = Command::new("docker");
    plugin.arg("compose");
    let found = [plugin, Command::new("docker-compose")];
    found.into_iter().find(|command| {
        let mut asked = Command::new(command.get_program());
        succeeds(asked.args(command.get_args()).arg("version"))
    })
}

/// Runs a command to its end; what it has said on stdout.
pub(crate) fn run(command: &mut Command) -> String {
    let output = command.stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{command:?}: {said}{}", String::from_utf8_lossy(&output.stderr));
    said.trim().to_owned()
}

/// Asks the engine.
pub(crate) fn docker(args: &[&str]) -> String {
    run(Command::new("docker").args(args))
}

/// An image, removed when dropped.
pub(crate) struct Image(String);

impl Image {
    /// Packs the program under test.
    pub(crate) fn build() -> Self {
        Self::of("cyclorama", |tag| {
            let script = root().join("deploy/image.sh");
            run(Command::new(script).args(["--tag", tag, "--binary", env!("CARGO_BIN_EXE_cyclorama")]));
        })
    }

    /// What `make` makes under a name of this test's own.
    pub(crate) fn of(name: &str, make: impl FnOnce(&str)) -> Self {
        let image = Self(format!("{name}:test-{}", std::process::id()));
        make(image.name());
        image
    }

    pub(crate) fn name(&self) -> &str {
        &self.0
    }

    pub(crate) fn bytes(&self) -> u64 {
        docker(&["image", "inspect", "--format", "{{.Size}}", self.name()]).parse().unwrap()
    }
}

impl Drop for Image {
    fn drop(&mut self) {
        succeeds(Command::new("docker").args(["image", "rm", "--force", self.name()]));
    }
}
