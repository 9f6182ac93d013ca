//! When what was found.

use std::cell::Cell;

use super::solve::Progress;

/// Notes when the first and the best assignment and the proof came, by a clock of the caller's: this package reads none.
///
/// ```
/// use salient_kernels::assignment::{Control, Limits, Synthetic, Timeline, solve};
/// let start = std::time::Instant::now();
/// let timeline = Timeline::new(|| start.elapsed().as_secs_f64());
/// let (problem, _) = Synthetic::hard(10, 1).build().unwrap();
/// let control = Control { progress: &|p| timeline.note(p), ..Control::default() };
/// let solution = solve(&problem, &Limits::default(), &control).unwrap();
/// assert!(solution.proved && timeline.best() <= timeline.proof().unwrap());
/// ```
pub struct Timeline<C> {
    clock: C,
    first: Cell<Option<f64>>,
    best: Cell<(f64, f64)>,
    proof: Cell<Option<f64>>,
}

impl<C: Fn() -> f64> Timeline<C> {
    /// `clock` gives the seconds since some start.
    pub fn new(clock: C) -> Self {
        Self { clock, first: Cell::new(None), best: Cell::new((f64::NEG_INFINITY, 0.0)), proof: Cell::new(None) }
    }

    /// To be called with every [`Progress`].
    pub fn note(&self, progress: &Progress) {
        let now = (self.clock)();
        if self.first.get().is_none() {
            self.first.set(Some(now));
        }
        if progress.objective > self.best.get().0 {
            self.best.set((progress.objective, now));
        }
        if progress.proved && self.proof.get().is_none() {
            self.proof.set(Some(now));
        }
    }

    /// Seconds to the first assignment; `None` before it.
    pub fn first(&self) -> Option<f64> {
        self.first.get()
    }

    /// Seconds to the best assignment so far.
    pub fn best(&self) -> f64 {
        self.best.get().1
    }

    /// Seconds to the proof; `None` before it.
    pub fn proof(&self) -> Option<f64> {
        self.proof.get()
    }
}
