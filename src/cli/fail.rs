//! How a command ends when it does not end well.

use std::io;
use std::process::ExitCode;

use crate::diagnostics::Diagnostics;
use crate::engine::CacheError;

/// Why a command did not do what it was asked.
pub enum Fail {
    /// The call is wrong.
    Usage { message: String, help: Option<String> },
    /// The graph is wrong.
    Graph(Diagnostics),
    /// The call or the graph is wrong, and that was reported already.
    WrongReported,
    /// A node failed, and that was reported already.
    NodeReported,
    /// The cache cannot be used.
    Cache(CacheError),
    /// A file cannot be written.
    Write { path: String, error: io::Error },
    /// Something that was asked for is not there to give.
    Lacking(String),
    /// Standard output was closed by its reader: nobody is left to tell.
    Pipe,
    /// Standard output cannot be written.
    Output(io::Error),
    /// Ctrl-C.
    Interrupted,
}

impl From<CacheError> for Fail {
    fn from(error: CacheError) -> Self {
        Self::Cache(error)
    }
}

impl From<io::Error> for Fail {
    fn from(error: io::Error) -> Self {
        if error.kind() == io::ErrorKind::BrokenPipe { Self::Pipe } else { Self::Output(error) }
    }
}

impl Fail {
    /// A wrong call.
    pub fn usage(message: impl Into<String>) -> Self {
        Self::Usage { message: message.into(), help: None }
    }

    /// Says on standard error what is wrong, and gives the exit code.
    pub fn report(self) -> ExitCode {
        let code = match &self {
            Self::Usage { .. } | Self::Graph(_) | Self::WrongReported => 2,
            Self::NodeReported | Self::Cache(_) | Self::Write { .. } | Self::Lacking(_) | Self::Output(_) => 1,
            Self::Pipe => 0,
            Self::Interrupted => 130,
        };
        match self {
            Self::Usage { message, help } => say(&message, help.as_deref()),
            Self::Graph(diagnostics) => super::plan::show(&diagnostics),
            Self::Cache(error) => say(&error.message, Some(&error.help)),
            Self::Write { path, error } => say(&format!("cannot write {path}: {error}"), None),
            Self::Lacking(message) => say(&message, None),
            Self::Output(error) => say(&format!("cannot write to standard output: {error}"), None),
            Self::Interrupted => say("interrupted; what was finished is kept in the cache", None),
            Self::WrongReported | Self::NodeReported | Self::Pipe => {}
        }
        ExitCode::from(code)
    }
}

/// An error on standard error, in the form of all others.
pub fn say(message: &str, help: Option<&str>) {
    super::text::complain(&format!("error: {message}"));
    if let Some(help) = help {
        super::text::complain(&format!("  help: {help}"));
    }
}
