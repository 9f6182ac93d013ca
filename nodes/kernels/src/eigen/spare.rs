//! Memory that is used again: pages touched for the first time are dear.

use std::sync::{Mutex, PoisonError};

/// Vectors that are done with, for any thread to take up again.
pub(super) struct Spare<T>(Mutex<Vec<Vec<T>>>);

impl<T: Copy + Default> Spare<T> {
    pub fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// A vector of this length with any content.
    pub fn take(&self, len: usize) -> Vec<T> {
        let spare = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let Some(mut memory) = spare else { return vec![T::default(); len] };
        memory.resize(len, T::default());
        memory
    }

    pub fn give(&self, memory: Vec<T>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
    }
}
