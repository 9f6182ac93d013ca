//! How many slices the wanted pairs are found in, and how many pairs each finds.

use super::Options;
use super::lanczos::{FROM_BOTTOM, Growth, WINDOW, expected_blocks};
use super::panel::WIDTH;
use super::pool::Place;

/// Pairs of a slice. More slices save as much orthogonalisation and projected problem as they cost solves and factorisations, need less memory for bases, and
/// can run side by side. Measured at 1,093 to 190,000 vertices: 100 to 160 pairs are within 5 % of each other; one slice of 100 is faster than two.
const SLICE_PAIRS: usize = 140;

/// About the same if memory is short: bases shall be smaller than the result.
const FRUGAL_PAIRS: usize = 75;

/// Panels that a slice may find beyond what it is expected to.
const SPARE_PANELS: usize = 2;

/// Slices by the numbers of vertices and pairs alone.
#[derive(Clone, Copy)]
pub(super) struct Slicing {
    wanted: usize,
    count: usize,
    /// Whether vectors of slices that are done leave memory.
    pub is_frugal: bool,
}

impl Slicing {
    pub fn new(n: usize, wanted: usize, options: &Options) -> Self {
        let large = n.saturating_mul(wanted) > options.in_memory;
        let frugal = (wanted + FRUGAL_PAIRS / 2) / FRUGAL_PAIRS;
        let count = if large { frugal } else { wanted / SLICE_PAIRS }.max(1);
        Self { wanted, count, is_frugal: large && count > 1 }
    }

    pub fn count(self) -> usize {
        self.count
    }

    /// About how many pairs a slice finds: as many as others, or if memory is short so many that all take bases of the same size. The lowest one finds more
    /// with as large a basis, because it ends where the spectrum does; but as the last of several in memory it had better be small.
    pub fn pairs(self, slice: usize) -> f64 {
        let (wanted, others) = (self.wanted as f64, (self.count - 1) as f64);
        let Growth { slope, start } = FROM_BOTTOM;
        let upper = if self.is_frugal {
            (slope * wanted + start - WINDOW.start) / (slope * others + WINDOW.slope)
        } else {
            wanted / self.count as f64
        };
        if slice == 0 { wanted - others * upper } else { upper }
    }

    /// Blocks that it is expected to take.
    pub fn blocks(self, slice: usize) -> usize {
        expected_blocks(self.pairs(slice) as usize, slice == 0)
    }

    /// Where the first panels of its basis lie, which its vectors replace. The others' vectors join those of the lowest.
    pub fn place(self, slice: usize) -> Place {
        let own = |slice: usize| (self.pairs(slice) as usize).div_ceil(WIDTH) + SPARE_PANELS;
        let panels = own(slice);
        Place { panels, room: if slice == 0 { (0..self.count).map(own).sum() } else { panels } }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_share_all_pairs_and_frugal_ones_need_bases_of_the_same_size() {
        for (n, wanted, count, is_frugal) in [
            (5_000, 0, 1, false),
            (5_000, 99, 1, false),
            (10_000, 299, 2, false),
            (172_962, 299, 4, true),
            (200_000, 99, 1, false),
            (172_962, 999, 13, true),
        ] {
            let slicing = Slicing::new(n, wanted, &Options::default());
            assert_eq!((slicing.count(), slicing.is_frugal), (count, is_frugal));
            let pairs: f64 = (0..count).map(|slice| slicing.pairs(slice)).sum();
            assert!((pairs - wanted as f64).abs() < 1e-9);
            assert!(!is_frugal || (0..count).all(|slice| slicing.blocks(slice).abs_diff(slicing.blocks(0)) <= 1));
            assert!(slicing.place(0).room * WIDTH >= wanted);
        }
    }
}
