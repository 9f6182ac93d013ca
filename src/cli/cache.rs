//! `salient cache`.

use std::fmt::Write as _;

use serde::Serialize;

use super::args::{CacheArgs, CacheCommand};
use super::fail::Fail;
use super::text::{bytes, complain, count, print, print_json};
use crate::engine::upkeep::{Collected, Limits, Stat, Verified};

/// `salient cache`.
pub fn cache(args: &CacheArgs) -> Result<(), Fail> {
    let cache = args.cache.open()?;
    let root = cache.root().display().to_string();
    match args.command {
        CacheCommand::Stat => show(args.json, &cache.stat()?, |stat| stat_text(&root, stat)),
        CacheCommand::Verify => {
            let verified = cache.verify()?;
            for path in &verified.corrupt {
                complain(&format!("damaged, and removed: {}", path.display()));
            }
            show(args.json, &verified, verified_text)
        }
        CacheCommand::Gc { max_size: None, max_age: None } => {
            // Temporaries of dead processes go in any case.
            show(args.json, &cache.gc(Limits::default())?, collected_text)
        }
        CacheCommand::Gc { max_size, max_age } => {
            let limits = Limits { max_size, max_age, ..Limits::default() };
            show(args.json, &cache.gc(limits)?, collected_text)
        }
        CacheCommand::Clear => show(args.json, &cache.clear()?, collected_text),
    }
}

fn show<T: Serialize>(json: bool, value: &T, text: impl Fn(&T) -> String) -> Result<(), Fail> {
    if json { print_json(value) } else { print(text(value).as_bytes()) }
}

fn stat_text(root: &str, stat: &Stat) -> String {
    format!(
        "{root}\n  {}, {}\n  {}, {}\n  {} of single items, {}\n  {} remembered, {} now\n  {}\n",
        count(stat.objects, "output"),
        bytes(stat.object_bytes),
        count(stat.records, "record"),
        bytes(stat.record_bytes),
        count(stat.memos, "pack"),
        bytes(stat.memo_bytes),
        count(stat.runs, "run"),
        stat.running.len(),
        count(stat.temporaries, "temporary file"),
    )
}

fn verified_text(verified: &Verified) -> String {
    format!(
        "{}, {} and {} are whole; {} without output (collected; computed again when needed); {} removed\n",
        count(verified.objects, "output"),
        count(verified.records, "record"),
        count(verified.memos, "pack"),
        count(verified.evicted, "record"),
        count(verified.corrupt.len(), "damaged file"),
    )
}

fn collected_text(collected: &Collected) -> String {
    let mut text = format!(
        "removed {}, {}, {} and {}: {}; {} of outputs and packs are left\n",
        count(collected.objects, "output"),
        count(collected.records, "record"),
        count(collected.memos, "pack"),
        count(collected.temporaries, "temporary file"),
        bytes(collected.bytes),
        bytes(collected.left),
    );
    if collected.protected > 0 {
        let kept = bytes(collected.protected);
        let _ = writeln!(text, "{kept} were kept, as they are in use or were used just now");
    }
    text
}
