//! The peer in a process of its own: one line of JSON for each question and each answer.
//!
//! The child says [`Reply::Ready`] or [`Reply::Unavailable`] when it has taken the scene in, then answers each
//! [`Request`] in turn, and ends when its stdin does; so it never outlives who asked. A picture's floats follow their
//! line as bytes, little-endian. The child's times are its own: what a line takes to cross a pipe is in none of them.

use crate::peer::{Drawn, Look, Peer};
use serde::{Deserialize, Serialize};
use std::io::{self, BufRead, BufReader, Write};
use std::num::NonZeroUsize;
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use thiserror::Error;

/// What the driver is told by its environment: to be llvmpipe, without a window system.
const ENVIRONMENT: [(&str, &str); 3] =
    [("LIBGL_ALWAYS_SOFTWARE", "1"), ("GALLIUM_DRIVER", "llvmpipe"), ("EGL_PLATFORM", "surfaceless")];
/// How many threads rasterize, besides the one that transforms vertices.
const THREADS: &str = "LP_NUM_THREADS";

/// A question.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Request {
    /// Draw a frame and say how long it took.
    Draw(Look),
    /// Send the best picture of this.
    Picture(Look),
}

/// An answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// The scene is taken in.
    Ready {
        /// The driver's name.
        renderer: String,
        /// Most samples of a pixel.
        samples_max: u32,
    },
    /// There is no peer on this machine or for this scene.
    Unavailable {
        /// Why.
        why: String,
    },
    /// To [`Request::Draw`].
    Drawn(Drawn),
    /// To [`Request::Picture`]: so many floats follow.
    Picture {
        /// `width × height × 3`.
        floats: usize,
    },
    /// The question could not be answered; the next may be.
    Failed {
        /// Why.
        why: String,
    },
}

/// Why a child gave no answer.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ChildError {
    /// No peer on this machine or for this scene; nobody's fault.
    #[error("{0}")]
    Unavailable(String),
    /// The child couldn't do what it was asked.
    #[error("the peer failed: {0}")]
    Failed(String),
    /// The process or its pipes.
    #[error("the peer's process: {0}")]
    Io(#[from] io::Error),
    /// The child isn't what we took it for.
    #[error("the peer said {line:?}, which is no answer to that")]
    Garbled {
        /// What it said.
        line: String,
    },
}

/// Answers questions until there are none.
///
/// # Errors
/// When a pipe breaks, or a question isn't one.
pub fn serve(mut peer: Peer, input: impl BufRead, mut output: impl Write) -> io::Result<()> {
    say(&mut output, &Reply::Ready { renderer: peer.renderer().to_owned(), samples_max: peer.samples_max() })?;
    for line in input.lines() {
        let failed = |error: crate::peer::PeerError| Reply::Failed { why: error.to_string() };
        let mut bytes = Vec::new();
        let reply = match serde_json::from_str(&line?)? {
            Request::Draw(look) => peer.draw(&look).map_or_else(failed, Reply::Drawn),
            Request::Picture(look) => match peer.picture(&look) {
                Ok(picture) => {
                    bytes.extend(picture.iter().flat_map(|value| value.to_le_bytes()));
                    Reply::Picture { floats: picture.len() }
                }
                Err(error) => failed(error),
            },
        };
        say(&mut output, &reply)?;
        output.write_all(&bytes)?;
        output.flush()?;
    }
    Ok(())
}

/// Writes one line.
///
/// # Errors
/// When the pipe is broken.
pub fn say(output: &mut impl Write, message: &impl Serialize) -> io::Result<()> {
    serde_json::to_writer(&mut *output, message)?;
    output.write_all(b"\n")?;
    output.flush()
}

/// A peer that is ready, in its own process.
#[derive(Debug)]
pub struct Child {
    process: std::process::Child,
    line: Line<BufReader<ChildStdout>, ChildStdin>,
    /// The driver's name.
    pub renderer: String,
    /// Most samples of a pixel.
    pub samples_max: u32,
}

impl Child {
    /// Starts `command`, which must call [`serve`], with the driver's settings for `threads`, and waits until it is ready.
    ///
    /// # Errors
    /// [`ChildError::Unavailable`] when there is no llvmpipe or it can't draw the scene.
    pub fn start(mut command: Command, threads: NonZeroUsize) -> Result<Self, ChildError> {
        command.envs(ENVIRONMENT).env(THREADS, threads.to_string());
        let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let missing = || io::Error::other("no pipe");
        let output = process.stdin.take().ok_or_else(missing)?;
        let input = BufReader::new(process.stdout.take().ok_or_else(missing)?);
        let mut line = Line { input, output };
        match line.hear()? {
            Reply::Ready { renderer, samples_max } => Ok(Self { process, line, renderer, samples_max }),
            Reply::Unavailable { why } => {
                process.wait()?;
                Err(ChildError::Unavailable(why))
            }
            other => Err(garbled(&other)),
        }
    }

    /// Draws a frame.
    ///
    /// # Errors
    /// [`ChildError`]
    pub fn draw(&mut self, look: &Look) -> Result<Drawn, ChildError> {
        self.line.draw(look)
    }

    /// The peer's picture: linear values, row-major, `width × height × 3`.
    ///
    /// # Errors
    /// [`ChildError`]
    pub fn picture(&mut self, look: &Look) -> Result<Vec<f32>, ChildError> {
        self.line.picture(look)
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        // It ends with its stdin, which is still open here; and whoever is in doubt about it is not worth waiting for.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Both ends of the talk, apart from the process.
#[derive(Debug)]
struct Line<R, W> {
    input: R,
    output: W,
}

impl<R: BufRead, W: Write> Line<R, W> {
    fn hear(&mut self) -> Result<Reply, ChildError> {
        let mut line = String::new();
        if self.input.read_line(&mut line)? == 0 {
            return Err(io::Error::from(io::ErrorKind::UnexpectedEof).into());
        }
        serde_json::from_str(&line).map_err(|_| ChildError::Garbled { line: line.trim_end().to_owned() })
    }

    fn draw(&mut self, look: &Look) -> Result<Drawn, ChildError> {
        say(&mut self.output, &Request::Draw(*look))?;
        match self.hear()? {
            Reply::Drawn(drawn) => Ok(drawn),
            Reply::Failed { why } => Err(ChildError::Failed(why)),
            other => Err(garbled(&other)),
        }
    }

    fn picture(&mut self, look: &Look) -> Result<Vec<f32>, ChildError> {
        let expected = look.size[0] as usize * look.size[1] as usize * 3;
        say(&mut self.output, &Request::Picture(*look))?;
        match self.hear()? {
            Reply::Picture { floats } if floats == expected => {
                let mut bytes = vec![0; floats * size_of::<f32>()];
                self.input.read_exact(&mut bytes)?;
                let (floats, _) = bytes.as_chunks::<4>();
                Ok(floats.iter().map(|value| f32::from_le_bytes(*value)).collect())
            }
            Reply::Failed { why } => Err(ChildError::Failed(why)),
            other => Err(garbled(&other)),
        }
    }
}

fn garbled(reply: &Reply) -> ChildError {
    ChildError::Garbled { line: format!("{reply:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proto::view::{Pose, Tangents};

    const LOOK: Look = Look {
        size: [1, 1],
        samples: 4,
        pose: Pose::IDENTITY,
        tangents: Tangents { left: -1.0, right: 1.0, bottom: -0.5, top: 0.5 },
        near: 0.1,
        sun: DVec3::Y,
        background: [0.53, 0.7, 0.92],
    };

    fn line(said: &[u8]) -> Line<&[u8], Vec<u8>> {
        Line { input: said, output: Vec::new() }
    }

    #[test]
    fn a_question_is_one_line_and_comes_through_whole() {
        let mut line = line(b"{\"drawn\":{\"ms\":1.5,\"triangles\":7}}\n");
        assert_eq!(line.draw(&LOOK).unwrap(), Drawn { ms: 1.5, triangles: 7 });
        let said = String::from_utf8(line.output).unwrap();
        assert_eq!(said.matches('\n').count(), 1);
        assert_eq!(serde_json::from_str::<Request>(&said).unwrap(), Request::Draw(LOOK));
    }

    #[test]
    fn a_pictures_floats_follow_its_line() {
        let mut said = b"{\"picture\":{\"floats\":3}}\n".to_vec();
        said.extend([0.25f32, -1.0, 3.5].iter().flat_map(|value| value.to_le_bytes()));
        said.extend(b"{\"failed\":{\"why\":\"tired\"}}\n");
        let mut line = line(&said);
        assert_eq!(line.picture(&LOOK).unwrap(), [0.25, -1.0, 3.5]);
        let error = line.picture(&LOOK).unwrap_err();
        assert!(error.to_string().contains("tired"), "{error}");
    }

    #[test]
    fn a_picture_of_another_size_is_not_read() {
        let error = line(b"{\"picture\":{\"floats\":999999999999}}\n").picture(&LOOK).unwrap_err();
        assert!(matches!(error, ChildError::Garbled { .. }), "{error}");
    }

    #[test]
    fn rubbish_and_silence_are_told_apart() {
        let rubbish = line(b"Segmentation fault\n").draw(&LOOK).unwrap_err();
        assert!(rubbish.to_string().contains("Segmentation fault"), "{rubbish}");
        assert!(matches!(line(b"").draw(&LOOK).unwrap_err(), ChildError::Io(_)));
        let other = line(b"{\"ready\":{\"renderer\":\"x\",\"samples_max\":4}}\n").draw(&LOOK).unwrap_err();
        assert!(matches!(other, ChildError::Garbled { .. }), "{other}");
    }

    #[test]
    fn a_command_that_is_no_peer_is_an_error_and_not_a_wait() {
        let error = Child::start(Command::new("true"), NonZeroUsize::MIN).unwrap_err();
        assert!(matches!(error, ChildError::Io(_)), "{error}");
    }
}
