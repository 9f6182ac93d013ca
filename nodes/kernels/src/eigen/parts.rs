//! Work in parts that may run on different threads.
//!
//! What the parts are depends on the work alone, and what they sum is added in their order, so results do not depend on threads.

use super::pool::{Panel, RUN};
use super::{EigenError, Hooks};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

/// Most parts of a pass.
const PARTS: usize = 4;

/// Products of a row with a block that are worth a thread: they take 0.005 ms, and a thread that is awake has them after 0.001 to 0.004. Measured at 5,000 and 10,000
/// vertices on two threads: twice as many cost 3 % of all, half as many are the same.
const GRAIN: usize = 1 << 12;

/// What a mutex holds; a task that panics takes the whole computation with it anyway.
pub(super) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// All tasks, on the threads that the hooks lend; cancelled if one was left out.
///
/// This thread takes them from the first on and others from the last, whatever the hooks call them: of passes over the same rows, one after the other, each then
/// finds in its cache what it left there.
pub(super) fn each(hooks: &dyn Hooks, count: usize, task: &(dyn Fn(usize) + Sync)) -> Result<(), EigenError> {
    let (here, first, last) = (thread::current().id(), AtomicUsize::new(0), AtomicUsize::new(0));
    hooks.each(count, &|_| {
        if thread::current().id() == here {
            task(first.fetch_add(1, Ordering::Relaxed));
        } else {
            task(count - 1 - last.fetch_add(1, Ordering::Relaxed));
        }
    });
    if first.into_inner() + last.into_inner() == count { Ok(()) } else { Err(EigenError::Cancelled) }
}

/// The results of all tasks, in order.
pub(super) fn collect<T: Send>(
    hooks: &dyn Hooks,
    count: usize,
    task: &(dyn Fn(usize) -> T + Sync),
) -> Result<Vec<T>, EigenError> {
    let slots: Vec<Mutex<Option<T>>> = (0..count).map(|_| Mutex::new(None)).collect();
    each(hooks, count, &|i| {
        let result = task(i);
        *locked(&slots[i]) = Some(result);
    })?;
    Ok(slots.into_iter().filter_map(|slot| slot.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
}

/// Three different tasks, as [`each`].
pub(super) fn three<A: Send, B: Send, C: Send>(
    hooks: &dyn Hooks,
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
    third: impl FnOnce() -> C + Send,
) -> Result<(A, B, C), EigenError> {
    let (first, second) = (Mutex::new((Some(first), None)), Mutex::new((Some(second), None)));
    let third = Mutex::new((Some(third), None));
    each(hooks, 3, &|i| match i {
        0 => once(&first),
        1 => once(&second),
        _ => once(&third),
    })?;
    let results = (locked(&first).1.take(), locked(&second).1.take(), locked(&third).1.take());
    if let (Some(a), Some(b), Some(c)) = results { Ok((a, b, c)) } else { Err(EigenError::Cancelled) }
}

/// Puts the task's result beside it.
fn once<T>(task: &Mutex<(Option<impl FnOnce() -> T>, Option<T>)>) {
    let (task, result) = &mut *locked(task);
    *result = task.take().map(|task| task());
}

/// A pass over all runs of some panels, part by part.
pub(super) struct Pass<'h> {
    hooks: &'h dyn Hooks,
    /// Runs in each part but the last.
    pub share: usize,
}

impl<'h> Pass<'h> {
    /// A pass over so many runs that costs as much as so many products of each row with a block.
    pub fn new(hooks: &'h dyn Hooks, runs: usize, cost: usize) -> Self {
        let parts = match runs * RUN * cost / GRAIN {
            0 => 1,
            1..PARTS => 2,
            _ => PARTS,
        };
        Self { hooks, share: runs.div_ceil(parts).max(1) }
    }

    /// The same part of all panels, for each part.
    pub fn split<'p>(&self, panels: Vec<&'p mut Panel>) -> Vec<Vec<&'p mut Panel>> {
        let parts = panels.first().map_or(0, |panel| panel.len().div_ceil(self.share));
        let mut split: Vec<_> = (0..parts).map(|_| Vec::with_capacity(panels.len())).collect();
        for panel in panels {
            split.iter_mut().zip(panel.chunks_mut(self.share)).for_each(|(part, runs)| part.push(runs));
        }
        split
    }

    /// Does the task for every part: it gets the number of the first run, the part, and a sum of its own that begins with `zero`. Returns these sums,
    /// added in order.
    pub fn sum<P: Send, T: Send + Sync + Clone>(
        &self,
        zero: T,
        parts: impl IntoIterator<Item = P>,
        add: impl Fn(&mut T, &T),
        task: impl Fn(usize, P, &mut T) + Sync,
    ) -> Result<T, EigenError> {
        let parts: Vec<_> = parts.into_iter().map(|part| Mutex::new((Some(part), zero.clone()))).collect();
        let run = |i: usize| {
            let (part, sum) = &mut *locked(&parts[i]);
            if let Some(part) = part.take() {
                task(i * self.share, part, sum);
            }
        };
        if parts.len() == 1 {
            run(0);
        } else {
            each(self.hooks, parts.len(), &run)?;
        }
        let sums = parts.into_iter().map(|part| part.into_inner().unwrap_or_else(PoisonError::into_inner).1);
        let both = |mut sum: T, next: T| {
            add(&mut sum, &next);
            sum
        };
        Ok(sums.reduce(both).unwrap_or(zero))
    }

    /// The same without a sum.
    pub fn run<P: Send>(
        &self,
        parts: impl IntoIterator<Item = P>,
        task: impl Fn(usize, P) + Sync,
    ) -> Result<(), EigenError> {
        self.sum((), parts, |(), ()| (), |first, part, ()| task(first, part))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::eigen::panel::WIDTH;

    /// Has tasks done elsewhere, one at a time: from the last to the first.
    pub(in crate::eigen) struct Backwards;

    impl Hooks for Backwards {
        fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
            thread::scope(|scope| drop(scope.spawn(|| (0..count).for_each(task))));
        }
    }

    #[test]
    fn tasks_done_elsewhere_come_from_the_last_on() {
        let order = |hooks: &dyn Hooks| {
            let order = Mutex::new(Vec::new());
            each(hooks, 4, &|i| locked(&order).push(i)).expect("none is left out");
            order.into_inner().expect("no panic")
        };
        assert_eq!(order(&()), [0, 1, 2, 3]);
        assert_eq!(order(&Backwards), [3, 2, 1, 0]);
    }

    #[test]
    fn sums_are_added_in_order_and_every_run_is_in_one_part() {
        for (runs, cost, expected) in [(1, 1, 1), (7, 10, 2), (10, 10, 2), (340, 10, 4)] {
            let mut panel = vec![[[0.0; WIDTH]; RUN]; runs];
            let pass = Pass::new(&Backwards, runs, cost);
            let join = |all: &mut Vec<usize>, more: &Vec<usize>| all.extend(more);
            let firsts = pass.sum(Vec::new(), panel.chunks_mut(pass.share), join, |first, part, firsts| {
                part.as_flattened_mut().iter_mut().for_each(|row| row[0] += 1.0);
                firsts.push(first);
            });
            assert_eq!(firsts, Ok((0..expected).map(|part| part * pass.share).collect()));
            assert!(panel.as_flattened().iter().all(|row| row[0] == 1.0));
            let parts = pass.split(vec![&mut panel[..], &mut []]);
            assert!(parts.len() == expected && parts.iter().map(|part| part[0].len()).sum::<usize>() == runs);
        }
    }

    #[test]
    fn three_tasks_have_three_results() {
        let word = String::from("owned");
        assert_eq!(three(&Backwards, || 3, move || word, || [0.5]), Ok((3, String::from("owned"), [0.5])));
    }
}
