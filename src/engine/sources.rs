//! The input files of one run, as one consistent snapshot.
//!
//! The first look at a file pins its content: if a later look in the same run finds something else,
//! the read fails and says so, and nothing false is ever recorded.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use salient_sdk::NodeError;

use super::fingerprints::Fingerprints;
use super::key::Digest;

/// What each file held when the run first looked: `None` if there was no file.
#[derive(Default)]
pub struct Sources {
    pinned: Mutex<BTreeMap<PathBuf, Option<Digest>>>,
    /// Files that could not be read.
    unreadable: Mutex<BTreeSet<PathBuf>>,
    /// Hashes from former runs of this process.
    known: Option<Arc<Fingerprints>>,
    /// Told of a file that changed under the run, which is then no failure of a node.
    on_conflict: Option<Box<dyn Fn() + Send + Sync>>,
}

/// A file that is not what the run found in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The file.
    pub path: PathBuf,
    /// Its content then, if it was there and could be read.
    pub before: Option<Digest>,
    /// Its content now, if it is there and can be read.
    pub now: Option<Digest>,
}

impl Sources {
    /// Nothing looked at yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// As [`Sources::new`], with hashes from former runs. `on_conflict` is called when a file turns out to have
    /// changed under the run, and must stop the run.
    #[must_use]
    pub fn watched(known: Arc<Fingerprints>, on_conflict: impl Fn() + Send + Sync + 'static) -> Self {
        Self { known: Some(known), on_conflict: Some(Box::new(on_conflict)), ..Self::default() }
    }

    /// The hash of a file's content, `None` if there is no file.
    pub fn digest(&self, path: &Path) -> Result<Option<Digest>, NodeError> {
        if let Some(pinned) = self.pinned().get(path) {
            return Ok(*pinned);
        }
        let digest = self.now(path).map_err(|e| self.unreadable(path, &e))?;
        self.pin(path, digest)
    }

    fn now(&self, path: &Path) -> io::Result<Option<Digest>> {
        if let Some(known) = &self.known {
            return known.digest(path);
        }
        match hash(path) {
            Ok(digest) => Ok(Some(digest)),
            Err(e) if is_absence(&e) => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// A file's content, `None` if there is no file.
    pub fn read(&self, path: &Path) -> Result<Option<Arc<[u8]>>, NodeError> {
        let bytes: Option<Arc<[u8]>> = match std::fs::read(path) {
            Ok(bytes) => Some(bytes.into()),
            Err(e) if is_absence(&e) => None,
            Err(e) => return Err(self.unreadable(path, &e)),
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
        let mut files: BTreeSet<_> = self.pinned().keys().cloned().collect();
        files.extend(self.unreadable.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned());
        files.into_iter().collect()
    }

    /// Looks again at all files looked at so far, and says which are not as they were.
    ///
    /// If none is, the world is now, at this one moment, as the run saw it.
    #[must_use]
    pub fn changes(&self) -> Vec<Change> {
        let pinned = self.pinned().clone();
        let mut changes = Vec::new();
        for (path, before) in pinned {
            let now = self.now(&path).ok().flatten();
            if now != before {
                changes.push(Change { path, before, now });
            }
        }
        let unreadable = self.unreadable.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for path in unreadable {
            if let Ok(now) = self.now(&path) {
                changes.push(Change { path, before: None, now });
            }
        }
        changes
    }

    fn unreadable(&self, path: &Path, error: &io::Error) -> NodeError {
        self.unreadable.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned());
        NodeError::passing(format!("cannot read {}: {error}", path.display()))
    }

    fn pin(&self, path: &Path, found: Option<Digest>) -> Result<Option<Digest>, NodeError> {
        let mut pinned = self.pinned();
        if *pinned.entry(path.to_owned()).or_insert(found) == found {
            return Ok(found);
        }
        drop(pinned);
        if let Some(on_conflict) = &self.on_conflict {
            on_conflict();
            return Err(NodeError::cancelled());
        }
        let message = format!("{} changed while the run was reading it", path.display());
        Err(NodeError::passing(message).help("run again once the file is complete"))
    }

    fn pinned(&self) -> std::sync::MutexGuard<'_, BTreeMap<PathBuf, Option<Digest>>> {
        self.pinned.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The hash of a file's content.
pub(super) fn hash(path: &Path) -> io::Result<Digest> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(File::open(path)?)?;
    Ok(Digest::finish(&hasher))
}

/// Whether an error says that there is no file.
pub(super) fn is_absence(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory)
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
