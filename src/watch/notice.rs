//! Notices from the system that something changed. They only say that it is time to look.

use std::collections::{BTreeMap, BTreeSet};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use crossbeam::channel::Sender;
use notify::event::{AccessKind, AccessMode, EventKind, ModifyKind};
use notify::{RecommendedWatcher, RecursiveMode, Watcher as _};

use super::places::Places;

/// What the inbox of a watch receives.
pub enum Message {
    /// Something that matters may have changed.
    Look,
    /// To stop, and end.
    Stop,
    /// The run that was listened for is over.
    Over,
}

/// Asks the system for notices of the places that matter now.
pub struct Notices {
    watcher: Option<RecommendedWatcher>,
    places: Arc<RwLock<Places>>,
    /// Folders being watched, each with its device and inode.
    watched: BTreeMap<PathBuf, (u64, u64)>,
    /// Folders that were removed or renamed since. One of the same name may be there again, and even have the
    /// same inode, but the system does not watch it.
    lost: Arc<Mutex<BTreeSet<PathBuf>>>,
}

impl Notices {
    /// Notices go to `inbox`. Also says whether there can be none.
    pub fn new(inbox: Sender<Message>) -> (Self, bool) {
        let places = Arc::new(RwLock::new(Places::default()));
        let lost = Arc::new(Mutex::new(BTreeSet::new()));
        let (known, losses) = (places.clone(), lost.clone());
        let on_event = move |event: notify::Result<notify::Event>| {
            if let Ok(event) = &event
                && matches!(event.kind, EventKind::Remove(_) | EventKind::Modify(ModifyKind::Name(_)))
            {
                losses.lock().unwrap_or_else(PoisonError::into_inner).extend(event.paths.iter().cloned());
            }
            if matters(&event, &known.read().unwrap_or_else(PoisonError::into_inner)) {
                // A watch that has ended needs no notices.
                let _ = inbox.send(Message::Look);
            }
        };
        let watcher = notify::recommended_watcher(on_event).ok();
        let deaf = watcher.is_none();
        (Self { watcher, places, watched: BTreeMap::new(), lost }, deaf)
    }

    /// Without the system: somebody has to look from time to time.
    pub fn none() -> Self {
        Self { watcher: None, places: Arc::default(), watched: BTreeMap::new(), lost: Arc::default() }
    }

    /// Watches these places from now on. What changed before that was not noticed, so look once more afterwards.
    ///
    /// The error is a folder that cannot be watched.
    pub fn attend(&mut self, places: Places) -> Result<(), String> {
        let folders = places.folders.clone();
        *self.places.write().unwrap_or_else(PoisonError::into_inner) = places;
        let Some(watcher) = &mut self.watcher else { return Ok(()) };
        for folder in std::mem::take(&mut *self.lost.lock().unwrap_or_else(PoisonError::into_inner)) {
            self.watched.remove(&folder);
        }
        let gone: Vec<_> = self.watched.keys().filter(|folder| !folders.contains(*folder)).cloned().collect();
        for folder in gone {
            self.watched.remove(&folder);
            // The system has forgotten folders that are gone.
            let _ = watcher.unwatch(&folder);
        }
        let mut result = Ok(());
        for folder in folders {
            // A folder that was removed and made again is another one.
            let Some(identity) = identity(&folder) else { continue };
            if self.watched.get(&folder) == Some(&identity) {
                continue;
            }
            let _ = watcher.unwatch(&folder);
            match watcher.watch(&folder, RecursiveMode::NonRecursive) {
                Ok(()) => drop(self.watched.insert(folder, identity)),
                Err(e) => result = Err(format!("{}: {e}", folder.display())),
            }
        }
        result
    }
}

fn identity(folder: &Path) -> Option<(u64, u64)> {
    std::fs::metadata(folder).ok().map(|meta| (meta.dev(), meta.ino()))
}

fn matters(event: &notify::Result<notify::Event>, places: &Places) -> bool {
    let Ok(event) = event else { return true };
    let reading = match event.kind {
        EventKind::Access(AccessKind::Close(AccessMode::Write)) => false,
        EventKind::Access(_) | EventKind::Modify(ModifyKind::Metadata(notify::event::MetadataKind::AccessTime)) => true,
        _ => false,
    };
    event.need_rescan() || (!reading && event.paths.iter().any(|path| places.concern(path)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use notify::event::{CreateKind, Event, Flag};

    #[test]
    fn reading_and_other_files_do_not_matter_and_lost_notices_do() {
        let mut places = Places::default();
        places.entries.insert("/a/b".into());
        let matter = |event: Event| matters(&Ok(event), &places);
        let on = |kind, path: &str| Event::new(kind).add_path(path.into());
        assert!(matter(on(EventKind::Create(CreateKind::File), "/a/b")));
        assert!(matter(on(EventKind::Access(AccessKind::Close(AccessMode::Write)), "/a/b")));
        assert!(!matter(on(EventKind::Access(AccessKind::Open(AccessMode::Any)), "/a/b")));
        assert!(!matter(on(EventKind::Create(CreateKind::File), "/a/c")));
        assert!(matter(Event::new(EventKind::Other).set_flag(Flag::Rescan)));
        assert!(matters(&Err(notify::Error::generic("lost")), &places));
    }
}
