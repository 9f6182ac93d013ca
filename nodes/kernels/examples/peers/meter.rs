//! Time and memory of one computation in this process.

use rustix::time::{ClockId, clock_gettime};
use std::error::Error;
use std::fs;
use std::time::Instant;

/// What a computation cost.
pub struct Cost {
    /// Seconds.
    pub wall: f64,
    /// Seconds of all threads.
    pub cpu: f64,
    /// Largest resident memory minus what was resident before, in bytes.
    pub memory: u64,
}

/// Runs `work` and measures it (Linux only: memory is that of /proc).
pub fn measured<T>(work: impl FnOnce() -> Result<T, Box<dyn Error>>) -> Result<(T, Cost), Box<dyn Error>> {
    fs::write("/proc/self/clear_refs", "5")?; // the high-water mark starts from here
    let (before, cpu) = (resident("VmRSS:")?, cpu_seconds());
    let start = Instant::now();
    let result = work()?;
    let wall = start.elapsed().as_secs_f64();
    let memory = resident("VmHWM:")?.saturating_sub(before);
    Ok((result, Cost { wall, cpu: cpu_seconds() - cpu, memory }))
}

fn resident(field: &str) -> Result<u64, Box<dyn Error>> {
    let status = fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|l| l.strip_prefix(field)).ok_or("no such field in /proc/self/status")?;
    Ok(1024 * line.trim().trim_end_matches("kB").trim().parse::<u64>()?)
}

fn cpu_seconds() -> f64 {
    let spent = clock_gettime(ClockId::ProcessCPUTime);
    spent.tv_sec as f64 + 1e-9 * spent.tv_nsec as f64
}
