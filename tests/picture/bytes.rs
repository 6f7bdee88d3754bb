//! The bytes suite: the same picture for any number of boards and threads.

use crate::render;
use std::path::Path;

#[test]
fn the_airport_is_the_same_for_any_boards_and_threads() {
    for (pose, samples) in [("0", "1"), ("500", "16"), ("1150", "64")] {
        let draw = |boards: &str, threads: &str| {
            let args = ["--pose", pose, "--samples", samples, "--size", "300x170"];
            render(Path::new("airport"), &[&args[..], &["--boards", boards, "--threads", threads]].concat())
        };
        let one = draw("1", "1");
        for (boards, threads) in [("1", "2"), ("2", "1"), ("3", "2"), ("5", "1"), ("5", "2")] {
            assert!(draw(boards, threads) == one, "pose {pose}: {boards} boards, {threads} threads");
        }
    }
}
