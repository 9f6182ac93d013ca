//! Why a node failed, in words for the person who wired it.

use std::fmt;

/// The failure of a node: what is wrong, where, and what to do about it.
///
/// An error is *lasting* (the same inputs and params will fail again) or *passing* (I/O, a file
/// that changed under the run, cancellation).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeError {
    /// What is wrong and where (file, vertex, face, byte), one sentence.
    pub message: String,
    /// What to do about it, if there is something to say.
    pub help: Option<String>,
    /// Whether the run was stopped rather than wrong.
    pub cancelled: bool,
    /// Whether trying again with the same inputs and params may succeed.
    pub passing: bool,
}

impl NodeError {
    /// A lasting failure: equal inputs and params fail again.
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), help: None, cancelled: false, passing: false }
    }

    /// A failure that may pass: I/O, or a file that changed while it was read.
    pub fn passing(message: impl Into<String>) -> Self {
        Self { passing: true, ..Self::new(message) }
    }

    /// The run was stopped while the node ran.
    #[must_use]
    pub fn cancelled() -> Self {
        Self { cancelled: true, ..Self::passing("cancelled") }
    }

    /// The same error with advice on what to do.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

impl fmt::Display for NodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for NodeError {}
