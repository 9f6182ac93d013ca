//! Memory kept from one patch to the next: a page touched for the first time costs more than what is computed in it.

use super::factor::Factor;
use crate::multifrontal::Fronts;
use std::cell::Cell;

/// More than this many numbers are given back at once.
const KEPT: usize = 8 << 20;

/// The C library of Linux gives freed memory back to the system beyond twice the size of the largest block that it has seen freed. One of so
/// many bytes, never written to, makes it keep what the steps of a patch allocate for the next patch.
const LARGE_BLOCK: usize = 8 << 20;

/// What the solver of a patch writes into. What is in it from before has no meaning.
#[derive(Default)]
pub(super) struct Memory {
    pub fronts: Fronts,
    /// By problem.
    pub factors: [Factor; 2],
    pub bases: [Vec<f64>; 2],
}

thread_local! {
    static MEMORY: Cell<Option<Box<Memory>>> = const { Cell::new(None) };
}

impl Memory {
    fn size(&self) -> usize {
        let factors = self.factors.iter().map(Factor::capacity);
        factors.chain(self.bases.iter().map(Vec::capacity)).sum::<usize>() + self.fronts.capacity()
    }
}

/// Runs `f` with this thread's memory.
pub(super) fn with<T>(f: impl FnOnce(&mut Memory) -> T) -> T {
    let mut memory = MEMORY.take().unwrap_or_else(|| {
        drop(std::hint::black_box(Vec::<u8>::with_capacity(LARGE_BLOCK)));
        Box::default()
    });
    let result = f(&mut memory);
    if memory.size() <= KEPT {
        MEMORY.set(Some(memory));
    }
    result
}
