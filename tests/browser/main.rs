//! Reports and the live page in a real browser: Debian's chromium, by way of its driver.
//!
//! `tests/run` installs both and sets `SALIENT_BROWSER=required`. Elsewhere, tests say that they are skipped if the
//! driver is not there.
#![allow(clippy::unwrap_used)]

mod compare;
mod live;
mod ranking;
mod report;
mod window;

use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use window::Window;

/// A folder with shipped graphs and a cache.
struct Desk {
    dir: TempDir,
}

/// The quickstart with few vertices: a browser without a graphics card draws them soon enough.
const QUICKSTART: [&str; 6] = ["run", "quickstart.ron", "--set", "a.vertices=800", "--set", "b.vertices=800"];

impl Desk {
    fn new() -> Self {
        let desk = Self { dir: tempfile::tempdir().unwrap() };
        for name in ["quickstart.ron", "salient_features.ron", "radius_variants.ron", "reconstruction.ron"] {
            let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("graphs").join(name);
            std::fs::copy(shipped, desk.path(name)).unwrap();
        }
        desk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn salient(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_salient"));
        command.current_dir(self.dir.path()).env("SALIENT_CACHE", self.path("cache"));
        command.args(arguments);
        command
    }

    /// Writes a report and opens it; `None` where there is no browser.
    fn report(&self, arguments: &[&str]) -> Option<Window> {
        let output = self.salient(arguments).args(["--report", "r.html"]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Window::open(&format!("file://{}", self.path("r.html").display()))
    }
}
