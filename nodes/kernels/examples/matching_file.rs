//! Solves a graph matching problem from a file, or writes a synthetic one.
//!
//! ```text
//! matching_file FILE.dd|FILE.dat [--nodes N] [--seconds S] [--solutions K] [--seed S] [--starts N] [--idle N] [--json]
//! matching_file --make hard|none N SEED > FILE.dd
//! ```
//!
//! Files that do not end in `.dd` are read as QAPLIB instances. Costs are printed as the file means them: to be minimised.
#![expect(clippy::disallowed_methods, reason = "a program, not a node")]

use std::error::Error;
use std::io::{self, Write};
use std::time::Instant;

use salient_kernels::assignment::qaplib::Qap;
use salient_kernels::assignment::{Control, Limits, Problem, Solution, Synthetic, Timeline, dd, solve};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    match args.first().map(String::as_str) {
        None => Err(USAGE.into()),
        Some("--help" | "-h") => tell(USAGE),
        Some("--make") => make(&args[1..]),
        Some(file) => run(file, &args[1..]),
    }
}

const USAGE: &str = "matching_file FILE [--nodes N] [--seconds S] [--solutions K] [--seed S] [--starts N] [--idle N] [--json], or --make hard|none N SEED\n";

/// Options that take a value.
const OPTIONS: [&str; 6] = ["--nodes", "--seconds", "--solutions", "--seed", "--starts", "--idle"];

fn make(args: &[String]) -> Result<(), Box<dyn Error>> {
    let [kind, n, seed] = args else { return Err("--make takes hard or none, a size, a seed".into()) };
    let (n, seed) = (n.parse()?, seed.parse()?);
    let synthetic = match kind.as_str() {
        "hard" => Synthetic::hard(n, seed),
        "none" => Synthetic::none(n, seed),
        other => return Err(format!("`{other}` is neither hard nor none").into()),
    };
    let written = dd::write(&synthetic.build()?.0).ok_or("the problem has no .dd form")?;
    tell(&written.text)
}

/// Writes to standard output, whose reader may have seen enough.
fn tell(text: &str) -> Result<(), Box<dyn Error>> {
    match io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// Refuses options that are none, which else would be taken for not given.
fn check(args: &[String]) -> Result<(), Box<dyn Error>> {
    let mut args = args.iter();
    while let Some(arg) = args.next() {
        if arg != "--json" && !(OPTIONS.contains(&arg.as_str()) && args.next().is_some()) {
            return Err(format!("`{arg}` is no option or lacks its value; --help lists them").into());
        }
    }
    Ok(())
}

/// The value after an option, if it is there.
fn option<T: std::str::FromStr>(args: &[String], name: &str) -> Result<Option<T>, Box<dyn Error>> {
    let Some(at) = args.iter().position(|a| a == name) else { return Ok(None) };
    let value = args.get(at + 1).ok_or_else(|| format!("{name} needs a value"))?;
    value.parse().map(Some).map_err(|_| format!("`{value}` is no value of {name}").into())
}

fn run(file: &str, args: &[String]) -> Result<(), Box<dyn Error>> {
    check(args)?;
    let text = std::fs::read_to_string(file).map_err(|e| format!("{file}: {e}"))?;
    let dd_file = std::path::Path::new(file).extension().is_some_and(|e| e.eq_ignore_ascii_case("dd"));
    let problem: Problem = if dd_file {
        dd::read(&text).map_err(|e| format!("{file}, {e}"))?
    } else {
        Qap::read(&text).map_err(|e| format!("{file}, {e}"))?.problem()?
    };
    let limits = Limits {
        node_limit: option(args, "--nodes")?.unwrap_or(u64::MAX),
        solutions: option(args, "--solutions")?.unwrap_or(1),
        seed: option(args, "--seed")?.unwrap_or(0),
        starts: option(args, "--starts")?.unwrap_or(Limits::default().starts),
        idle_moves: option(args, "--idle")?.unwrap_or(Limits::default().idle_moves),
        ..Limits::default()
    };
    let seconds: f64 = option(args, "--seconds")?.unwrap_or(f64::INFINITY);
    let start = Instant::now();
    let timeline = Timeline::new(|| start.elapsed().as_secs_f64());
    let control = Control {
        stop: &|| start.elapsed().as_secs_f64() > seconds,
        progress: &|p| timeline.note(p),
        spread: &spread,
        ..Control::default()
    };
    let solution = solve(&problem, &limits, &control)?;
    let total = start.elapsed().as_secs_f64();
    let times = [timeline.first(), Some(timeline.best()), timeline.proof(), Some(total)];
    let as_json = args.iter().any(|a| a == "--json");
    tell(&if as_json { json(&solution, times) + "\n" } else { lines(&solution, times).join("\n") + "\n" })
}

/// Each call on a thread of its own, but for the first.
fn spread(n: usize, call: &(dyn Fn(usize) + Sync)) {
    std::thread::scope(|scope| {
        (1..n).for_each(|i| drop(scope.spawn(move || call(i))));
        call(0);
    });
}

fn lines(s: &Solution, [first, best, proof, total]: [Option<f64>; 4]) -> Vec<String> {
    let time = |t: Option<f64>| t.map_or("never".into(), |t| format!("{t:.3} s"));
    let caution = if s.reproducible { "" } else { " (by time: another run may differ)" };
    let mut lines = vec![
        format!("cost {} bound {} gap {:.3} %", -s.objective, -s.upper_bound, 100.0 * s.relative_gap()),
        format!("root bound {}, {} nodes, best after {}", -s.root_bound, s.nodes, s.nodes_to_best),
        format!("first {}, best {}, proof {}, in all {}", time(first), time(best), time(proof), time(total)),
        format!("ended: {:?}{caution}", s.stop),
    ];
    let ranked = s.ranked.iter().enumerate();
    lines.extend(ranked.map(|(i, one)| format!("{}: cost {}, candidates {:?}", i + 1, -one.objective, one.candidates)));
    lines
}

fn json(s: &Solution, times: [Option<f64>; 4]) -> String {
    let [first, best, proof, total] = times.map(|t| t.map_or("null".into(), |t| t.to_string()));
    format!(
        "{{\"objective\": {}, \"bound\": {}, \"root\": {}, \"proved\": {}, \"nodes\": {}, \"first\": {first}, \
         \"best\": {best}, \"proof\": {proof}, \"total\": {total}}}",
        s.objective, s.upper_bound, s.root_bound, s.proved, s.nodes
    )
}
