//! How much memory a call needs while it works, where that can be told.
//!
//! The system knows how much memory the whole process has, and the most it had since it was last asked to forget
//! (Linux; elsewhere nothing is told). So a call is measured while no other loads or computes: what the process gains is
//! then the call's own, its output and all that it needed on the way, but not its inputs, which are there before. Of
//! calls that overlap nothing is said. What the allocator kept of earlier calls counts as there before, so figures may
//! be too small, never too large but for some hundred kilobytes, by which the system's own count may be off.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The process has one memory, however many runs it does.
static METER: Mutex<Meter> = Mutex::new(Meter { working: 0, entered: 0, most: 0 });

struct Meter {
    /// How many jobs that hold artefacts are going on.
    working: usize,
    /// How many have begun.
    entered: u64,
    /// The most memory that was had before the system was asked to forget, in bytes.
    most: u64,
}

/// A job that holds artefacts, from its beginning to its end.
pub(super) struct Stay {
    entry: u64,
    before: Option<u64>,
}

impl Stay {
    /// Begins: from now on, no other job is alone.
    pub fn enter() -> Self {
        let mut meter = meter();
        meter.working += 1;
        meter.entered += 1;
        Self { entry: meter.entered, before: None }
    }

    /// Begins to measure, if no other job is going on.
    pub fn begin(&mut self) {
        let mut meter = meter();
        if meter.working == 1
            && let Some(memory) = Memory::now()
        {
            meter.most = meter.most.max(memory.most);
            // Where that is refused, the most of earlier times is still there, and nothing can be told.
            let forgotten = std::fs::write("/proc/self/clear_refs", "5").is_ok();
            (self.entry, self.before) = (meter.entered, forgotten.then_some(memory.now));
        }
    }

    /// The most that the process gained since, in bytes, if no other job began.
    pub fn gained(&self) -> Option<u64> {
        let alone = meter().entered == self.entry;
        Some(Memory::now()?.most.saturating_sub(self.before.filter(|_| alone)?))
    }
}

impl Drop for Stay {
    fn drop(&mut self) {
        meter().working -= 1;
    }
}

/// The most resident memory that this process has had, in bytes, where the system tells.
pub(super) fn most() -> Option<u64> {
    Some(Memory::now()?.most.max(meter().most))
}

fn meter() -> MutexGuard<'static, Meter> {
    METER.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Resident memory of this process in bytes.
struct Memory {
    now: u64,
    /// Since the system was last asked to forget.
    most: u64,
}

impl Memory {
    fn now() -> Option<Self> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let of = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kilobytes| kilobytes * 1024)
        };
        Some(Self { now: of("VmRSS:")?, most: of("VmHWM:")? })
    }
}
