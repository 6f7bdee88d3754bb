//! Which of two backplanes leads: the engine's end of the chain's terms ([`proto::chain::StandBy`]).
//!
//! A manager that is started as the first leads without a term, as if there could be no other, until a stand-by has come and a frame was shown
//! that most boards were ready with; then it takes a term of its own, because nobody leads by one, and shows from then on only what a majority
//! of its boards has drawn. Every later term is won. So a manager that was started as the first, of whose boards one remembers a term, has
//! been replaced, or would have been: it stands by, and asks the boards like any other.
//!
//! A stand-by has imported the scene, hears boards, compositor and host, and sends nobody any work. What boards hold it is told with their
//! grant ([`FromBoard::Holding`]), so that nothing is sent again.

use super::{Board, Engine, clock};
use crate::backplane::ahead::Ahead;
use crate::backplane::calm::Calm;
use crate::backplane::links::Outbox;
use crate::backplane::live::LeadLine;
use bytes::Bytes;
use proto::chain::{
    Answer, Ask, BEAT, BackplaneChain, BetweenBackplanes, ClockMode, NoStandBy, Quorum, Seen, StandBy, StandByOutput,
};
use proto::codec::encode;
use proto::ids::{BoardKey, ContentId, Epoch, FrameNumber, Term};
use proto::limits;
use proto::message::{FromBoard, Swap, ToBoard};
use proto::time::Time;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::SystemTime;

/// The link that we open to the other backplane; those that are opened to us have the names that all our guests have.
pub(crate) const OPENED: BoardKey = BoardKey(0);

/// Names of pieces that are kept of what one board says it holds. More than a scene's meshes and textures can't be.
const HELD_BYTES_MAX: usize = 2 * limits::SUBOBJECTS_MAX * size_of::<ContentId>();

/// The highest term that is believed: seconds since 1970 until 2072, and years of elections to spare below the last that an epoch can have.
const TERM_MAX: u64 = 3 << 30;
/// The highest frame number that is believed: far more than a rig can show.
const FRAME_MAX: u64 = 1 << 62;

/// Whether an answer can be true. None of our own sums with what is in it can overflow then.
fn is_possible(answer: &Answer) -> bool {
    match answer {
        Answer::Refused { term } => term.0 <= TERM_MAX,
        Answer::Granted { term, wiring, newest } => {
            let is_seen = |seen: &Seen| seen.id < seen.total && seen.epoch.term() <= *term;
            term.0 <= TERM_MAX && newest.0 <= FRAME_MAX && wiring.as_ref().is_none_or(is_seen)
        }
    }
}

#[derive(Debug)]
enum Role {
    Leads,
    /// It has heard of no term yet: nobody could grant one.
    Waits,
    StandsBy(Box<StandBy>),
}

/// What a board has said it holds, for when we lead.
#[derive(Debug, Default)]
pub(super) struct Held {
    term: Term,
    messages: Vec<(Option<ContentId>, bool, Bytes)>,
}

/// The other backplane.
#[derive(Debug)]
struct Peer {
    outbox: Outbox,
    /// Where it is: the address that we open, or its machine's.
    at: Arc<str>,
    since: Time,
}

/// See the module's head.
#[derive(Debug)]
pub(super) struct Leadership {
    role: Role,
    /// Since when.
    since: Time,
    /// By which it leads; 0: nobody can replace it.
    term: Term,
    rank: u64,
    /// The highest term that it has heard of.
    highest: Term,
    peers: BTreeMap<BoardKey, Peer>,
    /// Where the last one was, there or not.
    other: Option<Arc<str>>,
    /// When the other backplane must hear that we lead.
    beat: Time,
    /// The wiring for which the stand-by's consent was asked last.
    asked: Option<Epoch>,
    /// A stand-by has come to who leads without a term; it has heard of no term above this.
    awaits: Option<Term>,
}

impl Leadership {
    pub(super) fn new(stands_by_for: Option<&str>) -> Self {
        let stands_by = stands_by_for.is_some();
        Self {
            role: if stands_by { Role::Waits } else { Role::Leads },
            since: Time(0),
            other: stands_by_for.map(Arc::from),
            term: Term(0),
            rank: stands_by.into(),
            highest: Term(0),
            peers: BTreeMap::new(),
            beat: Time(0),
            asked: None,
            awaits: None,
        }
    }

    pub(super) fn leads(&self) -> bool {
        matches!(self.role, Role::Leads)
    }

    /// By which it leads.
    pub(super) fn term(&self) -> Term {
        self.term
    }

    pub(super) fn next_timeout(&self) -> Option<Time> {
        match &self.role {
            Role::Leads => (self.term > Term(0) && !self.peers.is_empty()).then_some(self.beat),
            Role::Waits => None,
            Role::StandsBy(stand_by) => stand_by.next_timeout(),
        }
    }

    fn tell(&self, message: BetweenBackplanes) {
        let bytes = encode(&message, &[]);
        for peer in self.peers.values() {
            peer.outbox.send(bytes.clone());
        }
    }
}

impl Engine {
    /// A link to the other backplane is up.
    pub(super) fn on_peer(&mut self, key: BoardKey, name: &str, from: SocketAddr, outbox: Outbox) {
        let at = if key == OPENED { name.to_owned() } else { from.ip().to_string() };
        let (name, now) = (format!("{name} ({from})"), self.now());
        let refuse = |outbox: &Outbox, why| {
            outbox.send(encode(&BetweenBackplanes::Refused { why }, &[]));
            outbox.close();
        };
        if self.is_lock_step() {
            refuse(&outbox, NoStandBy::LockStep);
            self.log("refused", format!("stand-by {name}: in lock-step there can be none"));
            return;
        }
        if key != OPENED && self.leadership.peers.keys().any(|key| *key != OPENED) {
            refuse(&outbox, NoStandBy::Taken);
            self.log("refused", format!("stand-by {name}: there is one already"));
            return;
        }
        let leadership = &mut self.leadership;
        outbox.send(encode(
            &match leadership.role {
                Role::Leads if leadership.term > Term(0) => BetweenBackplanes::Leads { term: leadership.term },
                // What it leads by depends on what the other says first.
                Role::Leads => BetweenBackplanes::Stands { highest: Term(0) },
                Role::Waits | Role::StandsBy(_) => BetweenBackplanes::Stands { highest: leadership.highest },
            },
            &[],
        ));
        let at: Arc<str> = at.into();
        leadership.other = Some(Arc::clone(&at));
        leadership.peers.insert(key, Peer { outbox, at, since: now });
        self.log("connected", format!("the other backplane, {name}"));
    }

    /// A link to the other backplane is down, or couldn't be made.
    pub(super) fn on_peer_lost(&mut self, key: BoardKey, reason: &str) {
        let was_up = self.leadership.peers.remove(&key).is_some();
        if was_up {
            self.log("lost", format!("the other backplane: {reason}"));
        }
        if self.leadership.peers.is_empty() {
            self.leadership.awaits = None;
        }
        let now = self.now();
        if let (true, Role::StandsBy(stand_by)) = (self.leadership.peers.is_empty(), &mut self.leadership.role)
            && (was_up || key == OPENED)
        {
            stand_by.on_leader_lost(now);
        }
    }

    /// The other backplane says something.
    pub(super) fn on_peer_said(&mut self, key: BoardKey, message: BetweenBackplanes) {
        if !self.leadership.peers.contains_key(&key) {
            return;
        }
        if let BetweenBackplanes::Leads { term } | BetweenBackplanes::Stands { highest: term } = message
            && term.0 > TERM_MAX
        {
            if let Some(peer) = self.leadership.peers.get(&key) {
                peer.outbox.cut();
            }
            self.log("refused", format!("the other backplane: term {term} is none that there can be"));
            return;
        }
        let now = self.now();
        match (&mut self.leadership.role, message) {
            (Role::Leads, BetweenBackplanes::Consented { epoch }) => self.chain.on_consent(epoch),
            (Role::Leads, BetweenBackplanes::Leads { term }) if term > self.leadership.term => {
                self.resign(term, "the other backplane leads");
            }
            (Role::Leads, BetweenBackplanes::Stands { highest }) if self.leadership.term == Term(0) => {
                self.leadership.awaits = self.leadership.awaits.max(Some(highest));
                // A frame must be shown first.
                self.calm.disturb();
            }
            (Role::Waits, BetweenBackplanes::Leads { term }) => {
                self.stand_by(term);
                self.on_peer_said(key, message);
            }
            (_, BetweenBackplanes::Refused { why }) => {
                let why = match why {
                    NoStandBy::LockStep => "it flies in lock-step, where there can be none",
                    NoStandBy::Taken => "it has one already",
                };
                self.log("refused", format!("the other backplane takes no stand-by: {why}"));
            }
            (Role::StandsBy(stand_by), message) => stand_by.on_leader(now, message),
            _ => {}
        }
    }

    /// A frame was shown. If a stand-by has come to who leads without a term, and most boards were ready, a term is taken. Nobody leads by one: not
    /// the other, and of our own boards none has drawn under any.
    pub(super) fn take_first_term_if_due(&mut self, swap: &Swap) {
        let leadership = &mut self.leadership;
        if !leadership.leads() || leadership.term > Term(0) || !self.chain.may_take_term(swap) {
            return;
        }
        let Some(highest) = leadership.awaits.take() else { return };
        // Above those of earlier lives of this rig, of which the compositor may know.
        let clock = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let past = Term(clock.as_secs().min(TERM_MAX)).max(highest);
        let term = past.next_of(0);
        let now = self.now();
        (self.leadership.term, self.leadership.beat) = (term, now);
        self.chain.on_term(now, term);
        self.calm.disturb();
        // The others follow already, and learn it from the wiring; what these may have begun to say was to who has no term.
        for (key, board) in self.boards.iter().filter(|(_, board)| !board.is_known) {
            self.stream.on_lost(*key);
            self.stream.on_board(*key, board.memory, self.config.board_memory);
            board.outbox.send(encode(&ToBoard::Ask(Ask { term, leads: true }), &[]));
        }
        self.log("leads", format!("by term {term}, for there is a stand-by"));
    }

    fn stand_by(&mut self, highest: Term) {
        let now = self.now();
        let leadership = &mut self.leadership;
        leadership.highest = leadership.highest.max(highest);
        let mut stand_by = StandBy::new(now, leadership.rank, leadership.highest);
        for (key, _) in self.boards.iter().filter(|(_, board)| !board.is_out) {
            stand_by.on_board(now, *key);
        }
        if leadership.leads() {
            leadership.since = now;
        }
        leadership.role = Role::StandsBy(Box::new(stand_by));
    }

    /// It no longer leads: another does, or boards have promised to follow one.
    fn resign(&mut self, term: Term, why: &str) {
        (self.leadership.term, self.leadership.awaits) = (Term(0), None);
        self.stand_by(term);
        self.begin_row(BackplaneChain::new(), FrameNumber(0));
        self.log("resigned", format!("{why}, by term {term}; this one stands by"));
    }

    /// Everything that depends on who leads begins anew: no board is in the row, and none has been sent anything.
    fn begin_row(&mut self, chain: BackplaneChain, first: FrameNumber) {
        self.chain = chain;
        if let ClockMode::RealTime { period } = self.config.mode {
            self.chain.set_period(period);
        }
        self.clock = clock(&self.config, first, self.director.views().len());
        (self.calm, self.ahead) = (Calm::default(), Ahead::new(self.config.select_ahead));
        (self.last_swap, self.broken, self.leadership.asked) = (None, None, None);
        for (key, board) in &mut self.boards {
            self.stream.on_lost(*key);
            self.stream.on_board(*key, board.memory, self.config.board_memory);
            board.begin();
        }
    }

    /// A board says something while we don't lead, or something about terms. Returns whether that is all that it is to do.
    pub(super) fn on_board_term(&mut self, key: BoardKey, message: &FromBoard, payload: &Bytes) -> bool {
        let now = self.now();
        if matches!(message, FromBoard::Answer(answer) if !is_possible(answer)) {
            self.put_out(key, "it answers with a term, a place or a frame that there can't be");
            return true;
        }
        let Some(board) = self.boards.get_mut(&key).filter(|board| !board.is_out) else { return true };
        match (&mut self.leadership.role, message) {
            (Role::Leads, FromBoard::Answer(Answer::Refused { term })) => {
                board.claims = Some(*term);
                self.on_claim(*term);
                return true;
            }
            (Role::Leads, FromBoard::Answer(Answer::Granted { wiring, .. })) => {
                if let Some(seen) = wiring {
                    board.is_heir = true;
                    self.chain.on_granted(key, *seen);
                }
                return true;
            }
            // It was said to who led before, or by another term than we do.
            (Role::Leads, FromBoard::Holding { term, .. }) => return *term != self.leadership.term,
            (Role::Leads, _) => return false,
            (Role::Waits, FromBoard::Answer(Answer::Refused { term })) if *term > Term(0) => self.stand_by(*term),
            (Role::StandsBy(stand_by), message) => {
                stand_by.on_heard(now, key);
                if let FromBoard::Answer(answer) = message {
                    board.is_heir = matches!(answer, Answer::Granted { wiring: Some(_), .. });
                    stand_by.on_answer(key, *answer);
                }
            }
            (Role::Waits, _) => {}
        }
        let Some(board) = self.boards.get_mut(&key) else { return true };
        match message {
            FromBoard::Leave => board.is_leaving = true,
            FromBoard::Holding { term, scene, more } if !board.keep(*term, *scene, *more, payload) => {
                self.put_out(key, "it holds more than a scene can have");
            }
            _ => {}
        }
        true
    }

    /// A board says that it serves another term than we lead by. Where there is no stand-by, one board alone doesn't end the rig.
    fn on_claim(&mut self, term: Term) {
        let claims = self.boards.values().filter(|board| board.claims.is_some()).count();
        let is_alone = self.leadership.term == Term(0) && claims * 2 <= self.boards.len();
        if term <= self.leadership.term {
            return;
        }
        if is_alone {
            self.log("refused", format!("a board that remembers term {term}, which most don't"));
        } else {
            self.resign(term, "boards follow another backplane, or remember one");
        }
    }

    /// A board has said hello.
    pub(super) fn on_board_there(&mut self, key: BoardKey) {
        let now = self.now();
        match &mut self.leadership.role {
            Role::Leads if self.leadership.term > Term(0) => {
                // It has perhaps a grant to add, and otherwise wouldn't know who leads.
                let ask = Ask { term: self.leadership.term, leads: true };
                if let Some(board) = self.boards.get(&key) {
                    board.outbox.send(encode(&ToBoard::Ask(ask), &[]));
                }
            }
            Role::StandsBy(stand_by) => stand_by.on_board(now, key),
            Role::Leads | Role::Waits => {}
        }
    }

    /// A board is gone.
    pub(super) fn on_board_gone(&mut self, key: BoardKey) {
        if let Role::StandsBy(stand_by) = &mut self.leadership.role {
            stand_by.on_board_lost(key);
        }
    }

    /// Does what is due between the backplanes.
    pub(super) fn attend(&mut self) {
        let now = self.now();
        if let Role::StandsBy(stand_by) = &mut self.leadership.role {
            stand_by.on_timeout(now);
        }
        while let Role::StandsBy(stand_by) = &mut self.leadership.role
            && let Some(output) = stand_by.poll_output()
        {
            match output {
                StandByOutput::Ask(key, ask) => {
                    if let Some(board) = self.boards.get(&key) {
                        board.outbox.send(encode(&ToBoard::Ask(ask), &[]));
                    }
                }
                StandByOutput::Beat => self.tell_boards(&ToBoard::Alive),
                StandByOutput::Drop(key) => {
                    self.put_out(key, "it has been silent for too long");
                    self.on_board_gone(key);
                }
                StandByOutput::ToLeader(message) => self.leadership.tell(message),
                StandByOutput::Lead { term, first, quorum } => self.lead(term, first, quorum),
            }
        }
        self.beat(now);
    }

    /// Says to the other backplane that we lead, and asks for its consent if that is needed.
    fn beat(&mut self, now: Time) {
        let leadership = &mut self.leadership;
        if !leadership.leads() || leadership.term == Term(0) || leadership.peers.is_empty() {
            return;
        }
        let wanted = self.chain.wants_consent();
        if now < leadership.beat && wanted == leadership.asked {
            return;
        }
        leadership.asked = wanted;
        if now >= leadership.beat {
            leadership.beat = now + BEAT;
        }
        leadership.tell(BetweenBackplanes::Leads { term: leadership.term });
        if let Some(epoch) = wanted {
            leadership.tell(BetweenBackplanes::Consent { epoch });
        }
    }

    /// A majority of the boards has granted a term.
    fn lead(&mut self, term: Term, first: FrameNumber, quorum: Quorum) {
        let now = self.now();
        (self.leadership.role, self.leadership.term, self.leadership.beat) = (Role::Leads, term, now);
        self.leadership.since = now;
        self.begin_row(BackplaneChain::in_term(term, quorum), first);
        self.broken = Some((now, self.statistics.late_frames));
        self.log("leads", format!("by term {term}, granted by a majority of the boards"));
        // Those that haven't granted it follow it now.
        self.tell_boards(&ToBoard::Ask(Ask { term, leads: true }));
        let keys: Vec<BoardKey> = self.boards.keys().copied().collect();
        for key in keys {
            let Some(board) = self.boards.get_mut(&key) else { continue };
            let Held { term: of, messages } = std::mem::take(&mut board.held);
            for (scene, more, payload) in messages.into_iter().filter(|_| of == term) {
                self.on_holding(key, scene, more, &payload);
            }
        }
    }

    /// Takes note of a frame that too few boards were ready with: what is shown stays.
    pub(super) fn hold(&mut self, swap: &Swap) {
        self.statistics.held_frames += 1;
        self.statistics.late_frames += 1;
        self.statistics.repeated_views += swap.complete.len() as u64;
        // It must be drawn again, even if nothing moves.
        self.calm.on_swap(false);
    }

    /// Who leads, if that isn't we.
    pub(super) fn leader(&self) -> Option<Arc<str>> {
        let leadership = &self.leadership;
        (!leadership.leads()).then(|| leadership.other.clone().unwrap_or_else(|| "another manager".into()))
    }

    /// What the console is told of all this.
    pub(super) fn lead_line(&self) -> LeadLine {
        let leadership = &self.leadership;
        // There are two if each has opened a link to the other; either will do.
        let other = leadership.peers.values().next().map(|peer| (Arc::clone(&peer.at), peer.since));
        let (leads, of) = (leadership.leads(), self.leader());
        let term = if leads { leadership.term } else { leadership.highest };
        LeadLine { leads, term: term.0, since: leadership.since, other, of }
    }

    /// What the console says of the epoch: how many there have been in this term.
    pub(super) fn epochs(&self) -> u64 {
        let epoch = self.chain.epoch();
        epoch.0 - Epoch::first_of(epoch.term()).0
    }
}

impl Board {
    /// Nothing has been sent to it.
    fn begin(&mut self) {
        self.lists.clear();
        (self.moved, self.mixtures, self.views) = (None, None, 0);
        (self.is_known, self.has_table, self.has_joined, self.draws) = (false, false, false, false);
        self.claims = None;
    }

    /// Keeps what it says it holds. False: that is more than can be.
    fn keep(&mut self, term: Term, scene: Option<ContentId>, more: bool, payload: &Bytes) -> bool {
        let held = &mut self.held;
        if held.term != term || held.messages.last().is_some_and(|(_, more, _)| !more) {
            *held = Held { term, messages: Vec::new() };
        }
        held.messages.push((scene, more, payload.clone()));
        // A message counts for a little even if it names nothing.
        held.messages.iter().map(|(.., names)| names.len() + size_of::<Bytes>()).sum::<usize>() <= HELD_BYTES_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_that_our_sums_would_overflow_with_are_not_believed() {
        let granted = |term, epoch, id, newest| {
            let seen = Seen { epoch: Epoch(epoch), id, total: 3 };
            is_possible(&Answer::Granted { term: Term(term), wiring: Some(seen), newest: FrameNumber(newest) })
        };
        let epoch = |term| Epoch::first_of(Term(term)).0 + 1;
        assert!(granted(3, epoch(2), 2, 9) && granted(3, epoch(3), 0, 0));
        assert!(!granted(3, epoch(4), 2, 9), "a wiring of a term above the one that is granted");
        assert!(!granted(3, epoch(2), 3, 9), "the fourth of three");
        assert!(!granted(3, epoch(2), 2, u64::MAX) && !granted(u64::MAX, epoch(2), 2, 9));
        assert!(is_possible(&Answer::Refused { term: Term(TERM_MAX) }));
        assert!(!is_possible(&Answer::Refused { term: Term(TERM_MAX + 1) }));
    }
}
