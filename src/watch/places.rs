//! Which folders to watch for a file, there or not, behind symbolic links or not.
//!
//! Editors replace files by renaming, which leaves a watch on the file itself deaf; so the folder is watched
//! that a file lies in. If a part of a path is a symbolic link, the folder that holds the link is watched too,
//! and of a path that leads nowhere the deepest folder that is there.

use std::collections::{BTreeSet, VecDeque};
use std::ffi::OsString;
use std::path::{Component, Path, PathBuf};

/// Links that a path may have, as for the system.
const MOST_LINKS: usize = 40;

/// What to watch, without symbolic links.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Places {
    /// Folders that are there.
    pub folders: BTreeSet<PathBuf>,
    /// Entries of these folders that matter.
    pub entries: BTreeSet<PathBuf>,
    /// Folders of which every entry matters.
    pub listed: BTreeSet<PathBuf>,
}

impl Places {
    /// Adds a file.
    pub fn file(&mut self, path: &Path) {
        self.follow(path);
    }

    /// Adds a folder all of whose entries matter.
    pub fn folder(&mut self, path: &Path) {
        if let Some(real) = self.follow(path)
            && real.is_dir()
        {
            self.folders.insert(real.clone());
            self.listed.insert(real);
        }
    }

    /// Whether a change of `path` may matter.
    #[must_use]
    pub fn concern(&self, path: &Path) -> bool {
        self.entries.contains(path)
            || self.folders.contains(path)
            || path.parent().is_some_and(|folder| self.listed.contains(folder))
    }

    /// Walks along a path as the system does, and says where it leads, if it leads anywhere.
    fn follow(&mut self, path: &Path) -> Option<PathBuf> {
        let path = std::path::absolute(path).ok()?;
        let mut left: VecDeque<OsString> = VecDeque::new();
        let (mut at, mut links) = (PathBuf::from("/"), 0);
        push(&mut left, &path);
        while let Some(part) = left.pop_front() {
            if part == ".." {
                at.pop();
                continue;
            }
            let next = at.join(&part);
            match std::fs::symlink_metadata(&next) {
                Ok(meta) if meta.is_symlink() => {
                    self.entry(&at, next.clone());
                    links += 1;
                    let target = std::fs::read_link(&next).ok().filter(|_| links <= MOST_LINKS)?;
                    if target.is_absolute() {
                        at = PathBuf::from("/");
                    }
                    push(&mut left, &target);
                }
                Ok(meta) if meta.is_dir() && !left.is_empty() => at = next,
                Ok(_) => {
                    // A file where a folder is expected leads nowhere.
                    self.entry(&at, next.clone());
                    return left.is_empty().then_some(next);
                }
                Err(_) => {
                    self.entry(&at, next);
                    return None;
                }
            }
        }
        Some(at)
    }

    fn entry(&mut self, folder: &Path, entry: PathBuf) {
        self.folders.insert(folder.to_owned());
        self.entries.insert(entry);
    }
}

/// Puts the parts of a path before those that are left.
fn push(left: &mut VecDeque<OsString>, path: &Path) {
    let parts = path.components().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_owned()),
        Component::ParentDir => Some("..".into()),
        _ => None,
    });
    for part in parts.collect::<Vec<_>>().into_iter().rev() {
        left.push_front(part);
    }
}

/// Whether a path is on a file system whose changes by other hosts the system does not tell of.
///
/// `mounts` is the text of `/proc/self/mountinfo`.
#[must_use]
pub fn is_remote(path: &Path, mounts: &str) -> bool {
    // A program's file system is `fuse`, or `fuse.` and its name; `fuseblk` is a disk.
    const REMOTE: [&str; 16] = [
        "nfs", "cifs", "smb", "9p", "virtiofs", "afs", "ceph", "lustre", "gpfs", "beegfs", "pvfs2", "orangefs",
        "vboxsf", "prl_fs", "drvfs", "fuse.",
    ];
    let mount = |line: &str| {
        let (place, rest) = line.split_once(" - ")?;
        let point = place.split(' ').nth(4)?.replace("\\040", " ");
        let kind = rest.split(' ').next()?.to_owned();
        path.starts_with(&point).then_some((point.len(), kind))
    };
    // Of mounts on one folder the last is in use.
    let deepest = mounts.lines().filter_map(mount).max_by_key(|(length, _)| *length);
    deepest.is_some_and(|(_, kind)| kind == "fuse" || REMOTE.iter().any(|remote| kind.starts_with(remote)))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn links_are_followed_and_their_folders_watched() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        let at = |name: &str| root.join(name);
        fs::create_dir_all(at("real/deep")).unwrap();
        fs::create_dir(at("links")).unwrap();
        fs::write(at("real/deep/a"), "").unwrap();
        symlink("../real", at("links/folder")).unwrap();
        symlink(at("links/folder/deep/a"), at("links/file")).unwrap();
        let mut places = Places::default();
        places.file(&at("links/file"));
        assert_eq!(places.folders, BTreeSet::from([at("links"), at("real/deep")]));
        assert_eq!(places.entries, BTreeSet::from([at("links/file"), at("links/folder"), at("real/deep/a")]));
        assert!(places.concern(&at("links/folder")) && !places.concern(&at("links/other")));
        // Nothing is there yet.
        let mut places = Places::default();
        places.file(&at("links/folder/none/b"));
        assert_eq!(places.folders, BTreeSet::from([at("links"), at("real")]));
        assert!(places.concern(&at("real/none")));
        // A loop leads nowhere.
        symlink("loop", at("loop")).unwrap();
        let mut places = Places::default();
        places.file(&at("loop/x"));
        assert_eq!(places.folders, BTreeSet::from([root.clone()]));
        let mut places = Places::default();
        places.folder(&at("links/folder/deep"));
        assert!(places.concern(&at("real/deep/anything")) && places.concern(&at("real/deep")));
        places.folder(&at("links/gone"));
        assert!(places.concern(&at("links/gone")));
    }

    #[test]
    fn remote_file_systems_are_known() {
        let mounts = "22 1 8:1 / / rw - ext4 /dev/sda1 rw\n\
                      30 22 0:40 / /home/a\\040b rw,nosuid shared:1 - nfs4 host:/home rw\n\
                      31 30 0:41 / /home/a\\040b/local rw - tmpfs tmpfs rw\n\
                      32 22 0:42 / /mnt rw - fuse.sshfs host: rw\n\
                      33 22 0:43 / /bound rw - fuse /home rw\n\
                      34 22 8:2 / /disk rw - fuseblk /dev/sda2 rw\n";
        let remote = |path: &str| is_remote(Path::new(path), mounts);
        assert!(remote("/home/a b/x/y") && remote("/mnt") && remote("/bound/x") && !remote("/disk"));
        assert!(!remote("/home/a b/local/x") && !remote("/home/other") && !remote("/mntx"));
    }
}
