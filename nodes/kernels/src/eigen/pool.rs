//! Memory of panels. Passes over them go run by run; see `basis`.

use super::EigenError;
use super::panel::{Row, Rows, WIDTH};
use super::spare::Spare;

/// Vertices per run: a panel of it is 8 KiB, a sixth of a first-level cache. Measured: 64 to 512 are the same on 10,000 vertices; on 1,093 the rows that
/// fill the last run up take a tenth of the time with 256.
pub(super) const RUN: usize = 128;

/// Panels that are allocated together, after those that stay.
const CHUNK: usize = 4;

/// Bytes that memory comes in.
const PAGE: usize = 4096;

/// A panel in runs.
pub(super) type Panel = [[Row; RUN]];

/// Memory of bases that are done with, for those to come: fresh pages are dear.
pub(super) struct Pool {
    runs: usize,
    /// Numbers before the first panel of a sequence: Ritz vectors that take its place become the result there, behind what it begins with.
    front: usize,
    /// The first panels of sequences, in one piece.
    firsts: Spare<Rows>,
    free: Spare<Rows>,
}

impl Pool {
    /// Panels of n rows, after so many columns that the result begins with.
    pub fn new(n: usize, columns: usize) -> Self {
        Self { runs: n.div_ceil(RUN), front: n * columns, firsts: Spare::new(), free: Spare::new() }
    }

    /// Touches memory for a sequence of at most so many panels as long as the caller wants more: the first touch of a
    /// page takes longer than most of what a step of Lanczos does with it, so that is better done while there is nothing else to do for a second thread.
    pub fn prepare(&self, place: Place, panels: usize, wanted: impl Fn() -> bool) -> Result<(), EigenError> {
        let mut prepared = Panels::new(self, place);
        while prepared.count() < panels && wanted() {
            prepared.grow()?;
            let (_, last) = prepared.split().unwrap_or_default();
            touch(last.as_flattened_mut());
        }
        Ok(())
    }

    /// Numbers before the first panel of a piece.
    pub fn front(&self) -> usize {
        self.front
    }

    /// Gives what is free back to the allocator.
    pub fn clear(&self) {
        self.firsts.clear();
        self.free.clear();
    }

    /// Room in one piece for so many panels, with any content.
    pub fn piece(&self, panels: usize) -> Result<Rows, EigenError> {
        let rows = panels * self.runs * RUN;
        let kept = self.firsts.take().filter(|kept| kept.as_slice().len() >= rows);
        kept.map_or_else(|| Rows::zeroed_after(self.front, rows), Ok)
    }

    /// New zeroed panels, touched: pages that are read before they are written cost two faults, and while another thread runs, an interrupt of its
    /// processor (25 us a page).
    pub fn panels(&self, count: usize) -> Result<Rows, EigenError> {
        let mut panels = self.untouched(count)?;
        touch(panels.as_mut_slice());
        Ok(panels)
    }

    fn untouched(&self, count: usize) -> Result<Rows, EigenError> {
        Rows::zeroed(count * self.runs * RUN)
    }

    /// Such panels, one by one.
    pub fn split<'p>(&self, rows: &'p Rows) -> Vec<&'p Panel> {
        runs(rows).chunks_exact(self.runs).collect()
    }

    pub fn split_mut<'p>(&self, rows: &'p mut Rows) -> Vec<&'p mut Panel> {
        runs_mut(rows).chunks_exact_mut(self.runs).collect()
    }

    /// More room for panels.
    fn chunk(&self) -> Result<Rows, EigenError> {
        self.free.take().map_or_else(|| self.untouched(CHUNK), Ok)
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

/// The piece of memory that the first panels of a sequence lie in.
#[derive(Clone, Copy)]
pub(super) struct Place {
    /// How many those are.
    pub panels: usize,
    /// How many there is room for: others may join them in the end.
    pub room: usize,
}

/// A growing sequence of panels, whose memory comes from a pool and goes back to it.
pub(super) struct Panels<'a> {
    /// The first one as the place says, whole ones after it.
    chunks: Vec<Rows>,
    count: usize,
    place: Place,
    pool: &'a Pool,
}

impl Drop for Panels<'_> {
    fn drop(&mut self) {
        self.give_back(0);
    }
}

impl<'a> Panels<'a> {
    pub fn new(pool: &'a Pool, place: Place) -> Self {
        Self { chunks: Vec::new(), count: 0, place, pool }
    }

    /// So many columns of n entries by row and column, in one piece.
    pub fn filled(
        pool: &'a Pool,
        n: usize,
        columns: usize,
        entry: impl Fn(usize, usize) -> f64,
    ) -> Result<Self, EigenError> {
        let count = columns.div_ceil(WIDTH);
        let mut panels = Self::new(pool, Place { panels: count, room: count });
        for p in 0..count {
            panels.grow()?;
            let Some((_, panel)) = panels.split() else { continue };
            for (i, row) in panel.as_flattened_mut().iter_mut().enumerate() {
                let inside = |j: usize| i < n && j < columns;
                *row = std::array::from_fn(|q| p * WIDTH + q).map(|j| if inside(j) { entry(i, j) } else { 0.0 });
            }
        }
        Ok(panels)
    }

    pub fn count(&self) -> usize {
        self.count
    }

    /// Panels that so many chunks hold.
    fn capacity(&self, chunks: usize) -> usize {
        chunks.checked_sub(1).map_or(0, |others| self.place.panels + others * CHUNK)
    }

    /// Adds a panel with any content.
    pub fn grow(&mut self) -> Result<(), EigenError> {
        if self.chunks.is_empty() {
            self.chunks.push(self.pool.piece(self.place.room)?);
        }
        if self.count == self.capacity(self.chunks.len()) {
            self.chunks.push(self.pool.chunk()?);
        }
        self.count += 1;
        Ok(())
    }

    pub fn all(&self) -> Vec<&Panel> {
        let mut chunks = self.chunks.iter().map(|chunk| self.pool.split(chunk).into_iter());
        let first = chunks.next().into_iter().flatten().take(self.place.panels);
        first.chain(chunks.flatten()).take(self.count).collect()
    }

    pub fn all_mut(&mut self) -> Vec<&mut Panel> {
        let mut chunks = self.chunks.iter_mut().map(|chunk| self.pool.split_mut(chunk).into_iter());
        let first = chunks.next().into_iter().flatten().take(self.place.panels);
        first.chain(chunks.flatten()).take(self.count).collect()
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
        let used = (0..self.chunks.len()).take_while(|&before| self.capacity(before) < self.count).count();
        self.give_back(used);
    }

    /// Gives chunks from this one on back; what comes first is taken up again first.
    fn give_back(&mut self, from: usize) {
        for chunk in self.chunks.drain(from.max(1).min(self.chunks.len())..).rev() {
            self.pool.free.give(chunk);
        }
        if from == 0 {
            self.chunks.drain(..).for_each(|chunk| self.pool.firsts.give(chunk));
        }
    }

    /// All panels in one piece with room for so many: where they are, if there is that much.
    pub fn into_piece(mut self, room: usize) -> Result<Rows, EigenError> {
        self.truncate(self.count);
        if let [only] = self.chunks.as_slice()
            && self.pool.split(only).len() >= room.max(self.count)
        {
            return Ok(self.chunks.remove(0));
        }
        let mut piece = self.pool.piece(room)?;
        for (target, panel) in self.pool.split_mut(&mut piece).into_iter().zip(self.all()) {
            target.copy_from_slice(panel);
        }
        Ok(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 3 * RUN - 5;

    fn grown(pool: &Pool, first: usize, room: usize, count: usize) -> Panels<'_> {
        let mut panels = Panels::new(pool, Place { panels: first, room });
        for p in 0..count {
            panels.grow().expect("small");
            let (_, last) = panels.split().expect("not empty");
            last.as_flattened_mut().as_flattened_mut().fill(p as f64);
        }
        panels
    }

    fn hold(panels: &[&Panel], count: usize) -> bool {
        let constant = |(p, panel): (usize, &&Panel)| {
            panel.as_flattened().as_flattened().iter().all(|x| x.to_bits() == (p as f64).to_bits())
        };
        panels.len() == count && panels.iter().enumerate().all(constant)
    }

    #[test]
    fn panels_keep_what_they_hold_and_memory_goes_round() {
        let pool = Pool::new(N, 2);
        let mut panels = grown(&pool, 3, 5, 3 + 2 * CHUNK);
        assert!(hold(&panels.all(), 3 + 2 * CHUNK));
        panels.truncate(4);
        assert!(hold(&panels.all(), 4) && panels.chunks.len() == 2);
        // A second sequence takes up what the first gave back.
        let second = grown(&pool, 2, 2, 2 * CHUNK);
        assert!(hold(&second.all(), 2 * CHUNK) && hold(&panels.all(), 4));
        assert!(pool.free.take().is_none());
        drop((second, panels));
        assert!(pool.firsts.take().is_some() && pool.free.take().is_some());
    }

    #[test]
    fn a_piece_is_where_the_panels_were_or_a_larger_one() {
        let pool = Pool::new(N, 2);
        // Panels that begin in one piece, room there, panels in all, room that is wanted.
        for (first, room, count, wanted) in
            [(5, 5, 4, 5), (5, 5, 4, 6), (5, 9, 4, 6), (3, 3, 4, 4), (3, 9, 4, 4), (3, 3, 4, 9), (2, 2, 0, 1)]
        {
            let panels = grown(&pool, first, room, count);
            let at = panels.all().first().map(|panel| panel.as_ptr());
            let mut piece = panels.into_piece(wanted).expect("small");
            let all = pool.split(&piece);
            assert!(all.len() >= wanted && hold(&all[..count], count));
            assert_eq!(at == Some(all[0].as_ptr()), count > 0 && first >= count && room >= wanted);
            assert!(piece.memory_mut().len() >= 2 * N + wanted * 3 * RUN * size_of::<Row>() / size_of::<f64>());
        }
    }
}
