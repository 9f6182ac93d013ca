//! Known optima of QAPLIB instances, where the data set lies beside the repository (`../shared/data/qaplib` from the workspace root,
//! or from a directory above it).

#![expect(clippy::float_cmp, reason = "exact equality is what is claimed")]
#![expect(clippy::unwrap_used, clippy::disallowed_methods, reason = "a test file, no node")]

use salient_kernels::assignment::qaplib::{Qap, QapSolution};
use salient_kernels::assignment::{Control, Limits, Problem, Solution, solve};
use std::path::{Path, PathBuf};
use std::time::Instant;

fn data() -> Option<PathBuf> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2)?;
    let found = workspace.ancestors().skip(1).map(|up| up.join("shared/data/qaplib")).find(|p| p.is_dir());
    if found.is_none() {
        println!("SKIPPED: no ../shared/data/qaplib beside the workspace");
    }
    found
}

fn load(root: &Path, name: &str) -> (Problem, f64) {
    let read = |file: &str| std::fs::read_to_string(root.join(name).join(file)).unwrap();
    let qap = Qap::read(&read(&format!("{name}.txt"))).unwrap();
    let known = QapSolution::read(&read("solution.txt")).unwrap();
    let inverse: Vec<usize> = (0..qap.n).map(|k| known.permutation.iter().position(|&p| p == k).unwrap()).collect();
    // Some files of QAPLIB give the permutation the other way round.
    assert!([&known.permutation, &inverse].iter().any(|p| qap.cost(p) == Some(known.cost)), "{name}");
    (qap.problem().unwrap(), known.cost)
}

fn run(root: &Path, name: &str, limits: &Limits) -> (Solution, f64) {
    let (problem, optimum) = load(root, name);
    let start = Instant::now();
    let s = solve(&problem, limits, &Control::default()).unwrap();
    println!(
        "{name}: optimum {optimum} heuristic {} found {} bound {} root {} proved {} nodes {} {:.2} s",
        -s.heuristic_objective,
        -s.objective,
        -s.upper_bound,
        -s.root_bound,
        s.proved,
        s.nodes,
        start.elapsed().as_secs_f64()
    );
    (s, optimum)
}

#[test]
fn known_optima_are_found_and_never_excluded() {
    let Some(root) = data() else { return };
    for name in ["rou12", "esc16a", "esc16b", "esc16c", "esc16d", "nug14", "chr15a", "scr15"] {
        let (s, optimum) =
            run(&root, name, &Limits { node_limit: 3, root_rounds: 5, starts: 300, ..Limits::default() });
        assert_eq!(-s.objective, optimum, "{name}");
        assert!(-s.upper_bound <= optimum, "{name}");
    }
}

#[test]
fn known_optima_are_proved() {
    let Some(root) = data() else { return };
    for name in ["chr12a", "chr12b", "chr12c", "scr12", "had12", "had14", "nug12", "tai12a", "esc16a"] {
        let (s, optimum) = run(&root, name, &Limits { node_limit: 5_000, starts: 300, ..Limits::default() });
        assert_eq!((-s.objective, -s.upper_bound, s.proved), (optimum, optimum, true), "{name}");
    }
}

/// Rows of a grid against distances on a path: needs no data. 8! permutations are enumerated.
#[test]
fn an_embedded_instance_is_proved() {
    let n = 8;
    let entry = |f: fn(usize, usize) -> usize| (0..n * n).map(|e| f(e / n, e % n) as f64).collect::<Vec<_>>();
    let a = entry(|i, j| (i % 4).abs_diff(j % 4) + (i / 4).abs_diff(j / 4));
    let b = entry(|i, j| if i == j { 0 } else { (3 * i.min(j) + 5 * i.max(j)) % 7 });
    let qap = Qap { n, a, b };
    let s = solve(&qap.problem().unwrap(), &Limits::default(), &Control::default()).unwrap();
    let mut best = f64::INFINITY;
    permute(&mut (0..n).collect(), 0, &mut |p| best = best.min(qap.cost(p).unwrap()));
    assert_eq!((-s.objective, -s.upper_bound, s.proved), (best, best, true));
}

fn permute(p: &mut Vec<usize>, at: usize, visit: &mut impl FnMut(&[usize])) {
    if at == p.len() {
        return visit(p);
    }
    for k in at..p.len() {
        p.swap(at, k);
        permute(p, at + 1, visit);
        p.swap(at, k);
    }
}

#[test]
#[ignore = "a measurement: run in release with --nocapture; QAPLIB=name,... chooses"]
fn measure() {
    let Some(root) = data() else { return };
    let chosen = std::env::var("QAPLIB")
        .unwrap_or_else(|_| "chr12a,chr12b,chr12c,had12,nug12,tai12a,rou12,scr12,chr15a,scr15".into());
    let node_limit = std::env::var("NODES").map_or(200_000, |n| n.parse().unwrap());
    let node_rounds = std::env::var("SWEEPS").map_or(Limits::default().node_rounds, |n| n.parse().unwrap());
    for name in chosen.split(',') {
        run(&root, name, &Limits { node_limit, node_rounds, ..Limits::default() });
    }
}
