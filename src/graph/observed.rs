//! What planning looked at: graph files, folders, and whether input files are there.
//!
//! A plan (or what is wrong with a graph) follows from these and from the arguments alone. So a plan need
//! not be made again while looking again finds the same.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::axes::{Found, listed_folders, look};
use super::file::bytes;

/// All that a plan was made from, besides the arguments.
#[derive(Clone, Debug, Default)]
pub struct Observed {
    /// The graph files, and what they held; `None` for what could not be read.
    pub(super) texts: BTreeMap<PathBuf, Option<Vec<u8>>>,
    /// What patterns of files matched.
    pub(super) globs: Found,
    /// Whether each input file was there.
    pub(super) files: BTreeMap<PathBuf, bool>,
}

/// Something that is not as it was when the plan was made.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Difference {
    /// A graph file holds something else, has come or has gone.
    Graph(PathBuf),
    /// A file is there that was not.
    Added(PathBuf),
    /// A file is gone that was there.
    Removed(PathBuf),
    /// A folder can be listed no more, or again.
    Folder(PathBuf),
}

impl Difference {
    /// The file or folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Graph(path) | Self::Added(path) | Self::Removed(path) | Self::Folder(path) => path,
        }
    }
}

impl Observed {
    /// Looks again and says what is different, in order and without repetition.
    #[must_use]
    pub fn differences(&self) -> Vec<Difference> {
        let mut all = BTreeSet::new();
        for (path, before) in &self.texts {
            if bytes(path).ok() != *before {
                all.insert(Difference::Graph(path.clone()));
            }
        }
        for (path, before) in &self.files {
            match (*before, path.is_file()) {
                (false, true) => drop(all.insert(Difference::Added(path.clone()))),
                (true, false) => drop(all.insert(Difference::Removed(path.clone()))),
                _ => {}
            }
        }
        for ((dir, pattern), before) in &self.globs {
            match (before, &look(dir, pattern)) {
                (Ok(before), Ok(now)) if before != now => {
                    let (before, now): (BTreeSet<_>, BTreeSet<_>) = (before.iter().collect(), now.iter().collect());
                    all.extend(now.difference(&before).map(|path| Difference::Added(dir.join(path))));
                    all.extend(before.difference(&now).map(|path| Difference::Removed(dir.join(path))));
                }
                (Ok(_), Ok(_)) => {}
                (before, now) if before == now => {}
                _ => drop(all.insert(Difference::Folder(dir.clone()))),
            }
        }
        all.into_iter().collect()
    }

    /// The files that were looked at, there or not.
    pub fn files(&self) -> impl Iterator<Item = &Path> {
        self.texts.keys().chain(self.files.keys()).map(PathBuf::as_path)
    }

    /// The folders that are listed for patterns of files, as they are now: new ones appear as folders do.
    #[must_use]
    pub fn folders(&self) -> BTreeSet<PathBuf> {
        self.globs.keys().flat_map(|(dir, pattern)| listed_folders(dir, pattern)).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::graph::{Overrides, plan_observed};
    use salient_sdk::Registry;

    #[test]
    fn looking_again_finds_what_is_different() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("in/x")).unwrap();
        fs::write(at("in/x/a.off"), "").unwrap();
        fs::write(at("g.ron"), "(format: 1, over: {\"s\": files(\"in/*/*.off\", \"more/*.off\")}, nodes: {").unwrap();
        let registry = Registry::new(&[]).unwrap();
        let observe = || plan_observed(&at("g.ron"), &Overrides::default(), &registry).1;
        // A file that does not parse is watched too.
        let broken = observe();
        assert_eq!(broken.differences(), []);
        fs::write(at("g.ron"), "(format: 1, over: {\"s\": files(\"in/*/*.off\")}, nodes: {}, show: [])").unwrap();
        assert_eq!(broken.differences(), [Difference::Graph(at("g.ron"))]);
        let before = observe();
        assert_eq!(before.folders(), BTreeSet::from([at("in"), at("in/x")]));
        fs::create_dir(at("in/y")).unwrap();
        assert_eq!(before.differences(), []);
        assert!(before.folders().contains(&at("in/y")));
        fs::write(at("in/y/b.off"), "").unwrap();
        fs::remove_file(at("in/x/a.off")).unwrap();
        let expected = [Difference::Added(at("in/y/b.off")), Difference::Removed(at("in/x/a.off"))];
        assert_eq!(before.differences(), expected);
        fs::remove_dir_all(at("in")).unwrap();
        assert_eq!(before.folders(), BTreeSet::from([at("in")]));
        fs::remove_file(at("g.ron")).unwrap();
        assert_eq!(before.differences()[0], Difference::Graph(at("g.ron")));
    }
}
