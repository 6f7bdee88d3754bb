//! A rig whose daemons are in network namespaces of their own, with real addresses and keys: each is a machine to the others. Links go down without
//! anybody being told, and firewalls drop what comes one way only, between some and not between others.
//!
//! That takes root, iproute2 and iptables. The switch between the machines is a bridge in a namespace too, so nothing of this machine's own
//! network is touched, and several such rigs don't meet.

use crate::events::count;
use crate::keys::{Authority, Daemon};
use crate::program::{run, stats, told_lines, wait_for};
use bench::disturbed::Undisturbed;
use manager::host::camera::CameraFile;
use manager::scene::builtin;
use serde_json::Value;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// The machines, in the order of their addresses.
const MACHINES: [&str; 5] = ["desk", "wall", "a", "b", "c"];
/// What a manager's console is reached at, on its own machine.
const CONSOLE: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 7402);
/// Different poses of the flight.
const POSES: usize = 40;

fn did(program: &str, args: &[&str]) -> Result<(), String> {
    let output = Command::new(program).args(args).output().map_err(|error| format!("{program}: {error}"))?;
    let error = String::from_utf8_lossy(&output.stderr);
    if output.status.success() { Ok(()) } else { Err(format!("{program} {}: {}", args.join(" "), error.trim_end())) }
}

fn ip(args: &str) -> Result<(), String> {
    did("ip", &args.split(' ').collect::<Vec<_>>())
}

/// Machines at a switch; gone when dropped.
struct Network {
    prefix: String,
}

impl Network {
    /// As many as there are names; or why that can't be.
    fn new() -> Result<Self, String> {
        remove_left_over();
        did("iptables", &["--version"])?;
        let network = Self { prefix: format!("cyc{}-", std::process::id()) };
        let switch = network.name("switch");
        ip(&format!("netns add {switch}"))?;
        ip(&format!("-n {switch} link add bridge type bridge"))?;
        ip(&format!("-n {switch} link set bridge up"))?;
        for (k, machine) in MACHINES.iter().enumerate() {
            let name = network.name(machine);
            ip(&format!("netns add {name}"))?;
            ip(&format!("link add eth0 netns {name} type veth peer name port{k} netns {switch}"))?;
            ip(&format!("-n {switch} link set port{k} master bridge up"))?;
            ip(&format!("-n {name} addr add {}/24 dev eth0", address(machine)))?;
            ip(&format!("-n {name} link set lo up"))?;
            ip(&format!("-n {name} link set eth0 up"))?;
            did("ip", &["netns", "exec", &name, "iptables", "-L", "-n"])?;
        }
        Ok(network)
    }

    fn name(&self, machine: &str) -> String {
        format!("{}{machine}", self.prefix)
    }

    /// Does something on a machine: its sockets, and the processes that it starts, are there.
    fn on<T: Send>(&self, machine: &str, what: impl FnOnce() -> T + Send) -> T {
        let file = std::fs::File::open(format!("/run/netns/{}", self.name(machine))).unwrap();
        let enter = move || {
            use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
            use std::os::fd::AsFd;
            move_into_link_name_space(file.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            what()
        };
        // The thread ends there; this one never leaves.
        std::thread::scope(|scope| scope.spawn(enter).join()).unwrap()
    }

    /// Takes a machine's cable out, or puts it in. No word of that reaches anybody.
    fn cable(&self, machine: &str, state: &str) {
        ip(&format!("-n {} link set eth0 {state}", self.name(machine))).unwrap();
    }

    fn firewall(&self, machine: &str, rule: &[&str]) {
        let name = self.name(machine);
        did("ip", &[&["netns", "exec", &name, "iptables", "-w"], rule].concat()).unwrap();
    }

    /// From now on a machine drops what comes from another.
    fn drop_from(&self, machine: &str, from: &str) {
        self.firewall(machine, &["-A", "INPUT", "-s", &address(from), "-j", "DROP"]);
    }

    /// And takes everything again.
    fn take_all(&self, machine: &str) {
        self.firewall(machine, &["-F", "INPUT"]);
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // Their ends of cables go with them.
        for machine in MACHINES.iter().chain(&["switch"]) {
            let _ = ip(&format!("netns del {}", self.name(machine)));
        }
    }
}

/// Removes the namespaces of runs that were killed.
fn remove_left_over() {
    let names = std::fs::read_dir("/run/netns")
        .into_iter()
        .flatten()
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    for name in names {
        let process = name.strip_prefix("cyc").and_then(|rest| rest.split_once('-')?.0.parse::<u32>().ok());
        if process.is_some_and(|process| !Path::new(&format!("/proc/{process}")).exists()) {
            let _ = ip(&format!("netns del {name}"));
        }
    }
}

fn address(machine: &str) -> String {
    let place = MACHINES.iter().position(|other| *other == machine).unwrap();
    format!("10.77.0.{}", place + 1)
}

/// A rig of five machines.
struct Rig {
    // Daemons end before their machines.
    daemons: Vec<(&'static str, Daemon)>,
    network: Network,
    folder: tempfile::TempDir,
}

impl Rig {
    fn start(network: Network, authority: &Authority, camera: &Path) -> Self {
        let mut rig = Self { daemons: Vec::new(), network, folder: tempfile::tempdir().unwrap() };
        let (backplane, camera) = (format!("{}:7400", address("desk")), camera.to_str().unwrap().to_owned());
        let scene = ["manager", "--scene", "runway", "--camera", &camera, "--views", "2", "--size", "96x64"];
        let pace = ["--samples", "1", "--rate", "20", "--lowest-resolution", "1"];
        let waits = ["--wait-for-boards", "3", "--wait-for-compositor"];
        let ports = ["--listen", &backplane, "--pose-listen", "127.0.0.1:7401", "--console", "127.0.0.1:7402"];
        rig.add("desk", &[&scene[..], &pace, &waits, &ports].concat(), Some(&authority.issue("manager", "desk")));
        let to = ["host", "play", &camera, "--to", "127.0.0.1:7401", "--size", "96x64", "--rate", "20", "--repeat"];
        rig.add("desk", &to, None);
        let shown = rig.manifest();
        let listen = format!("{}:7500", address("wall"));
        let args =
            ["compositor", "--backplane", &backplane, "--listen", &listen, "--manifest", shown.to_str().unwrap()];
        rig.add("wall", &args, Some(&authority.issue("compositor", "wall")));
        for board in ["a", "b", "c"] {
            let listen = format!("{}:7600", address(board));
            let args = ["channel", "--backplane", &backplane, "--listen", &listen, "--name", board];
            let small = ["--threads", "1", "--memory-limit", "256"];
            rig.add(board, &[&args[..], &small].concat(), Some(&authority.issue("board", board)));
        }
        rig
    }

    fn add(&mut self, machine: &'static str, args: &[&str], keys: Option<&PathBuf>) {
        let keys = keys.map(|folder| ["--keys", folder.to_str().unwrap()]);
        let args = [args, keys.as_ref().map_or(&[], |keys| &keys[..]), &["--supervised"]].concat();
        let daemon = self.network.on(machine, || Daemon::start(&args));
        self.daemons.push((machine, daemon));
    }

    fn daemon(&self, machine: &str) -> &Daemon {
        &self.daemons.iter().find(|(other, _)| *other == machine).unwrap().1
    }

    fn manifest(&self) -> PathBuf {
        self.folder.path().join("shown")
    }

    /// What was shown since the manager began to say what it depends on.
    fn shown(&self) -> Vec<String> {
        told_lines(&self.manifest())
    }

    fn wait(&self, what: &str, holds: impl Fn(&Value) -> bool) -> Value {
        wait_for(what, || self.network.on("desk", || stats(CONSOLE)).filter(|stats| holds(stats)))
    }

    /// Waits until all boards are in the row and all views of several pictures are whole.
    fn whole_again(&self) -> Value {
        let stats = self.wait("three boards", |stats| stats["boards"] == 3);
        let before = self.shown().len();
        let is_whole = |lines: &[String]| lines.len() >= 5 && !lines.concat().contains("\"complete\":false");
        wait_for("whole pictures", || {
            is_whole(self.shown().rchunks(5).next()?).then_some(()).filter(|()| self.shown().len() > before + 5)
        });
        stats
    }
}

/// How often each board has been put out or lost.
fn losses(stats: &Value) -> [usize; 3] {
    ["a", "b", "c"].map(|board| {
        let about = format!("board {board} ");
        count(stats, "put out", &about) + count(stats, "lost", &about)
    })
}

/// The pictures of the flight when one board draws them and nothing is done.
fn undisturbed(camera: &Path, folder: &Path) -> Undisturbed {
    let manifest = folder.join("undisturbed");
    let frames = POSES.to_string();
    let rig = ["rig", "runway", "--camera", camera.to_str().unwrap(), "--manifest", manifest.to_str().unwrap()];
    let size =
        ["--size", "96x64", "--samples", "1", "--views", "2", "--boards", "1", "--frames", &frames, "--console", "off"];
    let output = run(&[&rig[..], &size].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Undisturbed::read(std::fs::read(manifest).unwrap().as_slice()).unwrap()
}

/// Beyond loopback, without keys.
fn refused_without_keys(network: &Network) {
    let at = format!("{}:7400", address("desk"));
    for (machine, args) in [
        ("desk", &["manager", "--listen", &at][..]),
        ("a", &["channel", "--backplane", &at]),
        ("wall", &["compositor", "--backplane", &at]),
    ] {
        let output = network.on(machine, || run(args));
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && error.contains("beyond this machine"), "{args:?}: {error}");
    }
}

#[test]
fn machines_that_lose_each_other_in_every_way_find_each_other_again_and_show_no_wrong_picture() {
    let since = Instant::now();
    let passed = |what: &str| println!("{:>5.1} s  {what}", since.elapsed().as_secs_f64());
    let network = match Network::new() {
        Ok(network) => network,
        Err(why) => {
            println!("SKIPPED: network namespaces need root, iproute2 and iptables: {why}");
            return;
        }
    };
    refused_without_keys(&network);
    let folder = tempfile::tempdir().unwrap();
    let camera = folder.path().join("camera.json");
    let flight = builtin::build("runway").unwrap().camera;
    let each = flight.poses.len() / POSES;
    let poses = flight.poses.into_iter().step_by(each.max(1)).take(POSES).collect();
    std::fs::write(&camera, serde_json::to_string(&CameraFile { origin: flight.origin, poses }).unwrap()).unwrap();
    let undisturbed = undisturbed(&camera, folder.path());
    let authority = Authority::new();
    let rig = Rig::start(network, &authority, &camera);
    let net = &rig.network;
    rig.wait("three boards that draw", |stats| count(stats, "draws", "") == 3);
    let started = rig.whole_again();
    assert_eq!(losses(&started), [0; 3], "{started}");
    passed("three boards draw");

    // A cable is pulled.
    net.cable("b", "down");
    rig.wait("b's being missed", |stats| stats["boards"] == 2 && losses(stats)[1] > 0);
    net.cable("b", "up");
    let pulled = rig.whole_again();
    assert_eq!([losses(&pulled)[0], losses(&pulled)[2]], [0; 2], "{pulled}");
    passed("a cable was out");

    // Firewalls drop one way: the board hears nothing, and then isn't heard.
    for (machine, from) in [("b", "desk"), ("desk", "b")] {
        let before = losses(&rig.wait("statistics", |_| true))[1];
        net.drop_from(machine, from);
        rig.wait("b's being missed", |stats| stats["boards"] == 2 && losses(stats)[1] > before);
        net.take_all(machine);
        let stats = rig.whole_again();
        assert_eq!([losses(&stats)[0], losses(&stats)[2]], [0; 2], "from {from}: {stats}");
        passed("a firewall dropped one way");
    }

    // Two boards can't reach each other, and another that comes back makes a new wiring necessary: it gets between them.
    net.drop_from("a", "b");
    net.drop_from("b", "a");
    net.cable("c", "down");
    let missed = rig.wait("c's being missed", |stats| losses(stats)[2] > 0);
    net.cable("c", "up");
    rig.wait("another wiring of three", |stats| {
        stats["boards"] == 3 && count(stats, "wired", ": 3 boards") > count(&missed, "wired", ": 3 boards")
    });
    rig.whole_again();
    net.take_all("a");
    net.take_all("b");
    passed("two boards couldn't reach each other");

    // A board can't reach the compositor: its tiles don't come, so the last picture stays, and nothing else suffers.
    let before = rig.whole_again();
    net.drop_from("wall", "a");
    let swapped = before["frames"].as_u64().unwrap();
    rig.wait("frames without its tiles", |stats| stats["frames"].as_u64() > Some(swapped + 10));
    net.take_all("wall");
    let after = rig.whole_again();
    assert_eq!(losses(&after), losses(&before), "{after}");
    passed("a board couldn't reach the compositor");

    // Nobody can reach the manager.
    net.cable("desk", "down");
    rig.wait("an empty row", |stats| stats["boards"] == 0);
    for board in ["a", "b", "c"] {
        rig.daemon(board).says("no backplane; trying again");
    }
    net.cable("desk", "up");
    let last = rig.whole_again();
    passed("nobody could reach the manager");

    let compared = undisturbed.compare(rig.shown().concat().as_bytes()).unwrap();
    println!("{compared:?}; boards put out or lost: {:?}", losses(&last));
    assert!(compared.right > 50, "{compared:?}");
    assert_eq!(compared.wrong + compared.unknown + compared.backwards, 0, "{compared:?}");
}
