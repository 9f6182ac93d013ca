//! The cache directory: plain files, each written to a temporary and renamed.
//!
//! ```text
//! version                         what this directory is
//! objects/ab/<digest>.safetensors artefacts by the hash of their bytes, checked when read
//! records/ab/<key>.json           what made which artefact (self-checked)
//! records/ab/<key>/<reads>.json   the same for nodes that found further files, one for each content of those
//! memo/ab/<group>/<digest>.memo   values of single items by the hash of the file (see [`super::memo`])
//! runs/<time>-<id>-<graph>.json   what recent runs did (self-checked)
//! running/<id>                    one file per living process, touched every minute
//! tmp/                            files being written
//! ```
//!
//! Any number of processes on any number of hosts may use one directory without locks: files only
//! ever appear whole, equal names hold equal content, and whoever loses a race has merely computed
//! something twice.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use salient_sdk::{FormatError, WriteError};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tempfile::NamedTempFile;

use super::key::Digest;
use super::record::{Record, seal, unseal};

/// What the file `version` says.
const VERSION: &str = "salient cache 1\n";
/// Files used again within this time are not touched again.
const TOUCH_AFTER: Duration = Duration::from_secs(600);

/// The cache directory cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CacheError {
    /// What failed, on which path, and the system's reason.
    pub message: String,
    /// What to do about it.
    pub help: String,
}

impl CacheError {
    pub(super) fn new(action: &str, path: &Path, error: &io::Error) -> Self {
        let help = match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                "free space with `salient cache gc --max-size 1GB`, or name another directory with --cache"
            }
            _ => "name another directory with --cache or SALIENT_CACHE, or make this one writable",
        };
        let message = format!("the cache cannot {action} {}: {error}", path.display());
        Self { message, help: help.into() }
    }
}

impl fmt::Display for CacheError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for CacheError {}

/// An artefact cannot be kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PutError {
    /// Its content has no bytes.
    Format(FormatError),
    /// The cache has no room for them.
    Cache(CacheError),
}

impl From<CacheError> for PutError {
    fn from(error: CacheError) -> Self {
        Self::Cache(error)
    }
}

/// An entry of the cache that was looked up.
#[derive(Debug, PartialEq, Eq)]
pub enum Entry<T> {
    /// There, and whole.
    Found(T),
    /// Not there.
    Missing,
    /// Was there with the wrong content; it has been removed.
    Corrupt(PathBuf),
}

/// A cache directory. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Cache {
    pub(super) root: PathBuf,
}

impl Cache {
    /// Opens a cache directory, making it if needed.
    pub fn open(root: &Path) -> Result<Self, CacheError> {
        let cache = Self { root: root.to_owned() };
        for part in ["objects", "records", "memo", "runs", "running", "tmp"] {
            let path = root.join(part);
            fs::create_dir_all(&path).map_err(|e| CacheError::new("make", &path, &e))?;
        }
        let version = root.join("version");
        match fs::read_to_string(&version) {
            Ok(found) if found == VERSION => Ok(cache),
            Ok(found) => Err(CacheError {
                message: format!("{} is of another version of salient: `{}`", root.display(), found.trim()),
                help: "name another directory with --cache, or remove this one".into(),
            }),
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                // Backup tools skip directories with this tag.
                let tag = "Signature: 8a477f597d28d172789f06886806bc55\n# made by salient\n";
                cache.write(&root.join("CACHEDIR.TAG"), tag.as_bytes())?;
                cache.write(&version, VERSION.as_bytes())?;
                Ok(cache)
            }
            Err(e) => Err(CacheError::new("read", &version, &e)),
        }
    }

    /// Where it is.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Where the object of a digest is, if it is there.
    #[must_use]
    pub fn object_path(&self, digest: &Digest) -> PathBuf {
        let name = digest.to_string();
        self.root.join("objects").join(&name[..2]).join(format!("{name}.safetensors"))
    }

    /// Keeps an artefact, whose bytes `write` puts into an empty file. A file that is already there is replaced, so a damaged one is healed.
    pub fn put_object<T>(
        &self,
        write: impl FnOnce(&mut File) -> Result<T, WriteError>,
    ) -> Result<(Digest, T), PutError> {
        let tmp = self.root.join("tmp");
        let unwritable = |e: &io::Error| PutError::Cache(CacheError::new("write in", &tmp, e));
        let mut file = temporary(&tmp).map_err(|e| unwritable(&e))?;
        let written = write(file.as_file_mut()).map_err(|e| match e {
            WriteError::Format(e) => PutError::Format(e),
            WriteError::Io(e) => unwritable(&e),
        })?;
        let digest = Digest::of_file(file.as_file_mut()).map_err(|e| unwritable(&e))?;
        let path = self.object_path(&digest);
        persist(file, &path).map_err(|e| CacheError::new("write", &path, &e))?;
        Ok((digest, written))
    }

    /// The bytes of an artefact, checked against its digest.
    pub fn object(&self, digest: &Digest) -> Result<Entry<Vec<u8>>, CacheError> {
        let path = self.object_path(digest);
        match fs::read(&path) {
            Ok(bytes) if Digest::of(&bytes) == *digest => Ok(Entry::Found(bytes)),
            Ok(_) => {
                let whole = |bytes: &[u8]| Digest::of(bytes) == *digest;
                Ok(self.discard(&path, whole)?.map_or(Entry::Corrupt(path), Entry::Found))
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(Entry::Missing),
            Err(e) => Err(CacheError::new("read", &path, &e)),
        }
    }

    /// Whether an object is there, unchecked; marks it as used.
    #[must_use]
    pub fn has_object(&self, digest: &Digest) -> bool {
        touch(&self.object_path(digest))
    }

    /// Removes an object that turned out not to be what it should.
    pub fn remove_object(&self, digest: &Digest) -> Result<PathBuf, CacheError> {
        let path = self.object_path(digest);
        remove(&path)?;
        Ok(path)
    }

    fn record_dir(&self, key: &Digest) -> PathBuf {
        let name = key.to_string();
        self.root.join("records").join(&name[..2]).join(name)
    }

    /// Where a record is. Nearly all nodes find no further files; a folder for each of their records would cost more
    /// than the record.
    #[must_use]
    pub fn record_path(&self, record: &Record) -> PathBuf {
        let dir = self.record_dir(&record.ingredients.key());
        match record.reads.as_slice() {
            [] => dir.with_extension("json"),
            _ => dir.join(format!("{}.json", record.reads_digest())),
        }
    }

    /// Keeps a record under its key.
    pub fn put_record(&self, record: &Record) -> Result<(), CacheError> {
        self.write_sealed(&self.record_path(record), record)
    }

    /// All records of a key, and the paths of damaged ones, which have been removed.
    pub fn records(&self, key: &Digest) -> Result<(Vec<Record>, Vec<PathBuf>), CacheError> {
        let (mut found, mut corrupt) = (Vec::new(), Vec::new());
        let dir = self.record_dir(key);
        let alone = dir.with_extension("json");
        match self.sealed(&alone, |record: &Record| record.ingredients.key() == *key)? {
            Entry::Found(record) => {
                touch(&alone);
                // What needs no further files is right whatever they hold.
                return Ok((vec![record], corrupt));
            }
            Entry::Corrupt(path) => corrupt.push(path),
            Entry::Missing => {}
        }
        for path in list(&dir)? {
            match self.sealed(&path, |record: &Record| record.ingredients.key() == *key)? {
                Entry::Found(record) => {
                    touch(&path);
                    found.push(record);
                }
                Entry::Corrupt(path) => corrupt.push(path),
                Entry::Missing => {}
            }
        }
        Ok((found, corrupt))
    }

    /// Reads a self-checked file whose content is to be `right`; a damaged one is removed.
    pub(super) fn sealed<T: DeserializeOwned>(
        &self,
        path: &Path,
        right: impl Fn(&T) -> bool,
    ) -> Result<Entry<T>, CacheError> {
        let whole = |bytes: &[u8]| unseal::<T>(bytes).filter(&right);
        let bytes = match fs::read(path) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Entry::Missing),
            Err(e) => return Err(CacheError::new("read", path, &e)),
        };
        if let Some(value) = whole(&bytes) {
            return Ok(Entry::Found(value));
        }
        let healed = self.discard(path, |bytes| whole(bytes).is_some())?;
        let healed = healed.and_then(|bytes| whole(&bytes));
        Ok(healed.map_or(Entry::Corrupt(path.to_owned()), Entry::Found))
    }

    /// Removes a damaged file. Somebody may have replaced it by a whole one since it was read: that
    /// one is put back, and its content returned.
    pub(super) fn discard(&self, path: &Path, whole: impl Fn(&[u8]) -> bool) -> Result<Option<Vec<u8>>, CacheError> {
        let failed = |e: io::Error| CacheError::new("remove", path, &e);
        let aside = tempfile::Builder::new().tempfile_in(self.root.join("tmp")).map_err(failed)?;
        match fs::rename(path, aside.path()) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            renamed => renamed.map_err(failed)?,
        }
        let bytes = fs::read(aside.path()).map_err(failed)?;
        if !whole(&bytes) {
            return Ok(None);
        }
        aside.persist(path).map_err(|e| failed(e.error))?;
        Ok(Some(bytes))
    }

    /// A file without a name, gone once it is closed, however its process ends.
    pub(super) fn scratch(&self) -> io::Result<File> {
        tempfile::tempfile_in(self.root.join("tmp")).map_err(|e| unwrap_path(&e))
    }

    pub(super) fn write_sealed(&self, path: &Path, value: &impl Serialize) -> Result<(), CacheError> {
        let text = seal(value).map_err(|e| CacheError::new("write", path, &e.into()))?;
        self.write(path, text.as_bytes())
    }

    /// Writes a whole file or nothing.
    pub(super) fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), CacheError> {
        write_atomic(path, &self.root.join("tmp"), bytes).map_err(|e| CacheError::new("write", path, &e))
    }
}

/// Writes a file by way of a temporary in `tmp`, which must be on the same file system, so that
/// nobody ever sees a part of it.
pub fn write_atomic(path: &Path, tmp: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = temporary(tmp)?;
    file.write_all(bytes)?;
    persist(file, path)
}

/// An empty file that is gone unless it is persisted.
fn temporary(tmp: &Path) -> io::Result<NamedTempFile> {
    // Readable by all that the umask allows: caches are shared between users.
    let builder = &mut tempfile::Builder::new();
    builder.permissions(fs::Permissions::from_mode(0o666)).tempfile_in(tmp).map_err(|e| unwrap_path(&e))
}

/// Gives it its name, in a folder that is made if needed.
fn persist(mut file: NamedTempFile, path: &Path) -> io::Result<()> {
    let parent = path.parent().unwrap_or(Path::new("."));
    let mut left = 3;
    loop {
        fs::create_dir_all(parent)?;
        match file.persist(path) {
            Ok(_) => return Ok(()),
            // A collector removed the empty folder in between.
            Err(e) if e.error.kind() == io::ErrorKind::NotFound && left > 0 => {
                left -= 1;
                file = e.file;
            }
            Err(e) => return Err(e.error),
        }
    }
}

/// The system's error without the path that `tempfile` adds; ours names the file that is wanted.
fn unwrap_path(error: &io::Error) -> io::Error {
    let kind = error.kind();
    error.raw_os_error().map_or(io::Error::new(kind, kind.to_string()), io::Error::from_raw_os_error)
}

/// Marks a file as used now; false if it is not there.
pub(super) fn touch(path: &Path) -> bool {
    let Ok(meta) = fs::metadata(path) else { return false };
    let now = SystemTime::now();
    let fresh = meta.modified().is_ok_and(|at| now.duration_since(at).unwrap_or_default() < TOUCH_AFTER);
    if !fresh {
        // Another user's file cannot be touched; then it only looks older than it is.
        let _ = fs::File::open(path).and_then(|file| file.set_modified(now));
    }
    true
}

/// The entries of a folder, sorted; none if there is no such folder.
pub(super) fn list(dir: &Path) -> Result<Vec<PathBuf>, CacheError> {
    let error = |e: io::Error| CacheError::new("list", dir, &e);
    let entries = match fs::read_dir(dir) {
        Ok(entries) => entries,
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(e) => return Err(error(e)),
    };
    let mut paths = Vec::new();
    for entry in entries {
        paths.push(entry.map_err(error)?.path());
    }
    paths.sort();
    Ok(paths)
}

/// Removes a file; it is no error if another process was faster.
pub(super) fn remove(path: &Path) -> Result<(), CacheError> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(CacheError::new("remove", path, &e)),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_apart() {
        // Every write to this device fails as on a full disk.
        let device = Path::new("/dev/full");
        if let Err(error) = fs::write(device, "x").map_err(|e| CacheError::new("write", device, &e)) {
            assert!(error.message.contains("/dev/full") && error.help.contains("gc"), "{error:?}");
        }
    }

    #[test]
    fn a_scratch_file_has_no_name() {
        let folder = tempfile::tempdir().expect("room");
        let cache = Cache::open(folder.path()).expect("a new one");
        let mut file = cache.scratch().expect("room");
        file.write_all(b"for a while").expect("room");
        assert_eq!(fs::read_dir(folder.path().join("tmp")).expect("there").count(), 0);
    }

    #[test]
    fn a_file_healed_by_another_process_is_not_removed() {
        let dir = tempfile::tempdir().unwrap();
        let cache = Cache::open(dir.path()).unwrap();
        let write = |file: &mut File| Ok(file.write_all(b"whole")?);
        let (digest, ()) = cache.put_object(write).unwrap();
        let path = cache.object_path(&digest);
        // As if it had been read as damaged just before it was healed.
        let healed = cache.discard(&path, |bytes| bytes == b"whole").unwrap();
        assert_eq!(healed.as_deref(), Some(&b"whole"[..]));
        assert_eq!(cache.object(&digest).unwrap(), Entry::Found(b"whole".to_vec()));
        fs::write(&path, "damaged").unwrap();
        assert_eq!(cache.object(&digest).unwrap(), Entry::Corrupt(path));
        assert_eq!(cache.object(&digest).unwrap(), Entry::Missing);
    }
}
