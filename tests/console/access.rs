//! Who may look and who may change something, asked as programs and foreign pages would.

use crate::program::{HANG, Rig, cyclorama, free_address, wait_for};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Stdio};

const SMALL: [&str; 8] = ["--views", "1", "--boards", "2", "--size", "96x64", "--samples", "1"];

/// Sends a request; status and body.
pub(crate) fn request(
    console: SocketAddr,
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
    body: &str,
) -> Option<(u16, String)> {
    let mut stream = TcpStream::connect(console).ok()?;
    stream.set_read_timeout(Some(HANG)).ok()?;
    let mut head = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    if !headers.iter().any(|(name, _)| *name == "Host") {
        head += &format!("Host: {console}\r\n");
    }
    write!(stream, "{head}\r\n{body}").ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    let status = answer.split(' ').nth(1)?.parse().ok()?;
    Some((status, answer.split_once("\r\n\r\n")?.1.to_owned()))
}

const JSON: (&str, &str) = ("Content-Type", "application/json");
const PAUSE: &str = r#"{"do": "pause"}"#;

fn control(console: SocketAddr, headers: &[(&str, &str)], body: &str) -> (u16, String) {
    request(console, "POST", "/api/v1/control", headers, body).unwrap()
}

fn watch(console: SocketAddr, headers: &[(&str, &str)]) -> u16 {
    let upgrade =
        [("Upgrade", "websocket"), ("Sec-WebSocket-Version", "13"), ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ==")];
    // The connection stays open where it is let in.
    let mut stream = TcpStream::connect(console).unwrap();
    stream.set_read_timeout(Some(HANG)).unwrap();
    let host =
        headers.iter().find(|(name, _)| *name == "Host").map_or(console.to_string(), |(_, value)| (*value).into());
    let mut head = format!("GET /api/v1/watch HTTP/1.1\r\nConnection: Upgrade\r\nHost: {host}\r\n");
    for (name, value) in upgrade.iter().chain(headers).filter(|(name, _)| *name != "Host") {
        head += &format!("{name}: {value}\r\n");
    }
    write!(stream, "{head}\r\n").unwrap();
    let mut start = [0; 12];
    stream.read_exact(&mut start).unwrap();
    String::from_utf8_lossy(&start[9..]).parse().unwrap()
}

#[test]
fn a_foreign_page_can_neither_watch_nor_control() {
    let rig = Rig::start(&SMALL);
    let console = rig.console();
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let own = format!("http://{console}");
    for foreign in
        [[JSON, ("Origin", "http://evil.example")], [JSON, ("Host", "evil.example")], [JSON, ("Origin", "null")]]
    {
        let (status, body) = control(console, &foreign, PAUSE);
        assert!(status == 403 && body.contains("error"), "{foreign:?}: {status} {body}");
        assert_eq!(watch(console, &foreign[1..]), 403, "{foreign:?}");
    }
    // A form of a foreign page, by a browser that says not where it is from.
    let form = [("Content-Type", "application/x-www-form-urlencoded")];
    assert_eq!(control(console, &form, PAUSE).0, 415);
    assert_eq!(control(console, &[("Content-Type", "text/plain")], PAUSE).0, 415);
    let (_, body) = request(console, "GET", "/api/v1/live", &[], "").unwrap();
    assert!(body.contains("\"is_paused\":false"), "none of them did anything: {body}");
    assert_eq!(watch(console, &[("Origin", &own)]), 101);
    assert_eq!(control(console, &[JSON, ("Origin", &own)], PAUSE).0, 200);
    assert_eq!(control(console, &[JSON], r#"{"do": "resume"}"#).0, 200, "a program says no origin");
}

#[test]
fn what_cannot_be_done_is_said() {
    let rig = Rig::start(&SMALL);
    let console = rig.console();
    rig.wait("two boards", |stats| stats["boards"] == 2 && stats["frames"].as_u64() > Some(5));
    for (body, status, reason) in [
        (r#"{"do": "step"}"#, 409, "not paused"),
        (r#"{"do": "take_out", "board": 999}"#, 409, "no board with key 999"),
        (r#"{"do": "samples", "samples": "3"}"#, 400, "possible are 1, 4, 8, 16, 64 or exact"),
        (r#"{"do": "dance"}"#, 400, "unknown variant"),
    ] {
        let (found, said) = control(console, &[JSON], body);
        assert!(found == status && said.contains(reason), "{body}: {found} {said}");
    }
    let live: serde_json::Value =
        serde_json::from_str(&request(console, "GET", "/api/v1/live", &[], "").unwrap().1).unwrap();
    let take_out = |board: usize| format!(r#"{{"do": "take_out", "board": {}}}"#, live["boards"][board]["key"]);
    assert_eq!(control(console, &[JSON], &take_out(0)).0, 200);
    let (status, said) = control(console, &[JSON], &take_out(1));
    assert!(status == 409 && said.contains("the last in the row"), "{status} {said}");
}

/// A manager that listens beyond this machine, and is asked from here.
struct Open(Child, SocketAddr);

impl Open {
    fn start(token: Option<&str>) -> Self {
        let port = free_address().port();
        let mut command = cyclorama();
        command.args(["manager", "--listen", "127.0.0.1:0", "--pose-listen", "127.0.0.1:0", "--insecure"]);
        command.args(["--console", &format!("0.0.0.0:{port}"), "--size", "64x48"]);
        if let Some(token) = token {
            command.env("CYCLORAMA_CONSOLE_TOKEN", token);
        }
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let console = SocketAddr::from(([127, 0, 0, 1], port));
        wait_for("the console", || request(console, "GET", "/health", &[], ""));
        Self(child, console)
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn beyond_this_machine_it_is_read_only_without_a_token() {
    let open = Open::start(None);
    let (status, said) = control(open.1, &[JSON], PAUSE);
    assert!(status == 403 && said.contains("--console-token"), "{status} {said}");
    assert_eq!(request(open.1, "GET", "/api/v1/live", &[("Host", "rig.example")], "").unwrap().0, 200);
    assert_eq!(watch(open.1, &[("Host", "rig.example"), ("Origin", "http://rig.example")]), 101);
    assert_eq!(watch(open.1, &[("Host", "rig.example"), ("Origin", "http://evil.example")]), 403);
}

#[test]
fn a_token_opens_the_controls_and_nothing_else_does() {
    let kept = Open::start(Some("a secret of ours"));
    assert_eq!(control(kept.1, &[JSON], PAUSE).0, 401);
    assert_eq!(control(kept.1, &[JSON, ("Authorization", "Bearer a secret of theirs")], PAUSE).0, 401);
    assert_eq!(control(kept.1, &[JSON, ("Authorization", "Bearer a secret of ours")], PAUSE).0, 200);
    let foreign = [JSON, ("Authorization", "Bearer a secret of ours"), ("Origin", "http://evil.example")];
    assert_eq!(control(kept.1, &foreign, PAUSE).0, 403);
}

#[test]
fn a_token_that_could_be_guessed_is_refused() {
    let output = cyclorama().args(["manager", "--console-token", "secret"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("has 6 characters; give at least 12"), "{said}");
    assert!(!said.contains("secret"), "it isn't repeated: {said}");
}
