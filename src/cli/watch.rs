//! `salient watch`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use salient_sdk::Registry;

use super::args::WatchArgs;
use super::fail::Fail;
use super::failures;
use super::plan::overrides;
use super::progress::{Progress, json_line, line, totals};
use super::results::result;
use super::text::{complain, print};
use crate::compare::{Library, sides};
use crate::engine::{Cache, CacheError, Cancel, Event, Outcome};
use crate::graph::Plan;
use crate::report::serve::Server;
use crate::report::{Gatherer, scene};
use crate::watch::{Observer, Stop, Subject, Watch};

/// `salient watch`: ends by Ctrl-C, or when its output is closed.
pub fn watch(args: &WatchArgs, registry: &Registry) -> Result<(), Fail> {
    let subject = Subject {
        graph: args.graph.graph.clone(),
        overrides: overrides(&args.graph),
        registry,
        cache: args.cache.path()?,
        options: args.effort.options(),
        poll: args.poll,
    };
    let page = args.serve.as_ref().map(|address| Page::start(address, args, registry)).transpose()?;
    let watch = Watch::new(subject);
    let stop = watch.stopper();
    let handler = {
        let stop = stop.clone();
        move || {
            if stop.is_stopped() {
                std::process::exit(130);
            }
            stop.stop();
        }
    };
    ctrlc::set_handler(handler).map_err(|e| Fail::Lacking(format!("cannot listen for interrupts: {e}")))?;
    let mut teller = Teller {
        json: args.json,
        out: args.out.clone(),
        stop,
        progress: None,
        shown: BTreeMap::new(),
        page,
        fail: None,
    };
    watch.run(&mut teller)?;
    Err(teller.fail.unwrap_or(Fail::Interrupted))
}

/// The live page.
struct Page<'a> {
    server: Server,
    gatherer: Gatherer,
    registry: &'a Registry,
}

impl<'a> Page<'a> {
    fn start(address: &str, args: &WatchArgs, registry: &'a Registry) -> Result<Self, Fail> {
        let title = args.graph.graph.file_name().unwrap_or_default().to_string_lossy();
        let server = Server::start(address, &title).map_err(|e| Fail::Usage {
            message: format!("cannot serve a page at {address}: {e}"),
            help: Some("name another address with --serve HOST:PORT; port 0 means any that is free".into()),
        })?;
        complain(&format!("the page is http://{}/", server.address));
        Ok(Self { server, gatherer: Gatherer::new(args.report_detail as usize), registry })
    }

    fn outcome(&mut self, outcome: &Outcome, trouble: Option<String>, cache: &Cache) -> Result<(), CacheError> {
        let (run, library) = (&outcome.record, Library::new(cache, self.registry));
        let (scene, blobs) = scene(&mut self.gatherer, &[&run.summary], &sides("", run), &[], &library)?;
        self.server.trouble(trouble);
        self.server.scene(&scene, blobs);
        Ok(())
    }
}

/// Tells people, or programs with `--json`.
struct Teller<'a> {
    json: bool,
    out: Option<PathBuf>,
    stop: Stop,
    /// Of the run that is going on.
    progress: Option<Progress>,
    /// What was last said of each result.
    shown: BTreeMap<String, String>,
    page: Option<Page<'a>>,
    /// Why the watch cannot go on.
    fail: Option<Fail>,
}

impl Observer for Teller<'_> {
    fn event(&mut self, event: &Event) {
        if let Some(page) = &self.page {
            page.server.event(event);
        }
        if self.json {
            let told = json_line(event).map_err(Fail::from);
            return self.check(told);
        }
        match event {
            Event::RunStarted { .. } => {
                let mut progress = Progress::new(false, &Cancel::new());
                progress.event(event);
                self.progress = Some(progress);
            }
            Event::RunFinished { .. } => {
                let cleared = self.progress.take().map_or(Ok(()), Progress::finish).map_err(Fail::from);
                self.check(cleared);
            }
            _ => match &mut self.progress {
                Some(progress) => progress.event(event),
                None => drop(line(event).map(|line| complain(&line))),
            },
        }
    }

    fn outcome(&mut self, plan: &Plan, outcome: &Outcome, cache: &Cache) -> Vec<PathBuf> {
        let mut written = Vec::new();
        let told = self.tell(plan, outcome, cache, &mut written);
        self.check(told);
        if let Some(page) = &mut self.page {
            let failed = failures::failures(plan, outcome);
            let trouble = (!failed.is_empty()).then(|| failures::text(&failed));
            let shown = page.outcome(outcome, trouble, cache).map_err(Fail::from);
            self.check(shown);
        }
        written
    }
}

impl Teller<'_> {
    fn check(&mut self, told: Result<(), Fail>) {
        if let Err(fail) = told {
            self.fail.get_or_insert(fail);
            self.stop.stop();
        }
    }

    /// Prints and writes the results that are not as they were.
    fn tell(&mut self, plan: &Plan, outcome: &Outcome, cache: &Cache, written: &mut Vec<PathBuf>) -> Result<(), Fail> {
        let (mut lines, mut same) = (Vec::new(), 0);
        for shown in &plan.show {
            let Some(found) = result(plan, outcome, shown, cache)? else { continue };
            let line = found.json();
            let said = line.to_string();
            let is_new = self.shown.get(found.address()) != Some(&said);
            if self.json {
                lines.push(line);
            } else if is_new {
                print(found.text().as_bytes())?;
            } else {
                same += 1;
            }
            if is_new && let Some(dir) = &self.out {
                written.extend(found.write(dir)?);
            }
            self.shown.insert(found.address().to_owned(), said);
        }
        if self.json {
            let failures = failures::json(&failures::failures(plan, outcome));
            return Ok(json_line(&Event::Results { results: lines, failures })?);
        }
        if same > 0 {
            complain(&format!("{} as before", super::text::count(same, "result")));
        }
        complain(&totals(&outcome.totals, outcome.seconds));
        Ok(())
    }
}
