//! A relay between two processes that can be cut: what a pulled cable does to them.

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::Duration;

const WHOLE: u8 = 0;
/// Nothing passes, and nobody is told.
const SILENT: u8 = 1;
/// Links close, and no new one is made.
const BROKEN: u8 = 2;

/// Passes on what comes to `address`, until dropped.
#[derive(Debug)]
pub struct Relay {
    /// Where it listens, on loopback.
    pub address: SocketAddr,
    state: Arc<AtomicU8>,
}

impl Relay {
    /// To another address.
    ///
    /// # Errors
    /// If there is no port to listen at.
    pub fn to(to: SocketAddr) -> std::io::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0")?;
        let address = listener.local_addr()?;
        let state = Arc::new(AtomicU8::new(WHOLE));
        let shared = state.clone();
        std::thread::spawn(move || {
            for from in listener.incoming().map_while(Result::ok) {
                if shared.load(Ordering::SeqCst) == BROKEN {
                    continue;
                }
                let Ok(to) = TcpStream::connect(to) else { continue };
                for (from, to) in [(from.try_clone(), to.try_clone()), (Ok(to), Ok(from))] {
                    let (Ok(from), Ok(to), state) = (from, to, shared.clone()) else { continue };
                    std::thread::spawn(move || pass(from, to, &state));
                }
            }
        });
        Ok(Self { address, state })
    }

    /// From now on nothing passes; links stay open.
    pub fn silence(&self) {
        self.state.store(SILENT, Ordering::SeqCst);
    }

    /// From now on links close.
    pub fn break_links(&self) {
        self.state.store(BROKEN, Ordering::SeqCst);
    }

    /// All passes again, what was held up too.
    pub fn mend(&self) {
        self.state.store(WHOLE, Ordering::SeqCst);
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.break_links();
    }
}

/// Passes bytes on in one direction.
fn pass(mut from: TcpStream, mut to: TcpStream, state: &AtomicU8) {
    // Now and then it looks whether it has been cut.
    let _ = from.set_read_timeout(Some(Duration::from_millis(5)));
    let mut buffer = [0; 8192];
    loop {
        match state.load(Ordering::SeqCst) {
            BROKEN => break,
            SILENT => {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            _ => {}
        }
        match from.read(&mut buffer) {
            Ok(0) => break,
            Ok(len) => {
                // What has been read must not get through if it was cut meanwhile.
                while state.load(Ordering::SeqCst) == SILENT {
                    std::thread::sleep(Duration::from_millis(5));
                }
                if to.write_all(&buffer[..len]).is_err() {
                    break;
                }
            }
            Err(error) if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) => {}
            Err(_) => break,
        }
    }
    let _ = from.shutdown(Shutdown::Both);
    let _ = to.shutdown(Shutdown::Both);
}
