//! A display: shows some of the views, as the compositor does. Tiles of a frame go onto the canvas only at its swap, so what is
//! seen is always a picture that was shown as a whole.

use crate::context::{Context, Masks, Packet};
use crate::net::{Node, Purpose, Wire};
use proto::codec::decode;
use proto::frame::PixelFormat;
use proto::ids::{BoardKey, Epoch, FrameNumber, Term};
use proto::message::{Hello, Role, Swap, TileMessage, ToCompositor};
use proto::time::Time;
use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

/// Frames of one board that may wait for their swap.
const DONE_MAX: usize = 64;
/// Swaps that may wait for tiles.
const SWAPS_MAX: usize = 120;
/// How long until a link to a backplane is tried again.
const AGAIN: Duration = Duration::from_millis(30);

type Sender = (u8, BoardKey);
/// What a board has drawn, the newest last.
type Drawn = VecDeque<(Epoch, FrameNumber, Masks)>;

/// See the module's head.
#[derive(Debug)]
pub(crate) struct Display {
    node: Node,
    index: u8,
    sessions: [Option<Wire>; 2],
    again: [Option<Time>; 2],
    senders: BTreeMap<Sender, (Wire, Drawn)>,
    swaps: VecDeque<(u8, Swap)>,
    term: Term,
    shown: Option<FrameNumber>,
    /// The link to who may lead without a term is new.
    may_be_anew: bool,
}

impl Display {
    /// A display whose process has just started.
    pub(crate) fn new(index: u8) -> Self {
        Self {
            node: Node::Display(index),
            index,
            sessions: [None, None],
            again: [Some(Time(0)), Some(Time(0))],
            senders: BTreeMap::new(),
            swaps: VecDeque::new(),
            term: Term(0),
            shown: None,
            may_be_anew: false,
        }
    }

    /// The frame that is shown.
    pub(crate) fn shown(&self) -> Option<FrameNumber> {
        self.shown
    }

    /// A link is up.
    pub(crate) fn on_up(&mut self, context: &mut Context, wire: Wire, purpose: Purpose) {
        context.log(self.node, || format!("up {wire:?} {purpose:?}"));
        match purpose {
            Purpose::Show => {
                if let Node::Manager(rank) = context.net.peer(self.node, wire) {
                    let role = Role::Compositor {
                        listen: self.index.to_string(),
                        format: PixelFormat::default(),
                        records: false,
                        views: Vec::new(),
                    };
                    context.net.send(self.node, wire, Packet::of(&Hello { name: String::new(), role }));
                    self.sessions[usize::from(rank)] = Some(wire);
                    // Who leads without a term may have begun anew, with frames of its own numbering.
                    self.may_be_anew |= rank == 0;
                }
            }
            Purpose::Tiles(rank, key) => {
                if let Some((old, _)) = self.senders.insert((rank, key), (wire, VecDeque::new())) {
                    context.net.close(self.node, old);
                }
            }
            _ => {}
        }
        self.turn(context);
    }

    /// A link to a backplane couldn't be made.
    pub(crate) fn on_failed(&mut self, context: &mut Context, rank: usize) {
        self.again[rank] = Some(context.local(self.node) + AGAIN);
        self.turn(context);
    }

    /// A link is down.
    pub(crate) fn on_down(&mut self, context: &mut Context, wire: Wire) {
        context.log(self.node, || format!("down {wire:?}"));
        for rank in 0..2 {
            if self.sessions[rank] == Some(wire) {
                self.sessions[rank] = None;
                self.again[rank] = Some(context.local(self.node) + AGAIN);
            }
        }
        let gone = self.senders.iter().find(|(_, (of, _))| *of == wire).map(|(sender, _)| *sender);
        if let Some((rank, key)) = gone {
            self.senders.remove(&(rank, key));
            // Their tiles will never be here.
            self.swaps.retain(|(of, swap)| *of != rank || !swap.boards.contains(&key));
        }
        self.turn(context);
    }

    /// Something came over a link.
    pub(crate) fn on_packet(&mut self, context: &mut Context, wire: Wire, packet: Packet) {
        match context.net.peer(self.node, wire) {
            Node::Manager(rank) => {
                if let Ok((ToCompositor::Swap(swap), _)) = decode(packet.bytes) {
                    self.on_swap(rank, swap);
                }
            }
            Node::Board(_) => {
                let sender = self.senders.values_mut().find(|(of, _)| *of == wire);
                if let (Some((_, done)), Some(tiles)) = (sender, packet.tiles)
                    && let Ok((TileMessage::Done { frame, epoch }, _)) = decode(packet.bytes)
                {
                    if done.len() == DONE_MAX {
                        done.pop_front();
                    }
                    done.push_back((epoch, frame, tiles));
                }
            }
            Node::Display(_) => {}
        }
        self.turn(context);
    }

    fn on_swap(&mut self, rank: u8, swap: Swap) {
        if rank == 0 && std::mem::take(&mut self.may_be_anew) && swap.epoch.term().max(self.term) == Term(0) {
            self.shown = None;
            self.swaps.clear();
        }
        // A higher term's word counts; a lower one's no longer does.
        if swap.epoch.term() < self.term || self.swaps.back().is_some_and(|(_, last)| last.frame >= swap.frame) {
            return;
        }
        self.term = swap.epoch.term();
        if self.shown.is_none_or(|shown| shown < swap.frame) {
            if self.swaps.len() == SWAPS_MAX {
                self.swaps.pop_front();
            }
            self.swaps.push_back((rank, swap));
        }
    }

    /// Its timer is due.
    pub(crate) fn on_wake(&mut self, context: &mut Context) {
        self.turn(context);
    }

    fn turn(&mut self, context: &mut Context) {
        let now = context.local(self.node);
        for rank in 0..usize::from(context.plan.managers) {
            if self.again[rank].is_some_and(|at| now >= at) {
                self.again[rank] = None;
                context.net.connect(self.node, Node::Manager(rank as u8), Purpose::Show);
            }
        }
        let again = self.again.iter().take(context.plan.managers.into()).flatten().copied().min();
        context.wake(self.node, again);
        // The newest swap whose tiles are all here; those before it are passed over.
        if let Some(at) = self.swaps.iter().rposition(|(rank, swap)| self.is_here(*rank, swap)) {
            let (rank, swap) = self.swaps.drain(..=at).next_back().expect("it is at that place");
            self.show(context, rank, &swap);
        }
    }

    fn is_here(&self, rank: u8, swap: &Swap) -> bool {
        swap.boards.iter().all(|key| self.tiles(rank, *key, swap).is_some())
    }

    fn tiles(&self, rank: u8, key: BoardKey, swap: &Swap) -> Option<&Masks> {
        let (_, done) = self.senders.get(&(rank, key))?;
        let is_it = |(epoch, frame, _): &&(Epoch, FrameNumber, Masks)| (*epoch, *frame) == (swap.epoch, swap.frame);
        done.iter().find(is_it).map(|(.., tiles)| tiles)
    }

    fn show(&mut self, context: &mut Context, rank: u8, swap: &Swap) {
        let tiles: Vec<_> = swap.boards.iter().filter_map(|key| self.tiles(rank, *key, swap).cloned()).collect();
        let views = (0..context.plan.views).filter(|view| view % u32::from(context.plan.displays) == self.index.into());
        let views: Vec<_> = views.collect();
        let now = context.net.now();
        context.checks.on_shown(now, self.index, swap, &views, &tiles);
        context.log(self.node, || format!("shows {:?} of {:?}, complete {:?}", swap.frame, swap.epoch, swap.complete));
        self.shown = Some(swap.frame);
        for (_, done) in self.senders.values_mut() {
            while done.front().is_some_and(|(_, frame, _)| *frame < swap.frame) {
                done.pop_front();
            }
        }
    }
}
