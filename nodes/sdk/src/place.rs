//! Which processor a thread runs on.
//!
//! On virtual machines Linux takes processors that sleep for busy ones, wakes threads on that of their caller, and leaves them there for some 20 ms.

#[cfg(target_os = "linux")]
pub use linux::{here, leave};

#[cfg(target_os = "linux")]
mod linux {
    use rustix::thread::{sched_getaffinity, sched_getcpu, sched_setaffinity};

    /// The processor that this thread runs on.
    pub fn here() -> usize {
        sched_getcpu()
    }

    /// Moves this thread to another processor if it runs on that one and may run elsewhere. Where it may run stays as it was.
    pub fn leave(processor: usize) {
        if here() != processor {
            return;
        }
        let Ok(allowed) = sched_getaffinity(None) else { return };
        let mut others = allowed;
        others.unset(processor);
        if others.count() > 0 && sched_setaffinity(None, &others).is_ok() {
            // What was allowed before still is.
            let _done = sched_setaffinity(None, &allowed);
        }
    }
}

/// Elsewhere it is not known, and left to the system.
#[cfg(not(target_os = "linux"))]
pub fn here() -> usize {
    0
}

#[cfg(not(target_os = "linux"))]
pub fn leave(_processor: usize) {}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use rustix::thread::sched_getaffinity;

    #[test]
    fn a_thread_leaves_its_processor_and_may_come_back() {
        let allowed = || sched_getaffinity(None).expect("may be asked");
        let (before, processor) = (allowed(), here());
        leave(processor);
        assert!(allowed() == before);
        // The system may have moved it back since: not every time.
        let elsewhere = (0..100).any(|_| {
            leave(processor);
            here() != processor
        });
        assert!(elsewhere || before.count() == 1);
    }
}
