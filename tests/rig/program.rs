//! The program under test, started and watched.

use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A hang becomes a failure after this long; no test depends on being faster.
pub(crate) const HANG: Duration = Duration::from_secs(120);

/// The `cyclorama` program, without this machine's environment getting in.
pub(crate) fn cyclorama() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_cyclorama"));
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("CYCLORAMA_")) {
        command.env_remove(name);
    }
    command.stdin(Stdio::null());
    command
}

/// Runs to the end.
pub(crate) fn run(args: &[&str]) -> Output {
    cyclorama().args(args).output().expect("the program starts")
}

/// Runs a rig that writes its frames; returns its statistics.
pub(crate) fn fly(out: &Path, args: &[&str]) -> Value {
    let output = cyclorama()
        .args(["rig", "--json", "--console", "off", "--out"])
        .arg(out)
        .args(args)
        .output()
        .expect("the program starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("the statistics are JSON")
}

/// All files of a folder, by name.
pub(crate) fn files(folder: &Path) -> std::collections::BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).expect("the folder is there");
    let read = |entry: std::io::Result<std::fs::DirEntry>| {
        let entry = entry.expect("the folder can be read");
        (entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path()).expect("a file"))
    };
    entries.map(read).collect()
}

/// A daemon that is ended when dropped.
pub(crate) struct Daemon(Child);

impl Daemon {
    /// Of a process that was started otherwise.
    pub(crate) fn of(child: Child) -> Self {
        Self(child)
    }

    /// How it has ended, if it has.
    pub(crate) fn ended(&mut self) -> Option<std::process::ExitStatus> {
        self.0.try_wait().expect("our child")
    }

    /// Its process's number.
    pub(crate) fn id(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Daemon {
    /// Sends it a signal.
    pub(crate) fn signal(&self, signal: rustix::process::Signal) {
        let pid = rustix::process::Pid::from_raw(self.0.id() as i32).expect("a process number");
        rustix::process::kill_process(pid, signal).expect("the process is there");
    }
}

/// Starts one.
pub(crate) fn daemon(args: &[&str]) -> Daemon {
    Daemon(cyclorama().args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts"))
}

/// Flags of a manager that listens where nobody else does.
pub(crate) const ANY_PORTS: [&str; 6] =
    ["--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0", "--console", "127.0.0.1:0"];

/// Starts a manager; returns where it listens for boards, poses and browsers.
pub(crate) fn manager(args: &[&str]) -> (Daemon, [SocketAddr; 3]) {
    let mut command = cyclorama();
    // It would end with its stdin.
    command.args(["manager", "--supervised"]).args(args).stdin(Stdio::piped());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the program starts");
    let mut lines = BufReader::new(child.stdout.take().expect("piped")).lines().map_while(Result::ok);
    let first = lines.next().expect("it says where it listens");
    // Keep the pipe open and empty, or the manager would fail to write to it.
    std::thread::spawn(move || lines.for_each(drop));
    let said: Value = serde_json::from_str(&first).expect("a line of JSON");
    let address = |name: &str| said["listening"][name].as_str().expect("an address").parse().expect("an address");
    (Daemon(child), ["backplane", "pose", "console"].map(address))
}

/// An address of this machine at which nobody listens at present.
pub(crate) fn free_address() -> SocketAddr {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
    listener.local_addr().expect("a bound socket has an address")
}

/// Looks until `probe` finds something.
pub(crate) fn wait_for<T>(what: &str, mut probe: impl FnMut() -> Option<T>) -> T {
    let started = Instant::now();
    loop {
        if let Some(found) = probe() {
            return found;
        }
        assert!(started.elapsed() < HANG, "{what} didn't happen in {HANG:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Asks a console: head and body of its answer.
pub(crate) fn get(console: SocketAddr, path: &str) -> Option<(String, Vec<u8>)> {
    let mut stream = TcpStream::connect(console).ok()?;
    stream.set_read_timeout(Some(HANG)).ok()?;
    write!(stream, "GET {path} HTTP/1.1\r\nHost: rig\r\nConnection: close\r\n\r\n").ok()?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).ok()?;
    let split = answer.windows(4).position(|w| w == b"\r\n\r\n")?;
    let body = answer.split_off(split + 4);
    Some((String::from_utf8_lossy(&answer).into_owned(), body))
}

/// A console's statistics.
pub(crate) fn stats(console: SocketAddr) -> Option<Value> {
    serde_json::from_slice(&get(console, "/api/v1/stats")?.1).ok()
}

/// The lines of a manifest that may still be being written: the last one only when it is whole.
pub(crate) fn whole_lines(manifest: &Path) -> Vec<String> {
    let text = std::fs::read_to_string(manifest).unwrap_or_default();
    text.split_inclusive('\n').filter(|line| line.ends_with('\n')).map(str::to_owned).collect()
}

/// Those that tell what their picture depends on: all since a manager first said so.
pub(crate) fn told_lines(manifest: &Path) -> Vec<String> {
    whole_lines(manifest).into_iter().filter(|line| line.contains("\"eye\"")).collect()
}

/// A rig in real time, in a process group of its own, with its console.
pub(crate) struct Rig {
    pub child: Child,
    console: SocketAddr,
}

impl Rig {
    pub(crate) fn start(args: &[&str]) -> Self {
        let mut child = cyclorama()
            .args(["rig", "--console", "127.0.0.1:0"])
            .args(args)
            .process_group(0)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let stderr = child.stderr.take().expect("piped");
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let console = lines.find_map(|line| line.strip_prefix("console: http://")?.strip_suffix('/')?.parse().ok());
        let console = console.expect("the rig says where its console is");
        // Keep the pipe open and empty, or the rig would fail to write to it.
        std::thread::spawn(move || lines.for_each(drop));
        Self { child, console }
    }

    /// Where its console is.
    pub(crate) fn console(&self) -> SocketAddr {
        self.console
    }

    /// Asks the console.
    pub(crate) fn get(&self, path: &str) -> Option<(String, Vec<u8>)> {
        get(self.console, path)
    }

    pub(crate) fn stats(&self) -> Option<Value> {
        stats(self.console)
    }

    /// Waits until the statistics satisfy `is_so`.
    pub(crate) fn wait(&self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        wait_for(what, || self.stats().filter(|stats| is_so(stats)))
    }

    /// Process numbers of the rig's children whose command line has all of `words`.
    pub(crate) fn children(&self, words: &[&str]) -> Vec<u32> {
        let own = self.child.id();
        let processes = std::fs::read_dir("/proc").expect("/proc is there");
        let numbers = processes.filter_map(|e| e.ok()?.file_name().to_str()?.parse::<u32>().ok());
        let is_ours = |pid: &u32| {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
            let parent = stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().nth(1)?.parse().ok());
            let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            parent == Some(own) && words.iter().all(|word| command.split('\0').any(|arg| arg == *word))
        };
        numbers.filter(is_ours).collect()
    }

    /// SIGINT to all processes of the rig, as a terminal's Ctrl-C does; waits for the end.
    pub(crate) fn interrupt(mut self) -> (std::process::ExitStatus, Duration) {
        let started = Instant::now();
        let group = rustix::process::Pid::from_raw(self.child.id() as i32).expect("a process number");
        rustix::process::kill_process_group(group, rustix::process::Signal::INT).expect("the group is there");
        let status = wait_for("the rig's end", || self.child.try_wait().expect("our child"));
        (status, started.elapsed())
    }
}

impl Drop for Rig {
    fn drop(&mut self) {
        // Already over in most tests; otherwise its children end with it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// SIGKILL.
pub(crate) fn kill(pid: u32) {
    let pid = rustix::process::Pid::from_raw(pid as i32).expect("a process number");
    rustix::process::kill_process(pid, rustix::process::Signal::KILL).expect("the process is there");
}

/// Whether a process is there and not a zombie.
pub(crate) fn is_alive(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit(')').next().and_then(|rest| rest.split_whitespace().next()).is_some_and(|state| state != "Z")
}
