//! Rigs with keys: the same pictures, nothing in the clear, nobody in who doesn't belong, and keys that change in flight.

use crate::keys::{Authority, Daemon, board, manager, manager_at};
use crate::program::{Rig, files, fly, run, stats, wait_for};
use manager::scene::{Scene, builtin, import};
use proto::codec::encode_mesh;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

#[test]
fn a_rig_with_keys_writes_the_same_bytes() {
    let authority = Authority::new();
    let flight = ["--frames", "12", "--views", "2", "--boards", "3", "--size", "160x90", "--samples", "4"];
    let (open, sealed) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    fly(open.path(), &flight);
    fly(sealed.path(), &[&flight[..], &["--keys", authority.path()]].concat());
    let open = files(open.path());
    assert_eq!(open.len(), 12);
    assert_eq!(open, files(sealed.path()));
}

/// Runs, expects failure in one line, returns it.
fn fails(args: &[&str]) -> String {
    let output = run(args);
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{args:?}: {error}");
    assert_eq!(error.lines().filter(|line| line.starts_with("cyclorama: ")).count(), 1, "{args:?}: {error}");
    error
}

#[test]
fn beyond_this_machine_links_need_keys_or_a_word() {
    for args in [
        &["manager", "--listen", "0.0.0.0:0"][..],
        &["channel", "--listen", "0.0.0.0:0"],
        &["channel", "--backplane", "192.0.2.1:7400"],
        &["compositor", "--listen", "[::]:0"],
        &["compositor", "--backplane", "192.0.2.1:7400"],
    ] {
        let error = fails(args);
        assert!(error.contains("beyond this machine") && error.contains("`cyclorama keys`"), "{args:?}: {error}");
        assert!(error.contains("--keys") && error.contains("--insecure"), "{args:?}: {error}");
    }
    // What keys don't protect needs the word even with keys.
    let authority = Authority::new();
    let keys = authority.issue("manager", "desk");
    for option in ["--pose-listen", "--console"] {
        let error =
            fails(&["manager", "--keys", keys.to_str().unwrap(), "--listen", "127.0.0.1:0", option, "0.0.0.0:0"]);
        assert!(error.contains("with or without keys; say --insecure"), "{error}");
    }
}

#[test]
fn with_keys_a_rig_is_reached_beyond_loopback() {
    let authority = Authority::new();
    let (_manager, backplane, console) = manager_at("0.0.0.0:0", Some(&authority.issue("manager", "desk")));
    // Which address of this machine others would see; nothing is sent.
    let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
    let Ok(own) = socket.connect("192.0.2.1:9").and_then(|()| socket.local_addr()) else {
        println!("skipped: this machine has no address but loopback");
        return;
    };
    let backplane = SocketAddr::new(own.ip(), backplane.port()).to_string();
    let boards = ["pc1", "pc2"].map(|name| {
        let keys = authority.issue("board", name);
        let args = ["channel", "--backplane", &backplane, "--listen", "0.0.0.0:0", "--threads", "1", "--keys"];
        Daemon::start(&[&args[..], &[keys.to_str().unwrap()]].concat())
    });
    // Two: so neighbours reach each other too.
    let stats = wait_for("two boards", || stats(console).filter(|stats| stats["boards"] == 2 && stats["frames"] != 0));
    let events = stats["events"].to_string();
    assert!(events.contains("board pc1 (") && events.contains(&own.ip().to_string()), "{events}");
    drop(boards);
}

#[test]
fn keys_of_another_role_or_authority_and_no_keys_are_refused_and_told() {
    let (ours, theirs) = (Authority::new(), Authority::new());
    let (_manager, backplane, console) = manager(Some(&ours.issue("manager", "desk")));
    let address = backplane.to_string();

    let pc1 = ours.issue("board", "pc1");
    let error = fails(&["compositor", "--backplane", &address, "--keys", pc1.to_str().unwrap()]);
    assert!(error.contains("is for the board pc1, and a compositor needs one of role compositor"), "{error}");
    let wall = ours.issue("compositor", "wall");
    let error = fails(&["channel", "--backplane", &address, "--keys", wall.to_str().unwrap()]);
    assert!(error.contains("is for the compositor wall, and a board needs one of role board"), "{error}");

    board(backplane, Some(&theirs.issue("board", "pc1"))).says("its certificate is of another rig's authority");
    // It comes with its bare greeting, and is not understood.
    board(backplane, None).says("no backplane; trying again");
    let reasons = ["of another rig's authority", "it doesn't speak TLS; start it with keys of this rig"];
    wait_for("both refusals in the log", || {
        let events = stats(console)?["events"].to_string();
        reasons.iter().all(|reason| events.contains(reason)).then_some(())
    });
    let _board = board(backplane, Some(&pc1));
    wait_for("the board that belongs", || stats(console).filter(|stats| stats["boards"] == 1));
}

#[test]
fn an_expired_certificate_is_refused_with_its_date() {
    let authority = Authority::new();
    let folder = authority.issue("board", "pc1");
    let key = rcgen::KeyPair::from_pem(&std::fs::read_to_string(folder.join("key.pem")).unwrap()).unwrap();
    let read = |name: &str| std::fs::read_to_string(Path::new(authority.path()).join(name)).unwrap();
    let issuer_key = rcgen::KeyPair::from_pem(&read("authority.key.pem")).unwrap();
    let issuer = rcgen::Issuer::from_ca_cert_pem(&read("authority.pem"), issuer_key).unwrap();
    let mut params = rcgen::CertificateParams::new(["board.rig".to_owned(), "pc1.board.rig".to_owned()]).unwrap();
    (params.not_before, params.not_after) = (rcgen::date_time_ymd(2020, 1, 1), rcgen::date_time_ymd(2021, 2, 3));
    std::fs::write(folder.join("certificate.pem"), params.signed_by(&key, &issuer).unwrap().pem()).unwrap();
    let error = fails(&["channel", "--keys", folder.to_str().unwrap()]);
    assert!(error.contains("certificate.pem: this certificate has expired on 2021-02-03 00:00 UTC"), "{error}");
}

/// Forwards connections and keeps all that passes.
fn relay(to: SocketAddr) -> (SocketAddr, Arc<Mutex<Vec<u8>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let (address, seen) = (listener.local_addr().unwrap(), Arc::new(Mutex::new(Vec::new())));
    let record = seen.clone();
    std::thread::spawn(move || {
        for here in listener.incoming().map_while(Result::ok) {
            let there = TcpStream::connect(to).unwrap();
            for (from, into) in [(&here, &there), (&there, &here)] {
                let (mut from, mut into, record) =
                    (from.try_clone().unwrap(), into.try_clone().unwrap(), record.clone());
                std::thread::spawn(move || {
                    let mut bytes = vec![0; 1 << 16];
                    while let Ok(len @ 1..) = from.read(&mut bytes) {
                        record.lock().unwrap().extend_from_slice(&bytes[..len]);
                        if into.write_all(&bytes[..len]).is_err() {
                            break;
                        }
                    }
                    // The other side may be closed already.
                    let _ = into.shutdown(Shutdown::Both);
                });
            }
        }
    });
    (address, seen)
}

const SAMPLE: usize = 64;

/// 64 bytes of each mesh and of each texture as they travel; within the first slice, so that no head is between them.
fn samples(scene: &Scene) -> [Vec<Vec<u8>>; 2] {
    let sample = |bytes: &[u8]| {
        let at = bytes.len().min(60_000).saturating_sub(SAMPLE) / 2;
        bytes[at..at + SAMPLE].to_vec()
    };
    let meshes = scene.meshes.all().unwrap();
    let textures = scene.textures.sizes().map(|(id, _)| scene.textures.payload(id).unwrap());
    [
        meshes.values().map(|mesh| sample(&encode_mesh(mesh))).collect(),
        textures.filter(|bytes| bytes.len() > SAMPLE).map(|bytes| sample(&bytes)).collect(),
    ]
}

/// How many of the samples are in `bytes`.
fn found(samples: &[Vec<u8>], bytes: &[u8]) -> usize {
    let mut by_start: BTreeMap<&[u8], Vec<&Vec<u8>>> = BTreeMap::new();
    for sample in samples {
        by_start.entry(&sample[..8]).or_default().push(sample);
    }
    let mut seen = std::collections::BTreeSet::new();
    for at in 0..bytes.len().saturating_sub(SAMPLE) {
        for sample in by_start.get(&bytes[at..at + 8]).into_iter().flatten() {
            if bytes[at..].starts_with(sample) {
                seen.insert(sample.as_slice());
            }
        }
    }
    seen.len()
}

/// What passes between a manager and a board until the board has all of the scene.
fn overheard(keys: Option<(&Path, &Path)>) -> Vec<u8> {
    let (_manager, backplane, console) = manager(keys.map(|(manager, _)| manager));
    let (address, seen) = relay(backplane);
    let _board = board(address, keys.map(|(_, board)| board));
    let is_whole = |stats: &Value| stats["boards"] == 1 && stats["memory"][0]["held_bytes"] == stats["scene_bytes"];
    wait_for("a board with all of the scene", || stats(console).filter(is_whole));
    let seen = seen.lock().unwrap();
    seen.clone()
}

#[test]
fn nothing_of_the_scene_travels_in_the_clear() {
    let built = builtin::build("airport").unwrap();
    let [meshes, textures] = samples(&import::load_glb(&built.glb, built.name).unwrap());
    // Without keys the search finds what it looks for, so that finding nothing means something.
    let open = overheard(None);
    let all = |samples: &[Vec<u8>]| samples.iter().collect::<std::collections::BTreeSet<_>>().len();
    assert_eq!(found(&meshes, &open), all(&meshes));
    assert_eq!(found(&textures, &open), all(&textures));
    assert!(all(&meshes) > 10 && all(&textures) > 0);

    let authority = Authority::new();
    let sealed = overheard(Some((&authority.issue("manager", "desk"), &authority.issue("board", "pc1"))));
    assert!(sealed.len() > open.len(), "the same has travelled: {} and {} bytes", sealed.len(), open.len());
    assert_eq!((found(&meshes, &sealed), found(&textures, &sealed)), (0, 0));
}

/// Value of an option on the command line of a rig's child.
fn option(pid: u32, option: &str) -> String {
    let command = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap();
    command.split('\0').skip_while(|arg| *arg != option).nth(1).unwrap().to_owned()
}

fn flying(authority: &Authority) -> (Rig, SocketAddr) {
    let small = ["--views", "1", "--boards", "2", "--size", "96x64", "--samples", "1", "--rate", "10"];
    let rig = Rig::start(&[&small[..], &["--keys", authority.path()]].concat());
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5) && stats["boards"] == 2);
    let backplane = option(rig.children(&["channel"])[0], "--backplane").parse().unwrap();
    (rig, backplane)
}

#[test]
fn keys_and_even_the_authority_are_replaced_in_flight() {
    let (old, new) = (Authority::new(), Authority::new());
    let (rig, backplane) = flying(&old);
    let pids =
        ["manager", "compositor", "channel"].iter().flat_map(|command| rig.children(&[command])).collect::<Vec<_>>();
    let nodes: Vec<PathBuf> = pids.iter().map(|pid| option(*pid, "--keys").into()).collect();
    assert_eq!(nodes.len(), 4);
    let reissue = |authority: &Authority| {
        for folder in &nodes {
            let (role, name) = folder.file_name().unwrap().to_str().unwrap().split_once('-').unwrap();
            authority.issue_into(role, name, folder);
        }
    };
    let file = |authority: &Authority| Path::new(authority.path()).join("authority.pem");
    let [old_pem, new_pem] = [&old, &new].map(|authority| std::fs::read_to_string(file(authority)).unwrap());

    let before = rig.stats().unwrap();
    // As docs/keys.md has it: all trust both; all are issued by the new one; none trusts the old one.
    std::fs::write(file(&old), format!("{old_pem}{new_pem}")).unwrap();
    reissue(&old);
    std::fs::write(file(&new), format!("{new_pem}{old_pem}")).unwrap();
    reissue(&new);
    std::fs::write(file(&new), &new_pem).unwrap();
    reissue(&new);
    let frames = before["frames"].as_u64().unwrap();
    let after = rig.wait("more frames", |stats| stats["frames"].as_u64() > Some(frames + 20));
    assert_eq!((&after["late_frames"], &after["boards"]), (&before["late_frames"], &before["boards"]), "{after}");
    assert!(!after["events"].to_string().contains("\"lost\""), "{after}");

    // It knows only the new authority, and manager, compositor and its neighbour show it certificates of that.
    let _board = board(backplane, Some(&new.issue("board", "fresh")));
    let joined = rig.wait("three boards", |stats| stats["boards"] == 3);
    assert_eq!(joined["late_frames"], before["late_frames"], "{joined}");
    board(backplane, Some(&old.issue("board", "stale"))).says("another rig's authority");
    let frames = joined["frames"].as_u64().unwrap();
    let last = rig.wait("complete frames", |stats| stats["frames"].as_u64() > Some(frames + 20));
    assert_eq!(last["boards"], 3, "{last}");
    assert!(!last["events"].to_string().contains("put out"), "{last}");
}

#[test]
fn a_thousand_connections_of_rubbish_and_silence_keep_no_board_out() {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile);
    rustix::process::setrlimit(
        rustix::process::Resource::Nofile,
        rustix::process::Rlimit { current: limit.maximum, maximum: limit.maximum },
    )
    .unwrap();
    let authority = Authority::new();
    let (rig, backplane) = flying(&authority);
    // Nothing; the head of a handshake that never comes; and noise.
    let says: [&[u8]; 3] = [b"", &[22, 3, 1, 2, 0, 1, 0], b"GET / HTTP/1.1\r\n\r\n"];
    let connections: Vec<TcpStream> = (0..1000)
        .map(|k| {
            let mut stream = TcpStream::connect(backplane).unwrap();
            // The manager may have closed it at once.
            let _ = stream.write_all(says[k % 3]);
            stream
        })
        .collect();
    let frames = rig.stats().unwrap()["frames"].as_u64().unwrap();
    let _board: Daemon = board(backplane, Some(&authority.issue("board", "late")));
    rig.wait("a third board", |stats| stats["boards"] == 3);
    rig.wait("more frames", |stats| stats["frames"].as_u64() > Some(frames + 10));
    let dropped = rig.wait("all of them dropped", |stats| stats["dropped"]["connections"].as_u64() >= Some(1000));
    assert_eq!(dropped["boards"], 3, "{dropped}");
    assert!(!dropped["events"].to_string().contains("\"lost\""), "{dropped}");
    drop(connections);
}
