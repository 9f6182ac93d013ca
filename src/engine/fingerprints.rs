//! Hashes of files that stay what they were, so that a file is not read again for every run.
//!
//! A hash is known again by the file's identity, size and times. Times are coarse: a file written
//! twice within one tick of its file system's clock may keep them. So a hash counts only if it was
//! made some time after these times were first seen; until then the file is read again.

use std::collections::BTreeMap;
use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

use super::key::Digest;
use super::sources::{hash, is_absence};

/// A tick of a clock that counts parts of a second is far shorter.
const FINE: Duration = Duration::from_millis(100);
/// A tick of other clocks is 2 s at most (FAT).
const COARSE: Duration = Duration::from_millis(2500);
/// What changed so long ago, by the clocks of this and of the file's host, is not being written now.
const OLD: Duration = Duration::from_secs(600);

/// What identifies the content of a file without reading it.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Stamp {
    device: u64,
    inode: u64,
    size: u64,
    modified: (i64, i64),
    changed: (i64, i64),
}

impl Stamp {
    fn of(meta: &Metadata) -> Self {
        Self {
            device: meta.dev(),
            inode: meta.ino(),
            size: meta.size(),
            modified: (meta.mtime(), meta.mtime_nsec()),
            changed: (meta.ctime(), meta.ctime_nsec()),
        }
    }

    /// How long after it was first seen another write would have changed it.
    fn tick(&self) -> Duration {
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let age = now.as_secs() as i64 - self.changed.0;
        if age > OLD.as_secs() as i64 {
            Duration::ZERO
        } else if self.modified.1 == 0 || self.changed.1 == 0 {
            COARSE
        } else {
            FINE
        }
    }
}

struct Seen {
    stamp: Stamp,
    /// When the file was first seen with this stamp.
    since: Instant,
    /// Whether the hash was made long enough after that.
    settled: bool,
    digest: Digest,
}

/// Hashes by path.
#[derive(Default)]
pub struct Fingerprints {
    seen: Mutex<BTreeMap<PathBuf, Seen>>,
}

impl Fingerprints {
    /// None known.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The hash of a file's content now, `None` if there is no file.
    pub fn digest(&self, path: &Path) -> io::Result<Option<Digest>> {
        let begun = Instant::now();
        let stamp = match std::fs::metadata(path) {
            Ok(meta) => Stamp::of(&meta),
            Err(e) if is_absence(&e) => {
                self.seen().remove(path);
                return Ok(None);
            }
            Err(e) => return Err(e),
        };
        let known = self.seen().get(path).filter(|seen| seen.stamp == stamp).map(|s| (s.settled, s.since, s.digest));
        let since = match known {
            Some((true, _, digest)) => return Ok(Some(digest)),
            Some((false, since, _)) => since,
            None => begun,
        };
        let digest = match hash(path) {
            Ok(digest) => digest,
            Err(e) if is_absence(&e) => return Ok(None),
            Err(e) => return Err(e),
        };
        // If it was written meanwhile, it is read again the next time.
        if std::fs::metadata(path).is_ok_and(|meta| Stamp::of(&meta) == stamp) {
            let settled = begun.duration_since(since) >= stamp.tick();
            self.seen().insert(path.to_owned(), Seen { stamp, since, settled, digest });
        }
        Ok(Some(digest))
    }

    fn seen(&self) -> std::sync::MutexGuard<'_, BTreeMap<PathBuf, Seen>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    /// Many writes of equal length, as fast as they come: most fall within one tick of the clock.
    #[test]
    fn writes_within_one_tick_are_told_apart() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        let known = Fingerprints::new();
        assert_eq!(known.digest(&path).unwrap(), None);
        for i in 0..2000 {
            let text = format!("{i:04}");
            fs::write(&path, &text).unwrap();
            assert_eq!(known.digest(&path).unwrap(), Some(Digest::of(text.as_bytes())));
            assert_eq!(known.digest(&path).unwrap(), Some(Digest::of(text.as_bytes())));
        }
        fs::remove_file(&path).unwrap();
        assert_eq!(known.digest(&path).unwrap(), None);
        assert!(known.digest(dir.path()).is_err());
    }

    #[test]
    fn what_has_settled_is_not_read_again() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        fs::write(&path, "one").unwrap();
        let known = Fingerprints::new();
        let first = known.digest(&path).unwrap();
        // As if it had been seen long ago.
        let wrong = Digest::of(b"known");
        known.seen().get_mut(&path).unwrap().settled = true;
        known.seen().get_mut(&path).unwrap().digest = wrong;
        assert_eq!(known.digest(&path).unwrap(), Some(wrong));
        // Another file of equal size and time of modification in its place.
        let time = fs::metadata(&path).unwrap().modified().unwrap();
        let other = dir.path().join("b");
        fs::write(&other, "one").unwrap();
        fs::File::options().write(true).open(&other).unwrap().set_modified(time).unwrap();
        fs::rename(&other, &path).unwrap();
        assert_eq!(known.digest(&path).unwrap(), first);
    }
}
