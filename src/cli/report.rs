//! `--report`: writes a page.

use std::path::{Path, PathBuf};

use salient_sdk::Registry;

use super::args::ReportChoice;
use super::fail::Fail;
use super::text::complain;
use crate::compare::{Comparison, Library, Side, sides};
use crate::engine::Cache;
use crate::engine::cache::write_atomic;
use crate::engine::history::{RunRecord, RunSummary};
use crate::report::page::{self, LIBRARY, LIBRARY_NAME};
use crate::report::{Assets, Gatherer, scene};

/// A report that was asked for and can be written.
pub struct Target {
    path: PathBuf,
    assets: Assets,
    detail: usize,
}

impl ReportChoice {
    /// What is asked for, if anything. A place where nothing can be written is refused here, before anything is computed.
    pub fn target(&self) -> Result<Option<Target>, Fail> {
        let Some(path) = &self.report else { return Ok(None) };
        let failed = |error| Fail::Write { path: path.display().to_string(), error };
        if path.is_dir() {
            let help = format!("name a file in it: {}", path.join("report.html").display());
            return Err(Fail::Usage { message: format!("{} is a folder", path.display()), help: Some(help) });
        }
        std::fs::create_dir_all(folder(path)).map_err(failed)?;
        tempfile::tempfile_in(folder(path)).map_err(failed)?;
        if path.metadata().is_ok_and(|meta| meta.permissions().readonly()) {
            return Err(failed(std::io::Error::from(std::io::ErrorKind::PermissionDenied)));
        }
        let assets = self.report_assets.into();
        Ok(Some(Target { path: path.clone(), assets, detail: self.report_detail as usize }))
    }
}

fn folder(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

impl Target {
    /// Writes the report of one run.
    pub fn run(&self, run: &RunRecord, cache: &Cache, registry: &Registry) -> Result<(), Fail> {
        self.write(&[&run.summary], &sides("", run), &[], &Library::new(cache, registry))
    }

    /// Writes the report of some sides: whole, or not at all.
    pub fn write(
        &self,
        runs: &[&RunSummary],
        sides: &[Side],
        differences: &[Comparison],
        library: &Library,
    ) -> Result<(), Fail> {
        let (scene, blobs) = scene(&mut Gatherer::new(self.detail), runs, sides, differences, library)?;
        let page = page::report(&scene, &blobs, self.assets);
        let put = |path: &Path, bytes: &[u8]| {
            let failed = |error| Fail::Write { path: path.display().to_string(), error };
            write_atomic(path, folder(path), bytes).map_err(failed)
        };
        if self.assets == Assets::Shared {
            let library = folder(&self.path).join(LIBRARY_NAME);
            if std::fs::read(&library).ok().as_deref() != Some(LIBRARY.as_bytes()) {
                put(&library, LIBRARY.as_bytes())?;
            }
        }
        put(&self.path, page.as_bytes())?;
        complain(&format!("the report is {} ({})", self.path.display(), super::text::bytes(page.len() as u64)));
        Ok(())
    }
}
