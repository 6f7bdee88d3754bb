//! A window that shows what the compositor does: the display of a projector.
//!
//! It has a thread of its own, because a window belongs to the thread that made it. A picture counts as shown when it has been given to the
//! display server, so the compositor waits for that: it takes as long as copying the picture.

#[cfg(feature = "window")]
mod x11;

use crate::sinks::Picture;
use proto::message::Moment;
use std::io;
use std::sync::Arc;
use std::sync::mpsc::{SyncSender, sync_channel};
use tokio::sync::oneshot;
use tokio_util::sync::CancellationToken;

/// Where a window is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Place {
    /// Of its upper left corner on the desktop, pixels; then it has no borders, and is as large as the picture. `None`: where the desktop puts it,
    /// and it can be resized.
    pub at: Option<[i32; 2]>,
}

/// A picture to show.
#[cfg_attr(not(feature = "window"), expect(dead_code, reason = "no window shows it"))]
#[derive(Debug)]
struct Order {
    picture: Arc<Picture>,
    moment: Option<Moment>,
    /// Who waits for it: he is told since when it is shown, ns since 1970, or why it can't be.
    answer: oneshot::Sender<Result<u64, String>>,
}

/// The compositor's end of the thread; the window goes with it.
#[derive(Debug)]
pub(crate) struct Window(SyncSender<Order>);

impl Window {
    /// Starts the thread. The window opens with the first picture; when somebody closes it, `closed` is cancelled.
    ///
    /// # Errors
    /// When there is no display server that could be asked, or the thread can't be started.
    pub(crate) fn start(title: String, place: Place, closed: CancellationToken) -> io::Result<Self> {
        if cfg!(not(feature = "window")) {
            return Err(io::Error::new(io::ErrorKind::Unsupported, "this program was built without windows"));
        }
        if std::env::var_os("DISPLAY").is_none_or(|name| name.is_empty()) {
            return Err(io::Error::new(io::ErrorKind::NotFound, "the variable DISPLAY names no X server"));
        }
        let (orders, inbox) = sync_channel(1);
        std::thread::Builder::new().name("window".into()).spawn(move || {
            #[cfg(feature = "window")]
            x11::run(&title, place, &inbox);
            #[cfg(not(feature = "window"))]
            drop((title, place, inbox));
            closed.cancel();
        })?;
        Ok(Self(orders))
    }

    /// Shows a picture of 8-bit pixels at a moment; returns since when, ns since 1970.
    ///
    /// # Errors
    /// Why it can't be shown, for people; `None`: the window is closed.
    pub(crate) async fn show(&self, picture: Arc<Picture>, moment: Option<Moment>) -> Result<u64, Option<String>> {
        let (answer, shown) = oneshot::channel();
        // There is room: the one before has been answered.
        self.0.try_send(Order { picture, moment, answer }).map_err(|_| None)?;
        shown.await.map_err(|_| None)?.map_err(Some)
    }
}
