//! Results too large for memory beside the work on them: slices that are done wait in a file, and nothing else changes.

mod common;
#[path = "common/solving.rs"]
mod solving;

use common::*;
use salient_kernels::eigen::{EigenError, Hooks, Options, eigenpairs};
use solving::*;
use std::fs::File;
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Everything is too large.
fn frugal() -> Options {
    Options { in_memory: 0, ..Options::default() }
}

/// Lends files, keeps an eye on them, and makes tasks in descending order.
#[derive(Default)]
struct Lender {
    files: Mutex<Vec<File>>,
    /// Bytes in them when the last phase began.
    written: AtomicU64,
}

impl Lender {
    fn files(&self) -> MutexGuard<'_, Vec<File>> {
        self.files.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Hooks for Lender {
    fn scratch(&self) -> io::Result<Option<File>> {
        let file = tempfile::tempfile()?;
        self.files().push(file.try_clone()?);
        Ok(Some(file))
    }

    fn phase(&self, _: salient_kernels::eigen::Phase) {
        let bytes = self.files().iter().map(|file| file.metadata().map_or(0, |data| data.len())).sum();
        self.written.store(bytes, Ordering::Relaxed);
    }

    fn each(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).rev().for_each(task);
    }
}

#[test]
fn results_do_not_depend_on_where_slices_wait() {
    let one = rough_patch(60, 51);
    let two = union(&one, &rough_patch(41, 30));
    for (mesh, k, away) in [(&one, 180, 100), (&two, 190, 110)] {
        let operator = operator(mesh);
        let lender = Lender::default();
        let pairs = eigenpairs(&operator, k, &frugal(), &lender).expect("certified");
        assert_certified(&operator, &pairs, 1e-8);
        assert_eq!(pairs.certificate.rounds, 1);
        // All slices but the lowest were there.
        let bytes = 8 * (operator.mass.len() * (k - away)) as u64;
        assert!(lender.written.into_inner() > bytes);
        let within = eigenpairs(&operator, k, &frugal(), &()).expect("certified");
        assert!(pairs == within);
        // Larger slices find the same pairs.
        let default = eigenpairs(&operator, k, &Options::default(), &()).expect("certified");
        for (a, b) in pairs.values.iter().zip(&default.values) {
            assert!((a - b).abs() <= 1e-10 * b, "{a} {b}");
        }
    }
}

/// Lends what cannot be written to.
struct Sealed;

impl Hooks for Sealed {
    #[expect(clippy::disallowed_methods, reason = "a host, not a node")]
    fn scratch(&self) -> io::Result<Option<File>> {
        let named = tempfile::NamedTempFile::new()?;
        File::open(named.path()).map(Some)
    }
}

/// Has no room.
struct Full;

impl Hooks for Full {
    fn scratch(&self) -> io::Result<Option<File>> {
        Err(io::Error::from(io::ErrorKind::StorageFull))
    }
}

#[test]
fn a_file_that_fails_is_an_error_with_its_reason() {
    let operator = operator(&rough_patch(50, 41));
    let lenders: [(&dyn Hooks, &str); 2] = [(&Sealed, "Bad file descriptor"), (&Full, "no storage space")];
    for (lender, expected) in lenders {
        let error = eigenpairs(&operator, 160, &frugal(), lender).expect_err("nowhere to wait");
        assert!(matches!(&error, EigenError::Scratch { .. }), "{error:?}");
        assert!(error.to_string().contains(expected), "{error}");
    }
    // A result that is found at once needs none.
    assert!(eigenpairs(&operator, 60, &frugal(), &Full).is_ok());
}
