//! Keys for tests, made by the program, and daemons that have them.

use crate::program::{cyclorama, run, wait_for};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::{Arc, Mutex};

/// An authority, and the folders of its nodes.
pub(crate) struct Authority {
    folder: tempfile::TempDir,
}

impl Authority {
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let authority = Self { folder };
        let output = run(&["keys", "init", authority.path()]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        authority
    }

    /// The folder that `keys init` has made.
    pub(crate) fn path(&self) -> &str {
        self.folder.path().to_str().unwrap()
    }

    /// Keys of a node, in a folder beside.
    pub(crate) fn issue(&self, role: &str, name: &str) -> PathBuf {
        let out = self.folder.path().join(format!("{role}-{name}"));
        self.issue_into(role, name, &out);
        out
    }

    pub(crate) fn issue_into(&self, role: &str, name: &str, out: &Path) {
        let out = out.to_str().unwrap();
        let output = run(&["keys", "issue", self.path(), "--role", role, "--name", name, "--out", out]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
}

/// A daemon, ended with the test, and what it has logged.
pub(crate) struct Daemon {
    child: Child,
    log: Arc<Mutex<String>>,
}

impl Daemon {
    pub(crate) fn start(args: &[&str]) -> Self {
        Self::spawn(args, Stdio::null()).0
    }

    fn spawn(args: &[&str], stdout: Stdio) -> (Self, Option<std::process::ChildStdout>) {
        let mut child =
            cyclorama().args(args).stdin(Stdio::piped()).stdout(stdout).stderr(Stdio::piped()).spawn().unwrap();
        let (stderr, stdout) = (child.stderr.take().unwrap(), child.stdout.take());
        let log = Arc::new(Mutex::new(String::new()));
        let written = log.clone();
        std::thread::spawn(move || {
            for line in BufReader::new(stderr).lines().map_while(Result::ok) {
                written.lock().unwrap().push_str(&format!("{line}\n"));
            }
        });
        (Self { child, log }, stdout)
    }

    /// Waits until it has logged this.
    pub(crate) fn says(&self, what: &str) {
        wait_for(&format!("the words \"{what}\""), || self.log.lock().unwrap().contains(what).then_some(()));
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Some have ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A manager of one small view of the airport that shows its first pose; its backplane and its console.
pub(crate) fn manager(keys: Option<&Path>) -> (Daemon, SocketAddr, SocketAddr) {
    manager_at("127.0.0.1:0", keys)
}

/// Likewise, with its backplane at this address.
pub(crate) fn manager_at(listen: &str, keys: Option<&Path>) -> (Daemon, SocketAddr, SocketAddr) {
    let ports = ["--listen", listen, "--pose-listen", "127.0.0.1:0", "--console", "127.0.0.1:0"];
    let small = ["manager", "--supervised", "--views", "1", "--size", "96x64", "--samples", "1"];
    let keys = keys.map(|folder| ["--keys", folder.to_str().unwrap()]);
    let args = [&small[..], &ports, keys.as_ref().map_or(&[], |keys| &keys[..])].concat();
    let (daemon, stdout) = Daemon::spawn(&args, Stdio::piped());
    let mut stdout = BufReader::new(stdout.unwrap());
    let mut line = String::new();
    stdout.read_line(&mut line).unwrap();
    // Keep the pipe empty, or the manager would fail to write to it.
    std::thread::spawn(move || stdout.read_to_end(&mut Vec::new()));
    let said: Value = serde_json::from_str(&line).unwrap();
    let address = |name: &str| said["listening"][name].as_str().unwrap().parse().unwrap();
    (daemon, address("backplane"), address("console"))
}

/// A board with these keys, if any.
pub(crate) fn board(backplane: SocketAddr, keys: Option<&Path>) -> Daemon {
    let backplane = backplane.to_string();
    let keys = keys.map(|folder| ["--keys", folder.to_str().unwrap()]);
    let args = ["channel", "--backplane", &backplane, "--threads", "1"];
    Daemon::start(&[&args[..], keys.as_ref().map_or(&[], |keys| &keys[..])].concat())
}
