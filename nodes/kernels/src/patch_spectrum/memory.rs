//! Memory kept from one patch to the next: a page touched for the first time costs more than what is computed in it.

use super::factor::Factor;
use crate::freed;
use crate::multifrontal::Fronts;
use std::cell::Cell;

/// More than this many numbers are given back at once.
const KEPT: usize = 8 << 20;

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
        freed::keep();
        Box::default()
    });
    let result = f(&mut memory);
    if memory.size() <= KEPT {
        MEMORY.set(Some(memory));
    }
    result
}
