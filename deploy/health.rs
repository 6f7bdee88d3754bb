//! `cyclorama health`: one question to the manager's console, and an exit code.
//!
//! An image made from nothing has no shell and no `curl`, so the program that is in it asks by itself.

use crate::cli::HealthArgs;
use crate::error::CommandError;
use crate::output::say;
use crate::serve::host_name;
use serde_json::Value;

/// `cyclorama health`.
pub(crate) fn run(args: &HealthArgs) -> Result<(), CommandError> {
    let url = &args.url;
    let failed = |error: &dyn std::fmt::Display| CommandError::said(format!("{url}: {error}"));
    let answer = minreq::get(url).with_timeout(args.timeout).send().map_err(|error| failed(&error))?;
    let text = answer.as_str().map_err(|error| failed(&error))?;
    if answer.status_code != 200 {
        let said = text.lines().next().unwrap_or_default();
        return Err(failed(&format!("{} {}: {said}", answer.status_code, answer.reason_phrase)));
    }
    let Some(board) = &args.board else {
        say(text.trim_end());
        return Ok(());
    };
    let board = if board.is_empty() { host_name() } else { board.clone() };
    let known = boards(text).ok_or_else(|| failed(&"not the statistics of a rig; expected HOST:PORT/api/v1/stats"))?;
    if known.iter().any(|name| is_called(name, &board)) {
        say(&format!("board {board} is in the row"));
        Ok(())
    } else {
        Err(failed(&format!("no board {board:?} in the row, but {}: {}", known.len(), known.join(", "))))
    }
}

/// Whether a board of this name in the statistics is called so: with keys, its own word stands in brackets behind the certificate's.
fn is_called(name: &str, board: &str) -> bool {
    let own = name.strip_suffix(')').and_then(|name| name.rsplit_once(" (")).map(|(_, own)| own);
    name == board || own == Some(board)
}

/// The names of a rig's boards.
fn boards(statistics: &str) -> Option<Vec<String>> {
    let statistics: Value = serde_json::from_str(statistics).ok()?;
    let memory = statistics.get("memory")?.as_array()?;
    memory.iter().map(|row| row.get("board")?.as_str().map(str::to_owned)).collect()
}

#[cfg(test)]
mod tests {
    use super::{boards, is_called};

    #[test]
    fn boards_are_named_by_the_statistics() {
        let known = boards(r#"{"memory": [{"board": "pc1", "held_bytes": 3}, {"board": "pc2"}]}"#);
        assert_eq!(known, Some(vec!["pc1".into(), "pc2".into()]));
        assert!(is_called("pc1", "pc1") && is_called("board (9b10)", "9b10"));
        assert!(!is_called("pc1", "pc") && !is_called("board (9b10)", "9b1"));
        assert_eq!(boards(r#"{"memory": []}"#), Some(vec![]));
        assert_eq!(boards("ok"), None);
        assert_eq!(boards("{}"), None);
    }
}
