//! Threads for tasks that are shorter than it takes to start one, or to wake one (35 and 25 us here): those of a pool, kept awake for a while.
#![expect(clippy::disallowed_methods, reason = "how long a thread waits is no part of a result")]

use crate::context::processors;
use crate::place;
use rayon::{ThreadPool, ThreadPoolBuilder, Yield, yield_now};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::yield_now as yield_thread;
use std::time::{Duration, Instant};

/// A thread without work looks for more so long before it sleeps: as long as passes of the eigensolver are apart.
const PATIENCE: Duration = Duration::from_micros(200);

/// And so long at most, if there always is some: it may have begun to look while a task that it was at waited for others.
const TURN: Duration = Duration::from_millis(4);

/// As many as run beside a caller. With one for the caller too, that one would be woken for every task and take the caller's processor.
static POOL: LazyLock<Option<ThreadPool>> = LazyLock::new(|| {
    let threads = processors().saturating_sub(1).max(1);
    ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("lent-{i}")).build().ok()
});

/// Threads of the pool that are looking for work, or found some.
static AWAKE: AtomicUsize = AtomicUsize::new(0);

/// Runs `task(0)` to `task(count - 1)`, each once and in any order, on this thread and on at most `extra` others, and returns when all are done. Tasks may
/// call it themselves; `extra` is then what the caller has left. A panic of a task goes on here.
pub fn each(extra: usize, count: usize, task: &(dyn Fn(usize) + Sync)) {
    let extra = extra.min(count.saturating_sub(1));
    // Where no thread can be had, the caller does it alone.
    let Some(pool) = POOL.as_ref().filter(|_| extra > 0) else {
        (0..count).for_each(task);
        return;
    };
    let (next, left, caller) = (AtomicUsize::new(0), AtomicUsize::new(extra), place::here());
    let work = || {
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            if i >= count {
                break;
            }
            task(i);
        }
    };
    pool.in_place_scope(|scope| {
        for _ in 0..extra {
            scope.spawn(|_| {
                place::leave(caller);
                work();
                left.fetch_sub(1, Ordering::Release);
            });
        }
        // A thread of the pool would take that upon itself.
        if pool.current_thread_index().is_none() && keep_awake(pool, extra) {
            // One that wakes up on this processor can leave it.
            yield_thread();
        }
        work();
        // The others will be done soon: to sleep until then takes longer.
        let start = Instant::now();
        while left.load(Ordering::Acquire) > 0 && start.elapsed() < TURN {
            look();
        }
    });
}

/// Does something else that waits, if this is a thread of the pool; otherwise others may run here. Whether there was something.
fn look() -> bool {
    let found = matches!(yield_now(), Some(Yield::Executed));
    if !found {
        yield_thread();
    }
    found
}

/// Has so many threads of the pool look for work. Whether some may have slept.
fn keep_awake(pool: &ThreadPool, threads: usize) -> bool {
    let asleep = AWAKE.load(Ordering::Relaxed) < threads;
    while AWAKE.load(Ordering::Relaxed) < threads {
        AWAKE.fetch_add(1, Ordering::Relaxed);
        pool.spawn(|| {
            let begin = Instant::now();
            let mut last = begin;
            while last.elapsed() < PATIENCE && begin.elapsed() < TURN {
                if look() {
                    last = Instant::now();
                }
            }
            AWAKE.fetch_sub(1, Ordering::Relaxed);
        });
    }
    asleep
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn every_task_is_done_once_on_any_number_of_threads_and_within_tasks_too() {
        for extra in [0, 1, 3] {
            let counts: Vec<AtomicUsize> = (0..60).map(|_| AtomicUsize::new(0)).collect();
            for _ in 0..50 {
                each(extra, 6, &|i| {
                    each(1, 10, &|j| {
                        counts[10 * i + j].fetch_add(1, Ordering::Relaxed);
                    });
                });
            }
            assert!(counts.iter().all(|count| count.load(Ordering::Relaxed) == 50));
        }
        each(1, 0, &|_| panic!("there is none"));
    }

    #[test]
    fn a_panic_keeps_its_message() {
        for bad in [0, 7] {
            let run = || each(1, 8, &|i| assert!(i != bad, "task {bad}"));
            let payload = catch_unwind(AssertUnwindSafe(run)).expect_err("one panics");
            assert_eq!(payload.downcast_ref::<String>(), Some(&format!("task {bad}")));
        }
    }
}
