//! How much of a run is done, and how long the rest may take.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// How often it is told.
const EVERY: Duration = Duration::from_secs(1);

#[derive(Default)]
struct Kind {
    /// Calls that are not settled.
    left: usize,
    /// What those of them cost of which something is known from former runs, in seconds, and how many they are.
    expected: (f64, usize),
    settled: usize,
    executed: usize,
    /// What the executed ones took.
    seconds: f64,
}

/// Counts calls as they are settled.
pub(super) struct Estimate {
    kinds: BTreeMap<&'static str, Kind>,
    done: usize,
    jobs: usize,
    told: Instant,
}

impl Estimate {
    /// Of calls that are still to be done, each with its kind and what it is expected to cost.
    pub(super) fn new(calls: impl Iterator<Item = (&'static str, Option<f64>)>, jobs: usize) -> Self {
        let mut kinds: BTreeMap<&'static str, Kind> = BTreeMap::new();
        for (kind, expected) in calls {
            let kind = kinds.entry(kind).or_default();
            kind.left += 1;
            if let Some(seconds) = expected {
                kind.expected = (kind.expected.0 + seconds, kind.expected.1 + 1);
            }
        }
        Self { kinds, done: 0, jobs: jobs.max(1), told: Instant::now() }
    }

    /// A call is settled; `seconds` if it was executed.
    pub(super) fn settle(&mut self, kind: &'static str, seconds: Option<f64>) {
        self.done += 1;
        let kind = self.kinds.entry(kind).or_default();
        kind.left = kind.left.saturating_sub(1);
        kind.settled += 1;
        if let Some(seconds) = seconds {
            kind.executed += 1;
            kind.seconds += seconds;
        }
    }

    /// How many calls are settled.
    pub(super) fn done(&self) -> usize {
        self.done
    }

    /// Whether it is time to tell.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.told.elapsed() >= EVERY;
        if due {
            self.told = Instant::now();
        }
        due
    }

    /// How long the rest may take, in seconds: what is left of each kind, times the share of its calls that had to be
    /// executed so far, times their mean cost in this run or else in former ones. `None` if nothing is known of a kind.
    pub(super) fn remaining(&self) -> Option<f64> {
        let mut sum = 0.0;
        for kind in self.kinds.values().filter(|kind| kind.left > 0) {
            let share = (kind.executed + 1) as f64 / (kind.settled + 1) as f64;
            let (expected, known) = kind.expected;
            let mean = match (kind.executed, known) {
                (0, 0) => return None,
                (0, known) => expected / known as f64,
                (executed, _) => kind.seconds / executed as f64,
            };
            sum += kind.left as f64 * share * mean;
        }
        Some(sum / self.jobs as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_costs_what_was_done() {
        let calls = std::iter::repeat_n(("match", None), 100).chain(std::iter::repeat_n(("load", Some(2.0)), 4));
        let mut it = Estimate::new(calls, 2);
        // Nothing is known of matches.
        assert_eq!(it.remaining(), None);
        for _ in 0..19 {
            it.settle("match", Some(0.5));
        }
        // All matches were executed so far: 81 at 0.5 s; of the 4 loads, former runs know that they take 2 s.
        let expected = 48.5 / 2.0;
        assert!((it.remaining().unwrap() - expected).abs() < 1e-12);
        for _ in 0..80 {
            it.settle("match", None);
        }
        for _ in 0..4 {
            it.settle("load", None);
        }
        // The last match is executed with a chance of one in five.
        let left = it.remaining().unwrap();
        assert!((left - 0.2 * 0.5 / 2.0).abs() < 1e-12, "{left}");
        assert_eq!(it.done(), 103);
        it.settle("match", None);
        assert_eq!(it.remaining(), Some(0.0));
    }
}
