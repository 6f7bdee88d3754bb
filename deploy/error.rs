//! What the command can fail of. Each says what, where, and what to do; `main` prints it in one line.

use thiserror::Error;

/// A command failed.
#[derive(Debug, Error)]
pub(crate) enum CommandError {
    #[error(transparent)]
    Camera(#[from] manager::host::camera::CameraError),
    #[error(transparent)]
    Baked(#[from] manager::scene::baked::BakedError),
    #[error(transparent)]
    Content(#[from] manager::scene::ContentError),
    #[cfg(feature = "import")]
    #[error(transparent)]
    Import(#[from] manager::scene::import::ImportError),
    #[error(transparent)]
    Keys(#[from] link::KeysError),
    #[error(transparent)]
    Manager(#[from] manager::backplane::ManagerError),
    #[error(transparent)]
    Worker(#[from] channel::worker::WorkerError),
    #[error(transparent)]
    Compositor(#[from] compositor::shell::CompositorError),
    #[error(transparent)]
    Sink(#[from] compositor::sinks::SinkError),
    /// Something about a file; the text has its name.
    #[error("{0}")]
    Said(String),
}

impl CommandError {
    /// An error that is only its sentence.
    pub(crate) fn said(what: impl Into<String>) -> Self {
        Self::Said(what.into())
    }

    /// A file and what went wrong with it.
    pub(crate) fn file(path: &std::path::Path, error: impl std::fmt::Display) -> Self {
        Self::Said(format!("{}: {error}", path.display()))
    }
}
