//! Random graphs, edits and damage: after each step the same bytes as with an empty cache, and no execution
//! that the keys did not call for.
//!
//! `SALIENT_FUZZ_SECONDS=600 cargo test -p salient --test engine fuzz -- --nocapture` runs for so long, from the
//! seed `SALIENT_FUZZ_SEED` on (0 if not given). A failure says its seed and step.

mod follow;
mod model;
mod world;

use std::time::{Duration, Instant};

use world::World;

/// Seeds to try: a few, or as many as fit in the time that the environment gives.
fn seeds(few: u64) -> impl Iterator<Item = u64> {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let (first, seconds) = (number("SALIENT_FUZZ_SEED"), number("SALIENT_FUZZ_SECONDS"));
    let begun = Instant::now();
    let from = first.unwrap_or(0);
    (from..).take_while(move |seed| match seconds {
        Some(seconds) => begun.elapsed() < Duration::from_secs(seconds),
        None => *seed < from + if first.is_some() { 1 } else { few },
    })
}

#[test]
fn random_edits_and_damage_give_what_an_empty_cache_gives() {
    let mut count = 0;
    for seed in seeds(8) {
        World::new(seed).play(15);
        count += 1;
    }
    println!("{count} worlds");
}

#[test]
fn a_watch_follows_random_edits() {
    for seed in seeds(2) {
        follow::follow(seed, 10);
    }
}
