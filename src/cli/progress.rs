//! The events of a run, as they happen: bars on a terminal, lines elsewhere, or JSON.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};

use super::text::{complain, seconds, span};
use crate::engine::{Cancel, Event, Totals};

/// How often a log says how far the run is.
const TELL_EVERY: Duration = Duration::from_secs(10);

/// Where events go.
pub enum Progress {
    /// Lines of JSON on standard output. If that is closed the run is stopped.
    Json { cancel: Cancel, error: Option<io::Error> },
    /// One bar for the run and one for each running node, on standard error.
    Bars { all: MultiProgress, whole: ProgressBar, nodes: BTreeMap<String, ProgressBar> },
    /// One line for each node that did not come from the cache, on standard error.
    Lines { told: Instant },
}

impl Progress {
    pub fn new(json: bool, cancel: &Cancel) -> Self {
        if json {
            return Self::Json { cancel: cancel.clone(), error: None };
        }
        if !io::stderr().is_terminal() {
            return Self::Lines { told: Instant::now() };
        }
        let all = MultiProgress::new();
        let whole = all.add(ProgressBar::new(0).with_style(style("{bar:24} {pos}/{len} {elapsed} {wide_msg}")));
        Self::Bars { all, whole, nodes: BTreeMap::new() }
    }

    pub fn event(&mut self, event: &Event) {
        match self {
            Self::Json { cancel, error } => {
                if error.is_none()
                    && let Err(e) = json_line(event)
                {
                    cancel.cancel();
                    *error = Some(e);
                }
            }
            Self::Bars { all, whole, nodes } => bars(all, whole, nodes, event),
            Self::Lines { told } => {
                if let Event::Tally { done, calls, remaining } = event {
                    if told.elapsed() >= TELL_EVERY {
                        *told = Instant::now();
                        let left = remaining.map(|s| format!(", about {} left", span(s))).unwrap_or_default();
                        complain(&format!("{done} of {calls} nodes done{left}"));
                    }
                } else if let Some(line) = line(event) {
                    complain(&line);
                }
            }
        }
    }

    /// Clears the bars; the error is one of standard output.
    pub fn finish(self) -> io::Result<()> {
        match self {
            Self::Json { error: Some(error), .. } => Err(error),
            Self::Bars { all, .. } => all.clear(),
            _ => Ok(()),
        }
    }
}

/// One line of JSON on standard output.
pub fn json_line(value: &impl serde::Serialize) -> io::Result<()> {
    let mut text = serde_json::to_string(value)?;
    text.push('\n');
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> ")
}

fn bars(all: &MultiProgress, whole: &ProgressBar, nodes: &mut BTreeMap<String, ProgressBar>, event: &Event) {
    match event {
        Event::RunStarted { calls, .. } => whole.set_length(*calls as u64),
        Event::Started { node, kind } => {
            let bar = ProgressBar::new(100).with_style(style("{spinner} {bar:22} {elapsed:>4} {wide_msg}"));
            let bar = all.add(bar).with_message(format!("{node} ({kind})"));
            bar.enable_steady_tick(Duration::from_millis(120));
            nodes.insert(node.clone(), bar);
        }
        Event::Progress { node, fraction } => {
            if let Some(bar) = nodes.get(node) {
                bar.set_position((fraction * 100.0) as u64);
            }
        }
        Event::Tally { remaining: Some(seconds), .. } => whole.set_message(format!("about {} left", span(*seconds))),
        Event::Hit { .. } | Event::Skipped { .. } => whole.inc(1),
        Event::Finished { node, .. } | Event::Failed { node, .. } => {
            whole.inc(1);
            if let Some(bar) = nodes.remove(node) {
                bar.finish_and_clear();
                all.remove(&bar);
            }
        }
        _ => {}
    }
    if !matches!(event, Event::Finished { .. })
        && let Some(line) = line(event)
    {
        // Written through the bars, or they would overwrite it.
        let _ = all.println(line);
    }
}

/// What people are told of an event.
pub fn line(event: &Event) -> Option<String> {
    match event {
        Event::Changed { changed, added, removed, running } => {
            let lists = [("changed", changed), ("new", added), ("gone", removed)];
            let lists = lists.iter().filter(|(_, files)| !files.is_empty());
            let text: Vec<_> = lists.map(|(what, files)| format!("{what}: {}", some(files))).collect();
            let stops = if *running { " (while a run was going on)" } else { "" };
            Some(format!("\n{}{stops}", text.join("; ")))
        }
        Event::Broken { text, .. } => Some(format!("{}\nthe last results stand until this is mended", text.trim_end())),
        Event::Watching { graph, files, .. } => {
            Some(format!("watching {graph}: {}; Ctrl-C ends", super::text::count(*files, "file")))
        }
        Event::Finished { node, kind, seconds: time, .. } => {
            Some(format!("computed {node} ({kind}) in {} s", seconds(*time)))
        }
        Event::Failed { node, kind, files, message, help } => {
            let files = if files.is_empty() { String::new() } else { format!(" on {}", files.join(", ")) };
            let help = help.as_ref().map(|help| format!("\n  help: {help}")).unwrap_or_default();
            Some(format!("failed {node} ({kind}){files}: {message}{help}"))
        }
        Event::Skipped { node, kind, because } => Some(format!("skipped {node} ({kind}) because of {because}")),
        Event::CacheCorrupt { node, path } => {
            Some(format!("damaged file in the cache, computing {node} again: {path}"))
        }
        Event::Irreproducible { node, .. } => Some(format!(
            "warning: {node} gave another output than before for equal inputs; results that rest on \
             the former one are kept"
        )),
        _ => None,
    }
}

/// The first of some names.
pub fn some(names: &[String]) -> String {
    let shown = names.iter().take(3).cloned().collect::<Vec<_>>().join(", ");
    if names.len() > 3 { format!("{shown} and {} more", names.len() - 3) } else { shown }
}

/// The last line about a run.
pub fn totals(totals: &Totals, time: f64) -> String {
    let Totals { hits, computed, failed, skipped, cancelled } = *totals;
    let all = hits + computed + failed + skipped + cancelled;
    let mut text = format!("{}: {hits} from the cache, {computed} computed", super::text::count(all, "node"));
    for (count, what) in [(failed, "failed"), (skipped, "skipped"), (cancelled, "not done")] {
        if count > 0 {
            let _ = write!(text, ", {count} {what}");
        }
    }
    format!("{text}; {} s", seconds(time))
}
