//! Whose turn it is: the niceness of the daemons' threads, as the system tells it.

use crate::program::{Rig, wait_for};
use std::collections::BTreeMap;

/// Niceness of a process's threads, by name, of which the first one's is `first`; the greatest of those of one name.
fn threads(pid: u32) -> BTreeMap<String, i32> {
    let mut found = BTreeMap::new();
    for task in std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten() {
        // A thread may end meanwhile.
        let Ok(stat) = std::fs::read_to_string(task.path().join("stat")) else { continue };
        // `number (name) state …`, of which the niceness is the 17th after the name: proc_pid_stat(5).
        let (head, rest) = stat.rsplit_once(')').unwrap();
        let (number, name) = head.split_once(" (").unwrap();
        // Threads without a name have the program's: only the first of them is known.
        let name = if number == pid.to_string() { "first" } else { name }.to_owned();
        let niceness = rest.split_whitespace().nth(16).unwrap().parse().unwrap();
        found.entry(name).and_modify(|kept: &mut i32| *kept = (*kept).max(niceness)).or_insert(niceness);
    }
    found
}

/// Whether this process may put itself before others (`CAP_SYS_NICE`).
fn is_privileged() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let effective = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap();
    u64::from_str_radix(effective.trim(), 16).unwrap() & (1 << 23) != 0
}

#[test]
fn words_go_first_drawing_goes_along_and_what_people_look_at_goes_behind() {
    let rig = Rig::start(&["city", "--size", "80x48", "--boards", "2", "--views", "2"]);
    rig.wait("frames", |stats| stats["frames"].as_u64() > Some(3));
    let own = rustix::process::getpriority_process(None).unwrap();
    let first = if is_privileged() { own.min(-10) } else { own };
    let of = |daemon: &str| threads(rig.children(&[daemon])[0]);
    let is = |found: &BTreeMap<String, i32>, name: &str, wanted: i32| found.get(name) == Some(&wanted);
    wait_for("a board's threads", || {
        let found = of("channel");
        let goes_along = ["painter", "loader"].iter().all(|name| is(&found, name, own));
        (is(&found, "first", first) && goes_along).then_some(())
    });
    wait_for("the manager's threads", || {
        let found = of("manager");
        (is(&found, "first", first) && is(&found, "engine", own) && is(&found, "console", own.max(10))).then_some(())
    });
    wait_for("the compositor's threads", || {
        let found = of("compositor");
        (is(&found, "first", first) && is(&found, "preview", 19)).then_some(())
    });
}
