//! Time and gap on problems made like the matcher's: planar features, noise, a common part, candidates pruned by descriptor.
//! `cargo test --release -p salient-kernels --test assignment_measure -- --ignored --nocapture`

#![expect(clippy::unwrap_used, clippy::disallowed_methods, reason = "a measurement, not a node")]

use salient_kernels::assignment::{Control, Limits, Problem, ProblemBuilder, Progress, solve};
use std::cell::Cell;
use std::time::Instant;

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// `n` x `n` features in the unit square, 70 % of them common with 5 % noise; `width` candidates each: the true one, if any, among
/// the nearest of random descriptors. `h = exp(-(d_ik - d_jl)^2 / 2 s^2)`, dropped below `floor`; less `threshold`, which may make it negative.
fn planar(n: usize, width: usize, s: f64, floor: f64, shift: f64, seed: u64) -> Problem {
    let mut r = Random(seed);
    let common = n * 7 / 10;
    let left: Vec<(f64, f64)> = (0..n).map(|_| (r.unit(), r.unit())).collect();
    let right: Vec<(f64, f64)> = (0..n)
        .map(|k| {
            if k < common {
                (left[k].0 + 0.05 * (2.0 * r.unit() - 1.0), left[k].1 + 0.05 * (2.0 * r.unit() - 1.0))
            } else {
                (r.unit(), r.unit())
            }
        })
        .collect();
    let distance = |p: (f64, f64), q: (f64, f64)| (p.0 - q.0).hypot(p.1 - q.1);
    let mut b = ProblemBuilder::new(n, n);
    let mut pairs = Vec::new();
    for i in 0..n {
        let mut ranked: Vec<(f64, usize)> =
            (0..n).map(|j| (r.unit() * if i == j && i < common { 0.05 } else { 1.0 }, j)).collect();
        ranked.sort_by(|x, y| x.0.total_cmp(&y.0));
        for &(d, j) in &ranked[..width.min(n)] {
            b.candidate(i, j, (-d * 4.0).exp()).unwrap();
            pairs.push((i, j));
        }
    }
    for a in 0..pairs.len() {
        for c in a + 1..pairs.len() {
            let ((i, j), (k, l)) = (pairs[a], pairs[c]);
            if i != k && j != l {
                let e = distance(left[i], left[k]) - distance(right[j], right[l]);
                let h = (-e * e / (2.0 * s * s)).exp();
                if h >= floor {
                    b.pair(a, c, h - shift).unwrap();
                }
            }
        }
    }
    b.build().unwrap()
}

#[test]
#[ignore = "a measurement"]
fn measure() {
    let get = |name: &str, default: &str| std::env::var(name).unwrap_or_else(|_| default.into());
    let list = |name: &str, default: &str| {
        get(name, default).split(',').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<_>>()
    };
    for n in list("N", "20,40,50,80") {
        for sigma in list("SIGMA", "0.05,0.1,0.2") {
            for nodes in list("NODES", "1,200") {
                let p = planar(
                    n as usize,
                    6,
                    sigma,
                    list("FLOOR", "0.001")[0],
                    list("SHIFT", "0")[0],
                    list("SEED", "1")[0] as u64,
                );
                let limits = Limits {
                    node_limit: nodes as u64,
                    root_rounds: list("ROOT", "100")[0] as usize,
                    node_rounds: list("SWEEPS", "8")[0] as usize,
                    ..Limits::default()
                };
                let (start, best, at) = (Instant::now(), Cell::new(f64::NEG_INFINITY), Cell::new(0.0));
                let (root_at, quit) = (Cell::new(0.0), list("QUIT", "60")[0]);
                let progress = |s: &Progress| {
                    let now = start.elapsed().as_secs_f64();
                    if s.objective > best.replace(s.objective) {
                        at.set(now);
                    }
                    if s.nodes == 1 {
                        root_at.set(now);
                    }
                };
                let stop = || start.elapsed().as_secs_f64() > quit;
                let s = solve(&p, &limits, &Control { stop: &stop, progress: &progress }).unwrap();
                println!(
                    "n {n} sigma {sigma}: objective {:.4} (heuristic {:.4}) root gap {:.2}% gap {:.2}% {:?} nodes {} root {:.2} s best {:.2} s total {:.2} s",
                    s.objective,
                    s.heuristic_objective,
                    100.0 * (s.root_bound / s.objective - 1.0),
                    100.0 * s.relative_gap(),
                    s.stop,
                    s.nodes,
                    root_at.get(),
                    at.get(),
                    start.elapsed().as_secs_f64()
                );
            }
        }
    }
}
