//! Every command in README.md and docs/ is run as it stands, in a folder of its own for each page, with the program under test in the
//! place of `cyclorama` and of `cargo run`.
//!
//! What runs until somebody ends it, such as a manager, is put into the background by `bin/cyclorama`, a script of this suite's, and must
//! still be there at the end of its page. The rig's usual ports are exchanged for free ones. Blocks that can't be run say why in a
//! comment above them; that their arguments are understood is tested in `deploy/cli/used.rs`.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test suite: a panic is a failure, and what is printed is its report"
)]

#[expect(dead_code, reason = "what is in the text of pages is looked at in `deploy/cli/used.rs`")]
mod blocks;

use blocks::{Page, pages};
use std::io::Write;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

#[test]
fn the_commands_of_every_page_do_what_the_page_says() {
    let mut failed = Vec::new();
    for page in pages(root()) {
        let since = Instant::now();
        let run = page.blocks.iter().filter(|block| block.not_run.is_none()).count();
        if run > 0
            && let Err(what) = try_page(&page)
        {
            failed.push(format!("{}: {what}", page.name));
        }
        println!("{:>5.1} s  {}: {run} of {} blocks", since.elapsed().as_secs_f64(), page.name, page.blocks.len());
        for block in &page.blocks {
            if let Some(why) = &block.not_run {
                println!("         {} isn't run: {why}", block.place);
            }
        }
    }
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

/// Runs a page's blocks one after the other, in one shell.
fn try_page(page: &Page) -> Result<(), String> {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("bin")).unwrap();
    for (name, script) in [("cyclorama", include_str!("bin/cyclorama")), ("cargo", include_str!("bin/cargo"))] {
        std::fs::write(at("bin").join(name), script).unwrap();
        std::fs::set_permissions(at("bin").join(name), PermissionsExt::from_mode(0o755)).unwrap();
    }
    // Readers are in the project's folder and have a model.
    symlink(root().join("deploy"), at("deploy")).unwrap();
    let own = env!("CARGO_BIN_EXE_cyclorama");
    let written = Command::new(own).args(["scene", "airport", "-o"]).arg(at("model.glb")).output().unwrap();
    assert!(written.status.success(), "{}", String::from_utf8_lossy(&written.stderr));
    std::fs::copy(at("model.path.json"), at("path.json")).unwrap();
    std::fs::copy(at("model.path.json"), at("flight.json")).unwrap();

    let mut script = std::fs::File::create(at("script")).unwrap();
    writeln!(script, "set -euo pipefail").unwrap();
    let [tcp, udp, http] = free_ports();
    for block in page.blocks.iter().filter(|block| block.not_run.is_none()) {
        let ports = [("7400", tcp), ("7401", udp), ("7480", http)];
        let text = ports.iter().fold(block.text.clone(), |text, (usual, free)| text.replace(usual, &free.to_string()));
        writeln!(script, "echo '== {}' >&2\n{text}", block.place).unwrap();
    }
    writeln!(script, "bin/cyclorama --end-of-page").unwrap();
    drop(script);
    let mut shell = Command::new("bash");
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("CYCLORAMA_")) {
        shell.env_remove(name);
    }
    let path = format!("{}:{}", at("bin").display(), std::env::var("PATH").unwrap_or_default());
    shell.arg("script").current_dir(folder.path()).env("PATH", path).env("PROGRAM", own);
    shell.env("PORTS", format!("{tcp} {udp} {http}")).env("BACKGROUND", at("background"));
    let shell = shell.stdin(Stdio::null()).stdout(Stdio::null()).stderr(std::fs::File::create(at("said")).unwrap());
    let mut child = shell.process_group(0).spawn().unwrap();
    let group = rustix::process::Pid::from_raw(child.id() as i32).unwrap();
    let status = child.wait().unwrap();
    // Whatever is still there in the background.
    let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
    let said = std::fs::read_to_string(at("said")).unwrap();
    if status.success() { Ok(()) } else { Err(format!("{status}\n{said}")) }
}

/// Ports that nobody uses at present: for boards, poses and the console.
fn free_ports() -> [u16; 3] {
    let tcp = [(); 2].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    let udp = UdpSocket::bind("127.0.0.1:0").unwrap();
    let [backplane, console] = tcp.each_ref().map(|socket| socket.local_addr().unwrap().port());
    [backplane, udp.local_addr().unwrap().port(), console]
}
