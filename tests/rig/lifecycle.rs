//! A rig in flight: it shows something, loses a board, and ends without leaving anything behind.

use crate::program::{Rig, is_alive, kill, wait_for};

const SMALL: [&str; 8] = ["--views", "2", "--boards", "3", "--size", "160x90", "--samples", "1"];

#[test]
fn the_page_shows_a_moving_picture_and_the_statistics() {
    let rig = Rig::start(&SMALL);
    let (head, page) = rig.get("/").unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.to_lowercase().contains("content-security-policy"), "{head}");
    assert!(String::from_utf8_lossy(&page).contains("id=\"picture\""));
    let picture = || rig.get("/picture.jpg").filter(|(head, _)| head.starts_with("HTTP/1.1 200")).map(|(_, jpeg)| jpeg);
    let first = wait_for("a picture", picture);
    let decoded = image::load_from_memory(&first).unwrap();
    assert_eq!((decoded.width(), decoded.height()), (320, 90));
    wait_for("another picture", || picture().filter(|jpeg| *jpeg != first));
    let stats = rig.wait("100 frames", |stats| stats["frames"].as_u64() > Some(100));
    assert!(stats["latency_ms"]["p50"].as_f64() > Some(0.0), "poses arrive: {stats}");
    assert_eq!(stats["dropped"]["unknown_entities"], 0, "the flight's entities are the scene's");
}

#[test]
fn a_killed_board_leaves_a_rig_of_complete_views() {
    let rig = Rig::start(&SMALL);
    rig.wait("three boards", |stats| stats["boards"] == 3 && stats["frames"].as_u64() > Some(10));
    let board = rig.children(&["channel", "--name", "1"])[0];
    kill(board);
    let after = rig.wait("the row closing up", |stats| stats["boards"] == 2);
    assert!(after["events"].to_string().contains("lost"), "{after}");
    // Complete again: frames go on and, from some moment on, no view repeats.
    let mut last = rig.stats().unwrap();
    wait_for("20 frames without a repeated view", || {
        let now = rig.stats()?;
        let frames = |stats: &serde_json::Value| stats["frames"].as_u64();
        if now["repeated_views"] != last["repeated_views"] {
            last = now;
            return None;
        }
        (frames(&now)? >= frames(&last)? + 20).then_some(())
    });
}

#[test]
fn ctrl_c_ends_all_processes() {
    let rig = Rig::start(&SMALL);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let children = rig.children(&[]);
    assert_eq!(children.len(), 6, "manager, compositor, host and three boards");
    let (status, took) = rig.interrupt();
    assert!(status.success(), "{status}");
    for pid in children {
        wait_for("the child's end", || (!is_alive(pid)).then_some(()));
    }
    println!("Ctrl-C to the end: {took:?}");
}

#[test]
fn a_rig_that_is_killed_leaves_no_process_behind() {
    let mut rig = Rig::start(&SMALL);
    rig.wait("flight", |stats| stats["frames"].as_u64() > Some(5));
    let children = rig.children(&[]);
    rig.child.kill().unwrap();
    rig.child.wait().unwrap();
    for pid in children {
        wait_for("the child's end", || (!is_alive(pid)).then_some(()));
    }
}

#[test]
fn a_board_that_is_asked_to_end_is_released_and_not_lost() {
    let rig = Rig::start(&SMALL);
    rig.wait("three boards", |stats| stats["boards"] == 3 && stats["frames"].as_u64() > Some(10));
    let board = rig.children(&["channel", "--name", "2"])[0];
    let pid = rustix::process::Pid::from_raw(board as i32).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
    let stats = rig.wait("its leaving", |stats| stats["events"].to_string().contains("\"left\""));
    assert!(!stats["events"].to_string().contains("\"lost\""), "{stats}");
}
