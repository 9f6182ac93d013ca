//! Vectors of slices that are done, in memory or, while there is not enough of it for those and a basis too, in a file.

use super::EigenError;
use super::panel::Rows;
use super::pool::{Panel, Panels, Pool};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::atomic::{AtomicU64, Ordering};

/// A file for panels, written by one thread after the other.
pub(super) struct Scratch {
    file: File,
    end: AtomicU64,
}

/// Panels of a slice.
pub(super) enum Kept<'a> {
    Here(Panels<'a>),
    Away { scratch: &'a Scratch, begin: u64, count: usize },
}

impl Scratch {
    pub fn new(file: File) -> Self {
        Self { file, end: AtomicU64::new(0) }
    }

    /// Writes panels to the file.
    pub fn put(&self, panels: &Panels<'_>) -> Result<Kept<'_>, EigenError> {
        let all = panels.all();
        let begin = self.end.load(Ordering::Relaxed);
        let bytes = self.write(begin, &all).map_err(|e| EigenError::scratch(&e))?;
        self.end.store(begin + bytes, Ordering::Relaxed);
        Ok(Kept::Away { scratch: self, begin, count: all.len() })
    }

    fn write(&self, begin: u64, panels: &[&Panel]) -> io::Result<u64> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(begin))?;
        let mut written = 0;
        for panel in panels {
            let bytes: &[u8] = bytemuck::cast_slice(panel.as_flattened().as_flattened());
            file.write_all(bytes)?;
            written += bytes.len() as u64;
        }
        Ok(written)
    }

    fn read(&self, begin: u64, panels: Vec<&mut Panel>) -> io::Result<()> {
        let mut file = &self.file;
        file.seek(SeekFrom::Start(begin))?;
        let numbers = panels.into_iter().map(|panel| panel.as_flattened_mut().as_flattened_mut());
        numbers.map(bytemuck::cast_slice_mut).try_for_each(|bytes: &mut [u8]| file.read_exact(bytes))
    }
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
            Self::Away { scratch, begin, .. } => scratch.read(begin, targets).map_err(|e| EigenError::scratch(&e)),
        }
    }
}
