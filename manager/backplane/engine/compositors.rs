//! The compositors: one that shows all views as one picture, and displays, which show some. All are told of every swap, and a frame is shown
//! when all have shown it.

use super::{Engine, Outbox};
use bytes::Bytes;
use proto::codec::encode;
use proto::frame::PixelFormat;
use proto::ids::{BoardKey, FrameNumber, ViewId};
use proto::limits;
use proto::message::{FromCompositor, Swap, TileSink, ToBoard, ToCompositor};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

/// A compositor.
#[derive(Debug)]
pub(super) struct Compositor {
    /// As boards know it.
    sink: TileSink,
    /// Whether it wants to know what each frame depends on.
    records: bool,
    /// The name in its certificate, where there are keys.
    certified: Option<String>,
    outbox: Outbox,
    /// Revision of the layout that it knows.
    layout: u64,
    /// The frame that it was told last to show, and the one that it has shown last.
    told: Option<FrameNumber>,
    presented: Option<FrameNumber>,
}

impl Compositor {
    /// Whether it shows the whole picture.
    fn is_whole(&self) -> bool {
        self.sink.views.is_empty()
    }
}

/// All of them.
#[derive(Debug, Default)]
pub(super) struct Compositors(BTreeMap<BoardKey, Compositor>);

impl Compositors {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn keys(&self) -> Vec<BoardKey> {
        self.0.keys().copied().collect()
    }

    /// Whether each of so many views is shown by somebody.
    pub(super) fn show_all(&self, views: usize) -> bool {
        (0..views as u32).all(|view| self.0.values().any(|compositor| compositor.sink.wants(ViewId(view))))
    }

    /// What boards must draw, so that each compositor gets what it wants: pictures that have linear pixels have the others too.
    pub(super) fn format(&self) -> PixelFormat {
        let is_linear = self.0.values().any(|compositor| compositor.sink.format == PixelFormat::LinearF32);
        if is_linear { PixelFormat::LinearF32 } else { PixelFormat::Srgb8 }
    }

    /// As boards know them.
    pub(super) fn sinks(&self) -> Vec<TileSink> {
        self.0.values().map(|compositor| compositor.sink.clone()).collect()
    }

    /// Says something to all.
    pub(super) fn tell(&self, message: &ToCompositor) {
        let bytes = encode(message, &[]);
        for compositor in self.0.values() {
            compositor.outbox.send(bytes.clone());
        }
    }

    /// Says goodbye to all.
    pub(super) fn dismiss(&self) {
        self.tell(&ToCompositor::Goodbye);
        self.0.values().for_each(|compositor| compositor.outbox.close());
    }

    /// Says something to those who want to know what frames depend on.
    pub(super) fn tell_record(&self, message: impl FnOnce() -> ToCompositor) {
        let mut wanting = self.0.values().filter(|compositor| compositor.records).peekable();
        if wanting.peek().is_some() {
            let bytes = encode(&message(), &[]);
            for compositor in wanting {
                compositor.outbox.send(bytes.clone());
            }
        }
    }

    /// The last frame that all have shown of those that were told to show any.
    fn shown(&self) -> Option<FrameNumber> {
        let told = self.0.values().filter(|compositor| compositor.told.is_some());
        told.map(|compositor| compositor.presented).min().flatten()
    }
}

/// Whether boards that draw one kind of pixels have the other one too.
fn has(drawn: PixelFormat, wanted: PixelFormat) -> bool {
    drawn == wanted || drawn == PixelFormat::LinearF32
}

impl Engine {
    /// Takes a compositor, or says why not.
    pub(super) fn on_compositor_hello(
        &mut self,
        sink: TileSink,
        records: bool,
        certified: Option<String>,
        from: SocketAddr,
        outbox: Outbox,
    ) {
        let (key, views) = (sink.key, &sink.views[..]);
        // One that comes again before its old link is known to be dead.
        let old = self.compositors.0.iter().find(|(_, other)| other.sink.address == sink.address);
        let again = old.filter(|(_, other)| other.certified == certified).map(|(key, _)| *key);
        let is_taken = old.is_some() && again.is_none();
        if let Some(key) = again {
            self.on_compositor_lost(key, "it has come again");
        }
        let count = self.director.views().len();
        let whole = self.compositors.0.values().find(|other| other.is_whole()).filter(|_| views.is_empty());
        let refused = if let Some(other) = whole {
            Some(format!("this rig has a compositor already, at {}", other.sink.address))
        } else if is_taken {
            Some(format!("another compositor listens at {}", sink.address))
        } else if let Some(view) = views.iter().find(|view| view.0 as usize >= count) {
            Some(format!("this rig has {count} views, numbered from 0; there is no view {}", view.0))
        } else {
            let is_full = self.compositors.0.len() >= limits::COMPOSITORS_MAX;
            is_full
                .then(|| format!("this rig has {} compositors already, the most there can be", limits::COMPOSITORS_MAX))
        };
        if let Some(reason) = refused {
            self.log("refused", format!("a compositor from {from}: {reason}"));
            outbox.send(encode(&ToCompositor::Refused { reason }, &[]));
            outbox.close();
            return;
        }
        outbox.send(encode(&ToCompositor::Welcome, &[]));
        let what = match views {
            [] => "compositor".to_owned(),
            [view] => format!("display of view {}", view.0),
            views => format!(
                "display of views {}",
                views.iter().map(|view| view.0.to_string()).collect::<Vec<_>>().join(", ")
            ),
        };
        let compositor = Compositor { sink, records, certified, outbox, layout: 0, told: None, presented: None };
        self.compositors.0.insert(key, compositor);
        self.tell_compositors_boards();
        self.update_compositor_views();
        // Boards keep the last frame's tiles, of the pixels that were wanted then.
        if let (Some(swap), Some(compositor)) = (&self.last_swap, self.compositors.0.get_mut(&key))
            && has(self.format, compositor.sink.format)
        {
            compositor.told = Some(swap.frame);
            compositor.outbox.send(encode(
                &ToCompositor::Swap(Swap { preview: swap.preview && compositor.is_whole(), ..swap.clone() }),
                &[],
            ));
        }
        self.tell_boards(&ToBoard::Compositors(self.compositors.sinks()));
        self.log("connected", format!("{what} ({from})"));
    }

    /// A compositor is gone. False: it was none.
    pub(super) fn on_compositor_lost(&mut self, key: BoardKey, reason: &str) -> bool {
        if self.compositors.0.remove(&key).is_none() {
            return false;
        }
        self.statistics.genlock.on_lost(key);
        match self.clock.presenting_frame() {
            // It is drawn again when there is a compositor to show it.
            Some(frame) if self.config.wait_for_compositor => self.clock.on_missing(frame),
            _ if self.compositors.is_empty() => self.clock.on_compositor_lost(),
            // Nobody who is left has been told of it.
            Some(frame) if self.compositors.0.values().all(|compositor| compositor.told.is_none()) => {
                self.clock.on_missing(frame);
            }
            _ => self.on_shown(),
        }
        self.answer();
        self.tell_boards(&ToBoard::Compositors(self.compositors.sinks()));
        self.log("lost", format!("compositor: {reason}"));
        true
    }

    pub(super) fn update_compositor_views(&mut self) {
        let revision = self.director.layout_revision;
        let mut outdated =
            self.compositors.0.values_mut().filter(|compositor| compositor.layout != revision).peekable();
        if outdated.peek().is_some() {
            let bytes = encode(&ToCompositor::Views(self.director.layout().to_vec()), &[]);
            for compositor in outdated {
                compositor.layout = revision;
                compositor.outbox.send(bytes.clone());
            }
        }
    }

    /// Tells all to show a frame.
    pub(super) fn tell_swap(&mut self, swap: &Swap) {
        let (drawn, wanting) = (self.format, &mut self.compositors.0);
        let unseen = encode(&ToCompositor::Swap(Swap { preview: false, ..swap.clone() }), &[]);
        let mut told = Vec::with_capacity(wanting.len());
        for (key, compositor) in wanting.iter_mut().filter(|(_, compositor)| has(drawn, compositor.sink.format)) {
            compositor.told = Some(swap.frame);
            told.push(*key);
            let is_seen = swap.preview && compositor.is_whole();
            let bytes = if is_seen { encode(&ToCompositor::Swap(swap.clone()), &[]) } else { unseen.clone() };
            compositor.outbox.send(bytes);
        }
        let all_told = told.len() == wanting.len();
        self.statistics.genlock.on_swap(swap.frame, told, swap.complete.iter().all(|complete| *complete));
        if self.compositors.is_empty() && !self.config.wait_for_compositor {
            self.clock.on_presented(swap.frame);
        } else if self.compositors.is_empty() || !all_told {
            // One came while the frame was drawn as another kind of pixels; in lock-step the frame is drawn again.
            self.clock.on_missing(swap.frame);
        }
    }

    pub(super) fn on_compositor(&mut self, key: BoardKey, message: FromCompositor, payload: Bytes) {
        let Some(compositor) = self.compositors.0.get_mut(&key) else { return };
        match message {
            FromCompositor::Presented { frame, stitch_ns, at_ns } => {
                compositor.presented = Some(frame);
                let (now, stitch) = (self.now(), Duration::from_nanos(stitch_ns));
                self.statistics.stitch.add(stitch);
                self.statistics.genlock.on_presented(key, frame, at_ns);
                self.traces.on_presented(now, frame, stitch);
                self.control.shown = Some(now);
                self.on_shown();
                self.answer();
            }
            FromCompositor::Preview { frame } => self.picture = Some((frame, payload)),
            FromCompositor::Missing { frame } => {
                self.clock.on_missing(frame);
                self.log("incomplete", format!("{frame:?} lost tiles on its way to the compositor"));
            }
        }
    }

    /// Some compositor has shown a frame, or is gone.
    fn on_shown(&mut self) {
        if let Some(frame) = self.compositors.shown() {
            self.clock.on_presented(frame);
        }
    }
}
