//! Memory of panels. Passes over them go run by run; see `basis`.

use super::EigenError;
use super::panel::{Row, Rows, WIDTH, aligned, aligned_mut};
use super::spare::Spare;
use std::slice::{ChunksExact, ChunksExactMut};

/// Vertices per run: a panel of it is 8 KiB, a sixth of a first-level cache. Measured: 64 to 512 are the same on 10,000 vertices; on 1,093 the rows that
/// fill the last run up take a tenth of the time with 256.
pub(super) const RUN: usize = 128;

/// Panels that are allocated together, after those that stay.
const CHUNK: usize = 4;

/// Bytes that memory comes in.
const PAGE: usize = 4096;

/// A panel in runs.
pub(super) type Panel = [[Row; RUN]];

/// Memory of bases that are done with, for those to come, and memory that is lent to them: fresh pages are dear.
pub(super) struct Pool {
    runs: usize,
    free: Spare<Rows>,
    lent: Spare<Vec<f64>>,
    /// Panels of a basis that Ritz vectors will replace; those after them may lie in lent memory.
    staying: usize,
}

impl Pool {
    /// Panels of n rows for bases of which about so many vectors will stay.
    pub fn new(n: usize, staying: usize) -> Self {
        let (free, lent) = (Spare::new(), Spare::new());
        Self { runs: n.div_ceil(RUN), free, lent, staying: staying.div_ceil(WIDTH) }
    }

    /// Lends memory that is needed only when bases are gone, with any content.
    pub fn lend(&self, memory: Vec<f64>) {
        self.lent.give(memory);
    }

    /// What was lent, if no panel is in it any more.
    pub fn take_back(&self) -> Option<Vec<f64>> {
        self.lent.take()
    }

    /// Touches memory for a sequence of at most so many panels, as long as the caller wants more: the first touch of a page takes longer than most of what
    /// a step of Lanczos does with it, so that is better done while there is nothing else to do for a second thread.
    pub fn prepare(&self, panels: usize, wanted: impl Fn() -> bool) -> Result<(), EigenError> {
        let mut prepared = Panels::new(self);
        while prepared.count() < panels && wanted() {
            prepared.grow()?;
            let (_, last) = prepared.split().unwrap_or_default();
            touch(last.as_flattened_mut());
        }
        Ok(())
    }

    /// Gives what is free back to the allocator.
    pub fn clear(&self) {
        self.free.clear();
    }

    /// New zeroed panels, touched: pages that are read before they are written cost two faults, and while another thread runs, an interrupt of its
    /// processor (25 us a page).
    pub fn panels(&self, count: usize) -> Result<Rows, EigenError> {
        let mut panels = self.untouched(count)?;
        touch(panels.as_mut_slice());
        Ok(panels)
    }

    fn untouched(&self, count: usize) -> Result<Rows, EigenError> {
        Rows::zeroed(count * self.runs * RUN).map_err(|_| EigenError::Memory)
    }

    /// Such panels, one by one.
    pub fn split<'p>(&self, rows: &'p Rows) -> Vec<&'p Panel> {
        runs(rows).chunks_exact(self.runs).collect()
    }

    pub fn split_mut<'p>(&self, rows: &'p mut Rows) -> Vec<&'p mut Panel> {
        runs_mut(rows).chunks_exact_mut(self.runs).collect()
    }

    /// More room for a sequence of so many panels.
    fn chunk(&self, count: usize) -> Result<Chunk, EigenError> {
        if count >= self.staying
            && let Some(memory) = self.lent.take()
        {
            return Ok(Chunk::Lent(memory));
        }
        self.own_chunk(if count == 0 { self.staying.max(1) } else { CHUNK })
    }

    fn own_chunk(&self, panels: usize) -> Result<Chunk, EigenError> {
        let free = self.free.take();
        Ok(Chunk::Own(free.map_or_else(|| self.untouched(panels), Ok)?))
    }

    fn give_back(&self, chunks: impl IntoIterator<Item = Chunk>) {
        for chunk in chunks {
            match chunk {
                Chunk::Own(rows) => self.free.give(rows),
                Chunk::Lent(memory) => self.lent.give(memory),
            }
        }
    }
}

/// Some panels, one after the other.
enum Chunk {
    Own(Rows),
    Lent(Vec<f64>),
}

impl Chunk {
    fn panels(&self, runs: usize) -> ChunksExact<'_, [Row; RUN]> {
        let rows = match self {
            Self::Own(rows) => rows.as_slice(),
            Self::Lent(memory) => aligned(memory),
        };
        rows.as_chunks().0.chunks_exact(runs)
    }

    fn panels_mut(&mut self, runs: usize) -> ChunksExactMut<'_, [Row; RUN]> {
        let rows = match self {
            Self::Own(rows) => rows.as_mut_slice(),
            Self::Lent(memory) => aligned_mut(memory),
        };
        rows.as_chunks_mut().0.chunks_exact_mut(runs)
    }
}

/// Writes to every page.
fn touch(rows: &mut [Row]) {
    rows.iter_mut().step_by(PAGE / size_of::<Row>()).for_each(|row| row[0] = 0.0);
}

pub(super) fn runs(rows: &Rows) -> &Panel {
    rows.as_slice().as_chunks().0
}

pub(super) fn runs_mut(rows: &mut Rows) -> &mut Panel {
    rows.as_mut_slice().as_chunks_mut().0
}

/// A growing sequence of panels, whose memory comes from a pool and goes back to it.
pub(super) struct Panels<'a> {
    chunks: Vec<Chunk>,
    count: usize,
    pool: &'a Pool,
}

impl Drop for Panels<'_> {
    fn drop(&mut self) {
        // What comes first is taken up again first.
        self.pool.give_back(self.chunks.drain(..).rev());
    }
}

impl<'a> Panels<'a> {
    pub fn new(pool: &'a Pool) -> Self {
        Self { chunks: Vec::new(), count: 0, pool }
    }

    pub fn count(&self) -> usize {
        self.count
    }

    fn capacity(&self) -> usize {
        self.chunks.iter().map(|chunk| chunk.panels(self.pool.runs).len()).sum()
    }

    /// Adds a panel with any content.
    pub fn grow(&mut self) -> Result<(), EigenError> {
        while self.count == self.capacity() {
            self.chunks.push(self.pool.chunk(self.count)?);
        }
        self.count += 1;
        Ok(())
    }

    pub fn all(&self) -> Vec<&Panel> {
        let panels = self.chunks.iter().flat_map(|chunk| chunk.panels(self.pool.runs));
        panels.take(self.count).collect()
    }

    pub fn all_mut(&mut self) -> Vec<&mut Panel> {
        let panels = self.chunks.iter_mut().flat_map(|chunk| chunk.panels_mut(self.pool.runs));
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
        while let Some(chunk) = self.chunks.pop() {
            if self.capacity() < self.count {
                self.chunks.push(chunk);
                break;
            }
            self.pool.give_back([chunk]);
        }
    }

    /// Gives the memory back to the allocator.
    pub fn release(mut self) {
        self.chunks.clear();
    }

    /// Moves panels out of lent memory.
    pub fn settle(mut self) -> Result<Self, EigenError> {
        let own = self.chunks.iter().position(|chunk| matches!(chunk, Chunk::Lent(_)));
        let rest = self.chunks.split_off(own.unwrap_or(self.chunks.len()));
        let left = self.count.saturating_sub(self.capacity());
        self.count -= left;
        for panel in rest.iter().flat_map(|chunk| chunk.panels(self.pool.runs)).take(left) {
            if self.count == self.capacity() {
                self.chunks.push(self.pool.own_chunk(CHUNK)?);
            }
            self.count += 1;
            if let Some((_, target)) = self.split() {
                target.copy_from_slice(panel);
            }
        }
        self.pool.give_back(rest);
        Ok(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 3 * RUN - 5;

    fn grown(pool: &Pool, count: usize) -> Panels<'_> {
        let mut panels = Panels::new(pool);
        for p in 0..count {
            panels.grow().expect("small");
            let (_, last) = panels.split().expect("not empty");
            last.as_flattened_mut().as_flattened_mut().fill(p as f64);
        }
        panels
    }

    /// Whether the lent memory is in no panel's use.
    fn is_at_hand(pool: &Pool) -> bool {
        let memory = pool.take_back();
        memory.map(|memory| pool.lend(memory)).is_some()
    }

    fn hold(panels: &Panels<'_>, count: usize) -> bool {
        let all = panels.all();
        let constant = |(p, panel): (usize, &&Panel)| {
            panel.as_flattened().as_flattened().iter().all(|x| x.to_bits() == (p as f64).to_bits())
        };
        all.len() == count && all.iter().enumerate().all(constant)
    }

    #[test]
    fn panels_keep_what_they_hold_in_own_and_in_lent_memory() {
        let pool = Pool::new(N, CHUNK * WIDTH);
        // Room for five panels and a bit.
        pool.lend(vec![-1.0; 5 * 3 * RUN * WIDTH + 40]);
        {
            let mut panels = grown(&pool, 3 * CHUNK);
            assert!(hold(&panels, 3 * CHUNK) && !is_at_hand(&pool));
            panels.truncate(CHUNK + 1);
            let panels = panels.settle().expect("small");
            assert!(hold(&panels, CHUNK + 1) && is_at_hand(&pool));
            // A second sequence takes up what the first gave back.
            let mut second = grown(&pool, 2 * CHUNK);
            assert!(hold(&second, 2 * CHUNK) && hold(&panels, CHUNK + 1) && !is_at_hand(&pool));
            second.truncate(CHUNK);
            assert!(hold(&second, CHUNK) && is_at_hand(&pool));
        }
        assert_eq!(pool.take_back().map(|memory| memory.len()), Some(5 * 3 * RUN * WIDTH + 40));
        assert!(pool.take_back().is_none());
    }

    #[test]
    fn lent_memory_that_is_too_small_for_a_panel_does_no_harm() {
        let pool = Pool::new(N, 0);
        pool.lend(vec![0.0; 7]);
        assert!(hold(&grown(&pool, CHUNK + 2), CHUNK + 2));
        assert!(pool.take_back().is_some());
    }
}
