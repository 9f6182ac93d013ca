//! Vectors of slices that are done, in memory or, while there is not enough of it for those and a basis too, in files.

use super::panel::Rows;
use super::parts::{collect, locked};
use super::pool::{Panel, Panels, Pool};
use super::{EigenError, Hooks};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Each has a part of every panel: a file system lets one thread at a time write to a file. Measured at 172,962 vertices and 300 pairs on two threads, where all
/// takes 6 s: 0.6 s for a single file.
const FILES: usize = 2;

/// Files for panels, written and read by one caller after the other.
pub(super) struct Scratch<'a> {
    files: [File; FILES],
    /// Panels in each.
    count: AtomicUsize,
    hooks: &'a dyn Hooks,
}

/// Panels of a slice.
pub(super) enum Kept<'a> {
    Here(Panels<'a>),
    Away { scratch: &'a Scratch<'a>, begin: usize, count: usize },
}

impl<'a> Scratch<'a> {
    /// In files of the hooks, if they have any.
    pub fn new(hooks: &'a dyn Hooks) -> Result<Option<Self>, EigenError> {
        let file = || hooks.scratch().map_err(|e| EigenError::scratch(&e));
        let (Some(first), Some(second)) = (file()?, file()?) else { return Ok(None) };
        Ok(Some(Self { files: [first, second], count: AtomicUsize::new(0), hooks }))
    }

    /// Writes panels to the files.
    pub fn put(&self, panels: &Panels<'_>) -> Result<Kept<'_>, EigenError> {
        let all = panels.all();
        let begin = self.count.fetch_add(all.len(), Ordering::Relaxed);
        let parts = all.iter().map(|panel| panel.chunks(share(panel)));
        self.each(begin, parts, |mut file, part| {
            file.write_all(bytemuck::cast_slice(part.as_flattened().as_flattened()))
        })?;
        Ok(Kept::Away { scratch: self, begin, count: all.len() })
    }

    fn get(&self, begin: usize, panels: Vec<&mut Panel>) -> Result<(), EigenError> {
        let parts = panels.into_iter().map(|panel| panel.chunks_mut(share(panel)));
        let read = |mut file: &File, part: &mut Panel| {
            file.read_exact(bytemuck::cast_slice_mut(part.as_flattened_mut().as_flattened_mut()))
        };
        self.each(begin, parts, read)
    }

    /// Goes through the files side by side, from so many panels on, with the parts that each has.
    fn each<P: AsRef<Panel> + Send>(
        &self,
        begin: usize,
        panels: impl Iterator<Item = impl Iterator<Item = P>>,
        step: impl Fn(&File, P) -> io::Result<()> + Sync,
    ) -> Result<(), EigenError> {
        let mut parts: [Vec<P>; FILES] = std::array::from_fn(|_| Vec::new());
        for panel in panels {
            parts.iter_mut().zip(panel).for_each(|(parts, part)| parts.push(part));
        }
        let parts = parts.map(Mutex::new);
        let done = collect(self.hooks, FILES, &|i| {
            let (mut file, parts) = (&self.files[i], std::mem::take(&mut *locked(&parts[i])));
            let bytes = parts.first().map_or(0, |part| size_of_val(part.as_ref()));
            file.seek(SeekFrom::Start((begin * bytes) as u64))?;
            parts.into_iter().try_for_each(|part| step(file, part))
        })?;
        done.into_iter().collect::<io::Result<()>>().map_err(|e| EigenError::scratch(&e))
    }
}

/// Runs of a panel in each file but the last.
fn share(panel: &Panel) -> usize {
    panel.len().div_ceil(FILES).max(1)
}

impl Kept<'_> {
    pub fn count(&self) -> usize {
        match self {
            Self::Here(panels) => panels.count(),
            Self::Away { count, .. } => *count,
        }
    }

    /// All panels, the first of a piece with room for so many: where they are, if there is that much.
    pub fn into_piece(self, pool: &Pool, room: usize) -> Result<Rows, EigenError> {
        if let Self::Here(panels) = self {
            return panels.into_piece(room);
        }
        let (count, mut piece) = (self.count(), pool.piece(room)?);
        self.fetch(pool.split_mut(&mut piece).into_iter().take(count).collect())?;
        Ok(piece)
    }

    /// Copies the panels to these, of which there are as many.
    pub fn fetch(self, targets: Vec<&mut Panel>) -> Result<(), EigenError> {
        match self {
            Self::Here(panels) => {
                targets.into_iter().zip(panels.all()).for_each(|(target, panel)| target.copy_from_slice(panel));
                Ok(())
            }
            Self::Away { scratch, begin, .. } => scratch.get(begin, targets),
        }
    }
}
