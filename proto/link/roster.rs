//! Which board is which: the names in boards' certificates, as the backplane tells them to who takes links from boards.

use crate::Identity;
use proto::ids::BoardKey;
use proto::link::LinkError;
use std::collections::BTreeMap;
use std::io;
use tokio::sync::watch;

/// The names of boards, by their keys.
pub type Roster = BTreeMap<BoardKey, String>;

/// Whether who says to be the board `key` is that board, as soon as the backplane has told of it: a board may be quicker than the
/// backplane's word.
///
/// # Errors
/// [`LinkError`] when its certificate has another name, or the daemon ends.
pub async fn check_board(
    key: BoardKey,
    identity: &Identity,
    roster: &mut watch::Receiver<Roster>,
) -> Result<(), LinkError> {
    let told = roster.wait_for(|names| names.contains_key(&key)).await;
    // The daemon ends.
    let Ok(names) = told else { return Err(LinkError::Closed) };
    match names.get(&key) {
        Some(name) if *name == identity.name => Ok(()),
        _ => Err(denied(format!("it says that it is board {key:?}, with the certificate of {identity}"))),
    }
}

/// A link is refused for this reason.
pub fn denied(what: String) -> LinkError {
    LinkError::Io(io::Error::new(io::ErrorKind::PermissionDenied, what))
}
