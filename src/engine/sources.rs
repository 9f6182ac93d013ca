//! The input files of one run, as one consistent snapshot.
//!
//! The first look at a file pins its content: if a later look in the same run finds something else,
//! the read fails and says so, and nothing false is ever recorded.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use salient_sdk::NodeError;

use super::key::Digest;

/// What each file held when the run first looked: `None` if there was no file.
#[derive(Default)]
pub struct Sources {
    pinned: Mutex<BTreeMap<PathBuf, Option<Digest>>>,
}

impl Sources {
    /// Nothing looked at yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The hash of a file's content, `None` if there is no file.
    pub fn digest(&self, path: &Path) -> Result<Option<Digest>, NodeError> {
        if let Some(pinned) = self.pinned().get(path) {
            return Ok(*pinned);
        }
        let digest = match hash(path) {
            Ok(digest) => Some(digest),
            Err(e) if is_absence(&e) => None,
            Err(e) => return Err(unreadable(path, &e)),
        };
        self.pin(path, digest)
    }

    /// A file's content, `None` if there is no file.
    pub fn read(&self, path: &Path) -> Result<Option<Arc<[u8]>>, NodeError> {
        let bytes: Option<Arc<[u8]>> = match std::fs::read(path) {
            Ok(bytes) => Some(bytes.into()),
            Err(e) if is_absence(&e) => None,
            Err(e) => return Err(unreadable(path, &e)),
        };
        self.pin(path, bytes.as_deref().map(Digest::of))?;
        Ok(bytes)
    }

    /// The error of a node that needs a file where there is none.
    #[must_use]
    pub fn absent(&self, path: &Path) -> NodeError {
        NodeError::passing(format!("there is no file {}", path.display()))
            .help("paths in a graph file are relative to the graph file")
    }

    /// The files looked at so far, for watching.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        self.pinned().keys().cloned().collect()
    }

    fn pin(&self, path: &Path, found: Option<Digest>) -> Result<Option<Digest>, NodeError> {
        let mut pinned = self.pinned();
        if *pinned.entry(path.to_owned()).or_insert(found) == found {
            return Ok(found);
        }
        let message = format!("{} changed while the run was reading it", path.display());
        Err(NodeError::passing(message).help("run again once the file is complete"))
    }

    fn pinned(&self) -> std::sync::MutexGuard<'_, BTreeMap<PathBuf, Option<Digest>>> {
        self.pinned.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn hash(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(Digest::finish(&hasher))
}

fn is_absence(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
}

fn unreadable(path: &Path, error: &io::Error) -> NodeError {
    NodeError::passing(format!("cannot read {}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_changes_under_the_run_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        std::fs::write(&path, "one").unwrap();
        let sources = Sources::new();
        assert_eq!(sources.digest(&path).unwrap(), Some(Digest::of(b"one")));
        assert_eq!(&*sources.read(&path).unwrap().unwrap(), b"one");
        std::fs::write(&path, "two").unwrap();
        let error = sources.read(&path).unwrap_err();
        assert!(error.passing && error.message.contains("changed while"), "{error}");
        assert_eq!(&*Sources::new().read(&path).unwrap().unwrap(), b"two");
    }

    #[test]
    fn absence_is_an_answer_and_other_failures_are_errors() {
        let dir = tempfile::tempdir().unwrap();
        let sources = Sources::new();
        let absent = dir.path().join("none");
        assert_eq!(sources.digest(&absent).unwrap(), None);
        std::fs::write(&absent, "now").unwrap();
        assert!(sources.read(&absent).unwrap_err().message.contains("changed while"));
        assert!(sources.digest(dir.path()).unwrap_err().message.contains("cannot read"));
    }
}
