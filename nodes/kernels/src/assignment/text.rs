//! What the readers of text formats share.

use std::fmt;

/// What is wrong with a file, and in which line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ReadError {
    /// Line, counted from 1.
    pub line: usize,
    /// What is wrong there.
    pub message: String,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.message)
    }
}

impl std::error::Error for ReadError {}

impl ReadError {
    pub(super) fn new(line: usize, message: impl Into<String>) -> Self {
        Self { line, message: message.into() }
    }

    pub(super) fn integer(line: usize, word: &str) -> Result<usize, Self> {
        word.parse().map_err(|_| Self::new(line, format!("`{word}` is no index or count")))
    }

    pub(super) fn finite(line: usize, word: &str) -> Result<f64, Self> {
        let value: Option<f64> = word.parse().ok();
        value.filter(|v| v.is_finite()).ok_or_else(|| Self::new(line, format!("`{word}` is no finite number")))
    }
}
