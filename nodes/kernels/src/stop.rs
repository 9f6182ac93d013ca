//! Long computations that can be told to end early.

use std::cell::Cell;

/// Asked now and then by a long computation. Once it says true it must go on doing so. What the computation then returns is an error, or
/// incomplete and to be thrown away: a caller asks again before it uses a result.
pub type Stop<'a> = &'a dyn Fn() -> bool;

/// For callers that never stop.
pub const NEVER: Stop<'static> = &|| false;

/// Asks once in some units of work, so that asking costs nothing.
pub(crate) struct Pace<'a> {
    stop: Stop<'a>,
    every: u32,
    left: Cell<u32>,
    stopped: Cell<bool>,
}

impl<'a> Pace<'a> {
    pub fn new(stop: Stop<'a>, every: u32) -> Self {
        Self { stop, every, left: Cell::new(0), stopped: Cell::new(false) }
    }

    /// Asks now: before or after a stretch that has no units.
    pub fn ends_now(&self) -> bool {
        self.left.set(0);
        self.ends()
    }

    /// Counts a unit of work; true once all is to end.
    pub fn ends(&self) -> bool {
        if self.left.get() > 0 {
            self.left.set(self.left.get() - 1);
        } else if !self.stopped.get() {
            self.left.set(self.every - 1);
            self.stopped.set((self.stop)());
        }
        self.stopped.get()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asks_once_in_a_while_and_never_again_after_a_yes() {
        let asked = Cell::new(0);
        let stop = || {
            asked.set(asked.get() + 1);
            asked.get() == 3
        };
        let pace = Pace::new(&stop, 10);
        let ends: Vec<bool> = (0..100).map(|_| pace.ends()).collect();
        assert_eq!(ends.iter().position(|e| *e), Some(20));
        assert!(ends[20..].iter().all(|e| *e));
        assert_eq!(asked.get(), 3);
    }
}
