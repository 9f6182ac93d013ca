//! The size of a cache directory, its verification, and its collection.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde::Serialize;

use super::cache::{Cache, CacheError, Entry, list, remove};
use super::key::Digest;
use super::record::Record;
use super::running::Live;

/// What was used within this time before now, or before the oldest living run began, is not
/// collected: clocks of hosts differ, and a run may be about to read what it has just looked up.
pub const GRACE: Duration = Duration::from_secs(3600);
/// Temporaries older than this were left by a process that died.
const STALE: Duration = Duration::from_secs(24 * 3600);

/// What is in a cache directory.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Stat {
    /// Artefacts.
    pub objects: usize,
    /// Their size in bytes.
    pub object_bytes: u64,
    /// Records of computed outputs.
    pub records: usize,
    /// Their size in bytes.
    pub record_bytes: u64,
    /// Packs of remembered items.
    pub memos: usize,
    /// Their size in bytes.
    pub memo_bytes: u64,
    /// Runs remembered.
    pub runs: usize,
    /// Files being written, or left by processes that died.
    pub temporaries: usize,
    /// Runs that use the cache now.
    pub running: Vec<Live>,
}

/// What a verification found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Artefacts whose bytes have the digest that they are named after.
    pub objects: usize,
    /// Records that are whole.
    pub records: usize,
    /// Packs of remembered items whose bytes have the digest that they are named after.
    pub memos: usize,
    /// Records whose artefact has been collected: computed again when it is needed.
    pub evicted: usize,
    /// Damaged files; they have been removed.
    pub corrupt: Vec<PathBuf>,
}

/// What a collection removed.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Collected {
    /// Artefacts removed.
    pub objects: usize,
    /// Records removed.
    pub records: usize,
    /// Packs of remembered items removed.
    pub memos: usize,
    /// Stale temporaries removed.
    pub temporaries: usize,
    /// Bytes removed.
    pub bytes: u64,
    /// Bytes of artefacts and remembered items that are left.
    pub left: u64,
    /// Bytes that would have been removed were they not in use or just used.
    pub protected: u64,
}

/// What to collect.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Artefacts and remembered items are removed, longest unused first, until at most so many bytes are left.
    pub max_size: Option<u64>,
    /// Artefacts and records unused for longer are removed.
    pub max_age: Option<Duration>,
    /// See [`GRACE`].
    pub grace: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_size: None, max_age: None, grace: GRACE }
    }
}

struct Found {
    path: PathBuf,
    bytes: u64,
    used: SystemTime,
}

impl Cache {
    /// Counts what is there.
    pub fn stat(&self) -> Result<Stat, CacheError> {
        let (objects, records, memos) = (self.walk("objects")?, self.walk("records")?, self.walk("memo")?);
        Ok(Stat {
            objects: objects.len(),
            object_bytes: objects.iter().map(|file| file.bytes).sum(),
            records: records.len(),
            record_bytes: records.iter().map(|file| file.bytes).sum(),
            memos: memos.len(),
            memo_bytes: memos.iter().map(|file| file.bytes).sum(),
            runs: self.walk("runs")?.len(),
            temporaries: self.walk("tmp")?.len(),
            running: self.running()?,
        })
    }

    /// Reads and checks everything; damaged files are removed.
    pub fn verify(&self) -> Result<Verified, CacheError> {
        let mut report = Verified::default();
        for file in self.walk("objects")? {
            let name = file.path.file_stem().and_then(|stem| stem.to_str());
            let Some(digest) = name.and_then(|name| name.parse::<Digest>().ok()) else {
                remove(&file.path)?;
                report.corrupt.push(file.path);
                continue;
            };
            match self.object(&digest)? {
                Entry::Found(_) => report.objects += 1,
                Entry::Missing => {}
                Entry::Corrupt(path) => report.corrupt.push(path),
            }
        }
        let mut whole = Vec::new();
        for file in self.walk("records")? {
            match self.sealed(&file.path, |_: &Record| true)? {
                Entry::Found(record) => whole.push(record.digest),
                Entry::Missing => {}
                Entry::Corrupt(path) => report.corrupt.push(path),
            }
        }
        for file in self.walk("memo")? {
            match self.pack(&file.path)? {
                Entry::Found(_) => report.memos += 1,
                Entry::Missing => {}
                Entry::Corrupt(path) => report.corrupt.push(path),
            }
        }
        report.records = whole.len();
        report.evicted = whole.iter().filter(|digest| !self.object_path(digest).exists()).count();
        Ok(report)
    }

    /// Removes what is too old or too much, and what dead processes left.
    ///
    /// Nothing is removed that was used since the oldest living run began (less the grace). Should
    /// a run need something that is gone after all, it computes it again.
    pub fn gc(&self, limits: Limits) -> Result<Collected, CacheError> {
        let now = SystemTime::now();
        let since = |live: &Live| SystemTime::UNIX_EPOCH + Duration::from_millis(live.since);
        let oldest = self.running()?.iter().map(since).min().unwrap_or(now).min(now);
        let protected_since = oldest.checked_sub(limits.grace).unwrap_or(SystemTime::UNIX_EPOCH);
        let too_old =
            |used: SystemTime| limits.max_age.is_some_and(|max| now.duration_since(used).is_ok_and(|age| age > max));
        let mut report = Collected::default();
        let mut content: Vec<(Found, bool)> = self.walk("objects")?.into_iter().map(|file| (file, true)).collect();
        content.extend(self.walk("memo")?.into_iter().map(|file| (file, false)));
        content.sort_by(|(a, _), (b, _)| (a.used, &a.path).cmp(&(b.used, &b.path)));
        let mut left: u64 = content.iter().map(|(file, _)| file.bytes).sum();
        for (file, is_object) in content {
            if !too_old(file.used) && limits.max_size.is_none_or(|max| left <= max) {
                continue;
            }
            if file.used >= protected_since {
                report.protected += file.bytes;
                continue;
            }
            remove(&file.path)?;
            left -= file.bytes;
            report.bytes += file.bytes;
            *(if is_object { &mut report.objects } else { &mut report.memos }) += 1;
            if !is_object {
                // Fails unless this was the last pack of its group, which is what we want.
                let _ = file.path.parent().map(fs::remove_dir);
            }
        }
        report.left = left;
        for file in self.walk("records")? {
            if too_old(file.used) && file.used < protected_since {
                remove(&file.path)?;
                report.records += 1;
                report.bytes += file.bytes;
                // Fails unless this was the last record of its key, which is what we want.
                let _ = file.path.parent().map(fs::remove_dir);
            }
        }
        for file in self.walk("tmp")? {
            if now.duration_since(file.used).is_ok_and(|age| age > STALE) {
                remove(&file.path)?;
                report.temporaries += 1;
                report.bytes += file.bytes;
            }
        }
        Ok(report)
    }

    /// Removes everything. Refused while runs use the cache.
    pub fn clear(&self) -> Result<Collected, CacheError> {
        if let Some(live) = self.running()?.first() {
            return Err(CacheError {
                message: format!("{} is in use by process {} (on this or another host)", self.root.display(), live.pid),
                help: "wait for it to end; a run that died is forgotten after ten minutes".into(),
            });
        }
        let mut report = Collected::default();
        for (part, count) in [
            ("objects", &mut report.objects),
            ("records", &mut report.records),
            ("memo", &mut report.memos),
            ("tmp", &mut report.temporaries),
            ("runs", &mut 0),
        ] {
            for file in self.walk(part)? {
                remove(&file.path)?;
                *count += 1;
                report.bytes += file.bytes;
            }
            remove_empty(&self.root.join(part))?;
        }
        Ok(report)
    }

    /// All files below a part of the directory. Files that vanish meanwhile are left out.
    fn walk(&self, part: &str) -> Result<Vec<Found>, CacheError> {
        let (mut files, mut dirs) = (BTreeMap::new(), vec![self.root.join(part)]);
        while let Some(dir) = dirs.pop() {
            for path in list(&dir)? {
                let Ok(meta) = fs::symlink_metadata(&path) else { continue };
                if meta.is_dir() {
                    dirs.push(path);
                } else {
                    let used = meta.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                    files.insert(path.clone(), Found { path, bytes: meta.len(), used });
                }
            }
        }
        Ok(files.into_values().collect())
    }
}

fn remove_empty(dir: &Path) -> Result<(), CacheError> {
    for path in list(dir)? {
        if path.is_dir() {
            remove_empty(&path)?;
            // Another process may have written there meanwhile; then it stays.
            let _ = fs::remove_dir(&path);
        }
    }
    Ok(())
}
