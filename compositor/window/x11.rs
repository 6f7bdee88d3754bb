//! The window itself, by X11.

use super::{Order, Place};
use crate::together::{at, wall_clock_ns};
use minifb::{ScaleMode, WindowOptions};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::Duration;

/// How often a window without new pictures looks whether it was closed.
const LOOK_PERIOD: Duration = Duration::from_millis(50);

/// Shows what is ordered, until nobody orders any more or somebody closes the window.
pub(super) fn run(title: &str, place: Place, inbox: &Receiver<Order>) {
    let mut window: Option<(minifb::Window, (u32, u32))> = None;
    let mut pixels = Vec::new();
    loop {
        match inbox.recv_timeout(LOOK_PERIOD) {
            Ok(Order { picture, moment, answer }) => {
                let size = (picture.width, picture.height);
                if window.as_ref().is_none_or(|(_, of)| *of != size) {
                    // The old one first: they would lie one above the other.
                    drop(window.take());
                    match open(title, place, size) {
                        Ok(opened) => window = Some((opened, size)),
                        Err(error) => {
                            // Who asked may have gone.
                            let _ = answer.send(Err(error.to_string()));
                            return;
                        }
                    }
                }
                let Some((window, _)) = &mut window else { continue };
                pixels.clear();
                pixels
                    .extend(picture.pixels.chunks_exact(3).map(|rgb| u32::from_be_bytes([0, rgb[0], rgb[1], rgb[2]])));
                let shown = at(moment, || window.update_with_buffer(&pixels, size.0 as usize, size.1 as usize));
                let _ = answer.send(shown.map(|()| wall_clock_ns()).map_err(|error| error.to_string()));
            }
            Err(RecvTimeoutError::Timeout) => {
                if let Some((window, _)) = &mut window {
                    window.update();
                }
            }
            Err(RecvTimeoutError::Disconnected) => return,
        }
        if window.as_ref().is_some_and(|(window, _)| !window.is_open()) {
            return;
        }
    }
}

fn open(title: &str, place: Place, (width, height): (u32, u32)) -> minifb::Result<minifb::Window> {
    let is_placed = place.at.is_some();
    let options = WindowOptions {
        borderless: is_placed,
        title: !is_placed,
        resize: !is_placed,
        topmost: is_placed,
        scale_mode: ScaleMode::AspectRatioStretch,
        ..WindowOptions::default()
    };
    let mut window = minifb::Window::new(title, width as usize, height as usize, options)?;
    // Frames come at the rig's pace.
    window.set_target_fps(0);
    if let Some([x, y]) = place.at {
        window.set_position(x as isize, y as isize);
        window.set_cursor_visibility(false);
    }
    Ok(window)
}
