//! What is done to a simulated rig, and what must come of it.

use cyclorama_shell::{Census, Entry, Rig, of, undisturbed};
use proto::frame::REFERENCE_TILE;
use proto::limits;
use proto::link;
use proto::message::{Hello, Role};
use std::collections::BTreeSet;
use std::time::Duration;
use turmoil::net::TcpStream;

type Scenario = fn(u64) -> String;

/// All of them, by name.
pub(crate) const SCENARIOS: [(&str, Scenario); 10] = [
    ("boards_come_back_to_a_manager_that_was_killed_with_jittered_waits", restart),
    ("a_neighbour_link_that_is_cut_is_rewired_round", neighbours),
    ("a_partitioned_board_comes_back_by_itself", partition),
    ("a_board_that_is_heard_and_hears_nothing_comes_back_by_itself", deaf),
    ("a_board_that_hears_and_is_not_heard_comes_back_by_itself", mute),
    ("held_up_words_of_a_board_come_late_and_harm_nobody", held),
    ("peers_that_hang_are_cut", hung),
    ("the_compositor_is_followed_and_goes_on_with_a_whole_picture", compositor),
    ("connections_again_and_again_leave_nothing_behind", again),
    ("anything_may_happen", anything),
];

/// Longer than all time-outs of links together.
const SETTLE: Duration = Duration::from_secs(7);

fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// A rig in flight that has settled, and what it has of tasks and connections.
fn flying(seed: u64, boards: usize) -> (Rig, Census) {
    settled(Rig::new(seed, boards), boards)
}

fn settled(mut rig: Rig, boards: usize) -> (Rig, Census) {
    rig.until_flying(boards);
    rig.run(SETTLE);
    let census = rig.census();
    (rig, census)
}

/// Tasks and connections of the manager, of the compositor, and of the boards: the row may have another order than before.
fn by_role(census: &Census) -> [Vec<(usize, usize)>; 3] {
    let is_board = |name: &str| name.len() == 1;
    let mut boards: Vec<_> = census.iter().filter(|(name, _)| is_board(name)).map(|(_, counts)| *counts).collect();
    boards.sort_unstable();
    [vec![census["manager"]], vec![census["wall"]], boards]
}

/// All is as it was before, and every picture right.
fn ended(mut rig: Rig, before: &Census, boards: usize) -> String {
    rig.until("all boards again", |report| report.boards == boards);
    rig.run(SETTLE);
    let shown = rig.manifests().last().unwrap().lines().count();
    rig.run(ms(500));
    let manifests = rig.manifests();
    let last: Vec<&str> = manifests.last().unwrap().lines().skip(shown).collect();
    assert!(!last.is_empty() && last.iter().all(|line| !line.contains("\"complete\":false")), "whole\n{}", rig.log());
    assert_eq!(by_role(&rig.census()), by_role(before), "tasks and connections\n{}", rig.log());
    let compared = rig.compare(&undisturbed());
    assert!(compared.right > 50, "{compared:?}\n{}", rig.log());
    assert_eq!(compared.wrong + compared.unknown, 0, "{compared:?}\n{}", rig.log());
    assert!(compared.backwards <= rig.restarts(), "{compared:?}\n{}", rig.log());
    rig.note(&format!("{compared:?}"));
    rig.log().to_owned()
}

/// A board's dialling of the backplane since then.
fn dialled(rig: &Rig, board: &str, since: Duration) -> Vec<Entry> {
    rig.dialled(board, since).into_iter().filter(|entry| entry.to.starts_with("manager:")).collect()
}

fn restart(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 3);
    let since = rig.network().elapsed();
    rig.crash("manager");
    rig.run(ms(4000));
    rig.bounce("manager");
    let back = rig.network().elapsed();
    let report = rig.until("all boards again", |report| report.boards == 3);
    let took = rig.network().elapsed() - back;
    assert!(took <= Duration::from_secs(2), "{took:?}\n{}", rig.log());
    assert_eq!(report.streaming.pieces, 0, "nothing is sent again");
    let mut first = BTreeSet::new();
    for board in ["a", "b", "c"] {
        let dialled = dialled(&rig, board, since);
        assert!(dialled.len() > 4 && dialled.last().unwrap().came.is_ok(), "{dialled:?}");
        // A machine that is gone answers nobody, so each attempt takes its second; between them the waits double, with half as much more or less.
        let is_silence = |entry: &Entry| entry.came == Err(std::io::ErrorKind::TimedOut);
        for (k, pair) in dialled.windows(2).take_while(|pair| is_silence(&pair[0])).enumerate() {
            let (waited, nominal) = (pair[1].at - pair[0].at - Duration::from_secs(1), ms(100 << k));
            assert!(waited >= nominal / 2 && waited <= nominal * 3 / 2 + ms(5), "{k}: {waited:?} in {dialled:?}");
        }
        assert!(is_silence(&dialled[0]) && is_silence(&dialled[1]), "{dialled:?}");
        first.insert(dialled[1].at);
    }
    assert_eq!(first.len(), 3, "they don't knock together");
    ended(rig, &before, 3)
}

fn neighbours(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 4);
    rig.note("a and b are cut off from each other");
    rig.network().partition("a", "b");
    // A board that comes back makes a new wiring necessary.
    rig.crash("d");
    rig.until("its being missed", |report| report.boards == 3);
    rig.bounce("d");
    let report =
        rig.until("another wiring of four", |report| report.boards == 4 && of(report, "wired", "4 boards") > 1);
    for board in ["a", "b", "c"] {
        assert_eq!(of(&report, "lost", &format!("board {board} ")), 0, "{board}\n{}", rig.log());
    }
    rig.run(SETTLE);
    // They have dialled each other in vain, or were never neighbours.
    let is_between =
        |entry: &Entry, other: &str, rig: &mut Rig| entry.to == format!("{}:7600", rig.network().lookup(other));
    let since = Duration::ZERO;
    let (a, b) = (rig.dialled("a", since), rig.dialled("b", since));
    let met = a.iter().any(|entry| is_between(entry, "b", &mut rig))
        || b.iter().any(|entry| is_between(entry, "a", &mut rig));
    assert!(met, "they were neighbours once\n{}", rig.log());
    rig.network().repair("a", "b");
    ended(rig, &before, 4)
}

/// A board is cut off in one way; it is missed, and is back by itself, with all that it held.
fn cut_off(seed: u64, cut: impl Fn(&mut Rig), mend: impl Fn(&mut Rig), takes: Duration) -> String {
    let (mut rig, before) = flying(seed, 3);
    let report = rig.until("a flight", |_| true);
    rig.note("b is cut off");
    cut(&mut rig);
    rig.until("its being missed", |report| report.boards == 2 && of(report, "put out", "board b") == 1);
    rig.run(takes);
    rig.note("b is no longer cut off");
    mend(&mut rig);
    let after = rig.until("its coming back", |report| report.boards == 3 && of(report, "draws", "board b") == 2);
    assert_eq!(of(&after, "put out", "board a") + of(&after, "put out", "board c"), 0, "{}", rig.log());
    assert_eq!(after.streaming.pieces, report.streaming.pieces, "it has kept its meshes");
    ended(rig, &before, 3)
}

fn partition(seed: u64) -> String {
    let cut = |rig: &mut Rig| rig.network().partition("b", "manager");
    cut_off(seed, cut, |rig| rig.network().repair("b", "manager"), ms(5000))
}

fn deaf(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 3);
    rig.note("b no longer hears the manager");
    rig.network().partition_oneway("manager", "b");
    // It beats all the while, and draws nothing.
    rig.until("its being missed", |report| report.boards == 2);
    rig.run(ms(4000));
    rig.network().repair_oneway("manager", "b");
    let after = rig.until("its coming back", |report| report.boards == 3 && of(report, "draws", "board b") == 2);
    assert_eq!(of(&after, "put out", "board a") + of(&after, "put out", "board c"), 0, "{}", rig.log());
    ended(rig, &before, 3)
}

fn mute(seed: u64) -> String {
    let cut = |rig: &mut Rig| rig.network().partition_oneway("b", "manager");
    cut_off(seed, cut, |rig| rig.network().repair_oneway("b", "manager"), ms(4000))
}

fn held(seed: u64) -> String {
    // Less than the board waits before it dials again, so what was held comes over the link that was cut, to who is no longer there.
    let cut = |rig: &mut Rig| rig.network().hold("b", "manager");
    cut_off(seed, cut, |rig| rig.network().release("b", "manager"), ms(1500))
}

fn hung(seed: u64) -> String {
    let (mut rig, before) = settled(Rig::with_room(seed, 3, 64), 3);
    rig.client("silent", async {
        let stream = TcpStream::connect("manager:7400").await?;
        // It says nothing until it is cut.
        let opened = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
        tokio::time::sleep(Duration::from_secs(600)).await;
        drop(opened);
        Ok(())
    });
    rig.client("hung", async {
        let stream = TcpStream::connect("manager:7400").await?;
        let mut opened = link::open(stream, limits::CONTROL_MESSAGE_MAX).await?;
        let role = Role::Board { threads: 1, link: "hung:1".into(), memory: 1 << 28, drawn: REFERENCE_TILE };
        link::send(&mut opened, &Hello { name: "hung".into(), role }, &[]).await?;
        // It takes nothing more.
        tokio::time::sleep(Duration::from_secs(600)).await;
        drop(opened);
        Ok(())
    });
    let report =
        rig.until("both cut", |report| of(report, "refused", "in time") == 1 && of(report, "lost", "board hung") == 1);
    assert_eq!(of(&report, "put out", "board a") + of(&report, "lost", "board a"), 0, "{}", rig.log());
    ended(rig, &before, 3)
}

fn compositor(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 2);
    rig.crash("wall");
    let frames = rig.until("its being missed", |report| of(report, "lost", "compositor") == 1).frames;
    rig.until("frames without it", |report| report.frames > frames + 60);
    rig.bounce("wall");
    rig.until("its coming back", |report| of(report, "connected", "compositor") == 2);
    rig.run(ms(1000));
    let manifests = rig.manifests();
    let first = manifests[1].lines().next().expect("it shows something");
    assert!(!first.contains("\"complete\":false"), "it begins with a whole picture: {first:.300}");
    // The manager can't reach it, and then one board can't; the others' tiles come.
    rig.note("wall and a are cut off from each other");
    rig.network().hold("wall", "a");
    rig.run(ms(3000));
    rig.network().release("wall", "a");
    rig.run(ms(1000));
    rig.note("wall and manager are cut off from each other");
    rig.network().hold("wall", "manager");
    rig.run(ms(3000));
    rig.network().release("wall", "manager");
    let report = rig.until("flight", |_| true);
    assert_eq!(of(&report, "lost", "board") + of(&report, "put out", ""), 0, "{}", rig.log());
    ended(rig, &before, 2)
}

fn again(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 3);
    for k in 0..12 {
        let host = ["a", "b", "c", "wall"][k % 4];
        rig.crash(host);
        rig.run(ms(20 + 35 * k as u64));
        rig.bounce(host);
        rig.run(ms(90));
    }
    ended(rig, &before, 3)
}

/// Numbers from a seed: `SplitMix64`.
struct Random(u64);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (mixed ^ (mixed >> 31)) % end
    }
}

fn anything(seed: u64) -> String {
    let (mut rig, before) = flying(seed, 3);
    let mut random = Random(seed);
    let hosts = ["a", "b", "c", "wall", "manager"];
    for _ in 0..10 {
        let one = hosts[random.below(5) as usize];
        let other = hosts[random.below(5) as usize];
        let time = ms(30 + random.below(3000));
        match random.below(4) {
            0 => {
                rig.crash(one);
                rig.run(time);
                rig.bounce(one);
            }
            _ if one == other => {}
            // Links to the compositor count on TCP, which sends again what was lost.
            1 if ![one, other].contains(&"wall") => {
                rig.note(&format!("{one} and {other} are cut off from each other"));
                rig.network().partition(one, other);
                rig.run(time);
                rig.network().repair(one, other);
            }
            2 if ![one, other].contains(&"wall") => {
                rig.note(&format!("{one} is no longer heard by {other}"));
                rig.network().partition_oneway(one, other);
                rig.run(time);
                rig.network().repair_oneway(one, other);
            }
            _ => {
                rig.note(&format!("what {one} and {other} say is held up"));
                rig.network().hold(one, other);
                rig.run(time);
                rig.network().release(one, other);
            }
        }
        rig.note("that is over");
        rig.run(ms(random.below(1500)));
    }
    ended(rig, &before, 3)
}
