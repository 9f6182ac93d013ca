//! Memory of panels. Passes over them go run by run; see `basis`.

use super::EigenError;
use super::panel::{Row, Rows};
use std::sync::{Mutex, PoisonError};

/// Vertices per run: a panel of it is 16 KiB, a third of a first-level cache.
pub(super) const RUN: usize = 256;

/// Panels that are allocated together.
const CHUNK: usize = 8;

/// A panel in runs.
pub(super) type Panel = [[Row; RUN]];

/// Memory of bases that are done with, for those to come: fresh pages are dear.
pub(super) struct Pool {
    runs: usize,
    free: Mutex<Vec<Rows>>,
}

impl Pool {
    pub fn new(n: usize) -> Self {
        Self { runs: n.div_ceil(RUN), free: Mutex::new(Vec::new()) }
    }

    /// Gives what is free back to the system.
    pub fn clear(&self) {
        self.free.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// New zeroed panels.
    pub fn panels(&self, count: usize) -> Result<Rows, EigenError> {
        Rows::zeroed(count * self.runs * RUN).map_err(|_| EigenError::Memory)
    }
}

pub(super) fn runs(rows: &Rows) -> &Panel {
    rows.as_slice().as_chunks().0
}

pub(super) fn runs_mut(rows: &mut Rows) -> &mut Panel {
    rows.as_mut_slice().as_chunks_mut().0
}

/// A growing sequence of panels, whose memory comes from a pool and goes back to it.
pub(super) struct Panels<'a> {
    chunks: Vec<Rows>,
    count: usize,
    pool: &'a Pool,
}

impl Drop for Panels<'_> {
    fn drop(&mut self) {
        self.pool.free.lock().unwrap_or_else(PoisonError::into_inner).append(&mut self.chunks);
    }
}

impl<'a> Panels<'a> {
    pub fn new(pool: &'a Pool) -> Self {
        Self { chunks: Vec::new(), count: 0, pool }
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Adds a panel with any content.
    pub fn grow(&mut self) -> Result<(), EigenError> {
        if self.count == self.chunks.len() * CHUNK {
            let free = self.pool.free.lock().unwrap_or_else(PoisonError::into_inner).pop();
            self.chunks.push(free.map_or_else(|| self.pool.panels(CHUNK), Ok)?);
        }
        self.count += 1;
        Ok(())
    }

    pub fn all(&self) -> Vec<&Panel> {
        let panels = self.chunks.iter().flat_map(|chunk| runs(chunk).chunks_exact(self.pool.runs));
        panels.take(self.count).collect()
    }

    pub fn all_mut(&mut self) -> Vec<&mut Panel> {
        let panels = self.chunks.iter_mut().flat_map(|chunk| runs_mut(chunk).chunks_exact_mut(self.pool.runs));
        panels.take(self.count).collect()
    }

    /// The last two, the last one first.
    pub fn newest(&self) -> Vec<&Panel> {
        let mut newest = self.all().split_off(self.count.saturating_sub(2));
        newest.reverse();
        newest
    }

    /// All but the last, and the last.
    pub fn split(&mut self) -> Option<(Vec<&Panel>, &mut Panel)> {
        let mut all = self.all_mut();
        let last = all.pop()?;
        Some((all.into_iter().map(|panel| &*panel).collect(), last))
    }

    /// Gives all but the first panels back.
    pub fn truncate(&mut self, count: usize) {
        self.count = self.count.min(count);
        let mut rest = self.chunks.split_off(self.count.div_ceil(CHUNK));
        self.pool.free.lock().unwrap_or_else(PoisonError::into_inner).append(&mut rest);
    }
}
