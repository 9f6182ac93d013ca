//! What the eigensolver returns does not depend on the threads that it is lent, and it ends when some of its work is left out.

mod common;
#[path = "common/solving.rs"]
mod solving;

use common::*;
use salient_kernels::eigen::{EigenError, Eigenpairs, Hooks, Options, eigenpairs};
use solving::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// So many threads, which take tasks from the first to the last or the other way round.
struct Threads {
    count: usize,
    reversed: bool,
}

impl Hooks for Threads {
    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        let work = || {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                if i >= count {
                    break;
                }
                task(if self.reversed { count - 1 - i } else { i });
            }
        };
        std::thread::scope(|scope| {
            (1..self.count).for_each(|_| drop(scope.spawn(work)));
            work();
        });
    }
}

fn bits(pairs: &Eigenpairs) -> Vec<u64> {
    pairs.values.iter().chain(&pairs.vectors).map(|x| x.to_bits()).collect()
}

#[test]
fn results_do_not_depend_on_threads() {
    // One slice, large enough for passes and solves in parts; and two slices.
    for (p, q, k, counts) in [(160, 120, 40, &[1, 2, 3, 7][..]), (80, 72, 300, &[2])] {
        let operator = operator(&rough_patch(p, q));
        let alone = eigenpairs(&operator, k, &Options::default(), &()).expect("certified");
        assert_certified(&operator, &alone, 1e-8);
        for &count in counts {
            for reversed in [false, true] {
                let pairs =
                    eigenpairs(&operator, k, &Options::default(), &Threads { count, reversed }).expect("certified");
                assert!(bits(&pairs) == bits(&alone), "{k} pairs, {count} threads, reversed: {reversed}");
                assert_eq!(pairs.certificate, alone.certificate);
            }
        }
    }
}

/// Leaves out one task, as a caller does that was stopped.
struct Stopped {
    before: AtomicUsize,
}

impl Hooks for Stopped {
    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let stopped = self.before.fetch_sub(1, Ordering::Relaxed) == 0;
        let left_out = if stopped { count / 2 } else { count };
        (0..count).filter(|i| *i != left_out).for_each(task);
    }
}

#[test]
fn a_task_left_out_cancels_the_whole() {
    let operator = operator(&rough_patch(130, 128));
    let run = |before: usize| {
        let hooks = Stopped { before: AtomicUsize::new(before) };
        let result = eigenpairs(&operator, 20, &Options::default(), &hooks);
        (result, before.wrapping_sub(hooks.before.into_inner()))
    };
    let (result, calls) = run(1 << 30);
    assert!(result.is_ok() && calls > 20, "some passes in parts: {calls}");
    // All near both ends, and some between.
    for before in (0..calls).filter(|i| i % 5 == 0 || *i < 6 || calls - i < 6) {
        assert_eq!(run(before).0.unwrap_err(), EigenError::Cancelled, "call {before} of {calls}");
    }
}
