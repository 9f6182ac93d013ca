//! Which processes use a cache directory now, on whatever host: one small file each, touched while
//! the process lives.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};

use serde::{Deserialize, Serialize};

use super::cache::{Cache, CacheError, Entry, list, remove};
use super::worker::millis;

/// How often a living process touches its file.
const BEAT: Duration = Duration::from_secs(60);
/// A process whose file is older has died.
pub(super) const DEAD_AFTER: Duration = Duration::from_secs(600);

/// A living run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Live {
    /// Its process id, on its own host.
    pub pid: u32,
    /// Name of that host; empty where it cannot be told.
    pub host: String,
    /// When it began, in milliseconds since 1970.
    pub since: u64,
}

impl Live {
    /// Whether it is a process of this host that is no more.
    fn is_gone(&self) -> bool {
        let processes = Path::new("/proc/self");
        processes.exists()
            && !self.host.is_empty()
            && self.host == host()
            && !Path::new(&format!("/proc/{}", self.pid)).exists()
    }
}

fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    name.trim().to_owned()
}

/// Says that this process uses the cache, until dropped.
pub(super) struct Running {
    path: PathBuf,
    last: Instant,
}

impl Running {
    pub(super) fn register(cache: &Cache) -> Result<Self, CacheError> {
        static RUNS: AtomicU64 = AtomicU64::new(0);
        let (pid, since) = (std::process::id(), millis(SystemTime::now()));
        let live = Live { pid, host: host(), since };
        let run = RUNS.fetch_add(1, Ordering::Relaxed);
        let path = cache.root.join("running").join(format!("{}-{}-{run}", live.since, live.pid));
        cache.write_sealed(&path, &live)?;
        Ok(Self { path, last: Instant::now() })
    }

    pub(super) fn beat(&mut self) {
        if self.last.elapsed() >= BEAT {
            self.last = Instant::now();
            // Missing a beat costs nothing but protection from a collector that runs just now.
            let _ = fs::File::open(&self.path).and_then(|f| f.set_modified(SystemTime::now()));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

impl Cache {
    /// The runs that use this directory now. Files of runs that died are removed.
    pub fn running(&self) -> Result<Vec<Live>, CacheError> {
        let mut live = Vec::new();
        for path in list(&self.root.join("running"))? {
            let age = fs::metadata(&path).and_then(|m| m.modified()).map(|at| at.elapsed());
            if matches!(age, Ok(Ok(age)) if age > DEAD_AFTER) {
                remove(&path)?;
            } else if let Entry::Found(it) = self.sealed(&path, |_: &Live| true)? {
                if it.is_gone() { remove(&path)? } else { live.push(it) }
            }
        }
        Ok(live)
    }
}
