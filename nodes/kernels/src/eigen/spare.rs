//! Memory that is used again: pages touched for the first time are dear.

use std::sync::{Mutex, PoisonError};

/// Memory that is done with, for any thread to take up again.
pub(super) struct Spare<T>(Mutex<Vec<T>>);

impl<T> Spare<T> {
    pub fn new() -> Self {
        Self(Mutex::new(Vec::new()))
    }

    /// Memory with any content, if there is any.
    pub fn take(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop()
    }

    pub fn give(&self, memory: T) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(memory);
    }

    /// Gives all of it back to the system.
    pub fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}
