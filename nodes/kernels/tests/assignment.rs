//! `assignment` against exhaustive enumeration.

#![expect(clippy::float_cmp, reason = "exact equality is what is claimed")]
#![expect(clippy::unwrap_used, reason = "helpers of tests lie outside any test function")]

use salient_kernels::assignment::{
    Control, Limits, Problem, ProblemBuilder, ProblemError, Solution, SolveError, StopReason, solve,
};
use std::cell::Cell;

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
    fn real(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A problem kept in plain form beside the real one, so that the oracle shares no code with it.
#[derive(Clone)]
struct Plain {
    n: (usize, usize),
    candidates: Vec<(usize, usize, f64)>,
    h: Vec<Vec<f64>>,
    cost: (Vec<f64>, Vec<f64>),
    all: bool,
}

impl Plain {
    fn random(r: &mut Random, largest: usize, all: bool) -> Self {
        let n = (1 + r.below(largest), 1 + r.below(largest));
        let (density, pairs) = (r.real(0.2, 1.2), r.real(0.0, 1.2));
        let low = [0.0, -1.0, -0.3][r.below(3)];
        let integral = r.below(3) == 0;
        let draw = |r: &mut Random, low: f64| {
            if integral { (r.real(low, 1.0) * 9.0).round() } else { r.real(low, 1.0) }
        };
        let mut candidates = Vec::new();
        for i in 0..n.0 {
            for j in 0..n.1 {
                if r.real(0.0, 1.0) < density {
                    candidates.push((i, j, draw(r, low)));
                }
            }
        }
        let m = candidates.len();
        let mut h = vec![vec![0.0; m]; m];
        for a in 0..m {
            for b in a + 1..m {
                let shared = candidates[a].0 == candidates[b].0 || candidates[a].1 == candidates[b].1;
                if !shared && r.real(0.0, 1.0) < pairs {
                    h[a][b] = draw(r, low);
                }
            }
        }
        let mut cost = (vec![0.0; n.0], vec![0.0; n.1]);
        if r.below(2) == 0 {
            cost.0.iter_mut().chain(&mut cost.1).for_each(|c| *c = draw(r, -0.2));
        }
        Self { n, candidates, h, cost, all }
    }

    fn problem(&self, order: &[usize]) -> Problem {
        let mut b = ProblemBuilder::new(self.n.0, self.n.1);
        let mut index = vec![0; order.len()];
        for &a in order {
            let (i, j, c) = self.candidates[a];
            index[a] = b.candidate(i, j, c).unwrap();
        }
        for a in 0..order.len() {
            for c in a + 1..order.len() {
                if self.h[a][c] != 0.0 {
                    b.pair(index[a], index[c], self.h[a][c]).unwrap();
                }
            }
        }
        b.unmatched_costs(&self.cost.0, &self.cost.1).unwrap();
        b.must_match_all(self.all);
        b.build().unwrap()
    }

    fn plain_problem(&self) -> Problem {
        self.problem(&(0..self.candidates.len()).collect::<Vec<_>>())
    }

    /// The optimum by enumeration.
    fn brute(&self) -> Option<f64> {
        let mut best = None;
        self.descend(0, &mut vec![false; self.n.1], &mut Vec::new(), 0.0, &mut best);
        best
    }

    fn descend(&self, i: usize, taken: &mut [bool], chosen: &mut Vec<usize>, value: f64, best: &mut Option<f64>) {
        if i == self.n.0 {
            if self.all && chosen.len() < self.n.0.min(self.n.1) {
                return;
            }
            let free = taken.iter().zip(&self.cost.1).filter(|(t, _)| !**t).map(|(_, c)| c).sum::<f64>();
            *best = Some(best.map_or(value - free, |b: f64| b.max(value - free)));
            return;
        }
        self.descend(i + 1, taken, chosen, value - self.cost.0[i], best);
        for a in (0..self.candidates.len()).filter(|&a| self.candidates[a].0 == i) {
            let (_, j, c) = self.candidates[a];
            if !taken[j] {
                let gain = c + chosen.iter().map(|&b| self.h[a.min(b)][a.max(b)]).sum::<f64>();
                taken[j] = true;
                chosen.push(a);
                self.descend(i + 1, taken, chosen, value + gain, best);
                chosen.pop();
                taken[j] = false;
            }
        }
    }
}

/// Weak heuristics, so that branch and bound has work to do.
fn weak(node_limit: u64) -> Limits {
    Limits { node_limit, starts: 0, ..Limits::default() }
}

fn full() -> Limits {
    Limits { node_limit: u64::MAX, starts: 2, idle_moves: 50, ..Limits::default() }
}

fn check_valid(p: &Problem, s: &Solution) {
    assert!(s.pairs.windows(2).all(|w| w[0].0 < w[1].0));
    let mut right: Vec<usize> = s.pairs.iter().map(|x| x.1).collect();
    right.sort_unstable();
    right.dedup();
    assert_eq!(right.len(), s.pairs.len());
    let pairs: Vec<(usize, usize)> = s.candidates.iter().map(|&a| p.candidates()[a]).collect();
    assert_eq!(pairs, s.pairs);
    assert_eq!(p.objective(&s.candidates).unwrap().to_bits(), s.objective.to_bits());
    assert!(s.gap() >= 0.0 && s.objective >= s.heuristic_objective && s.root_bound >= s.upper_bound);
    assert_eq!(s.proved, s.stop == StopReason::Proved);
}

fn compare(case: usize, plain: &Plain, memory: usize) -> u64 {
    let p = plain.plain_problem();
    let Some(optimum) = plain.brute() else {
        assert_eq!(solve(&p, &full(), &Control::default()), Err(SolveError::Infeasible), "case {case}");
        return 0;
    };
    let mut nodes = 0;
    for mut limits in [full(), weak(u64::MAX), weak(0), weak(1), weak(10)] {
        limits.memory = memory;
        let s = solve(&p, &limits, &Control::default()).unwrap();
        check_valid(&p, &s);
        assert!(s.nodes <= limits.node_limit, "case {case}");
        let tolerance = 1e-9 * (1.0 + optimum.abs());
        // The enumeration sums in another order: allow for its rounding, not for ours.
        assert!(s.upper_bound >= optimum - 1e-12 * (1.0 + optimum.abs()), "case {case}: {} < {optimum}", s.upper_bound);
        assert!(s.objective <= optimum + tolerance, "case {case}");
        if s.proved {
            assert!((s.objective - optimum).abs() <= tolerance, "case {case}: {} {optimum}", s.objective);
            assert!(
                s.gap() <= s.resolution + 1e-14 * (1.0 + optimum.abs()),
                "case {case}: gap {} res {}",
                s.gap(),
                s.resolution
            );
        } else {
            assert_eq!(s.stop, StopReason::NodeLimit, "case {case}");
        }
        assert!(s.proved || limits.node_limit != u64::MAX, "case {case}");
        nodes += s.nodes;
    }
    nodes
}

#[test]
fn partial_assignments_equal_enumeration() {
    let mut r = Random(1);
    let mut nodes = 0;
    for case in 0..3000 {
        let plain = Plain::random(&mut r, if case % 10 == 0 { 7 } else { 5 }, false);
        nodes += compare(case, &plain, if case % 7 == 0 { 0 } else { 1 << 28 });
    }
    assert!(nodes > 10_000, "the cases must make the search branch: {nodes}");
}

#[test]
fn complete_assignments_equal_enumeration() {
    let mut r = Random(2);
    for case in 0..1500 {
        let plain = Plain::random(&mut r, if case % 10 == 0 { 7 } else { 5 }, true);
        compare(case, &plain, if case % 7 == 0 { 0 } else { 1 << 28 });
    }
}

#[test]
fn the_best_distinct_assignments_equal_enumeration() {
    let mut r = Random(8);
    for case in 0..400 {
        let plain = Plain::random(&mut r, 4, case % 3 == 0);
        let p = plain.plain_problem();
        let mut all = Vec::new();
        subsets(&p, 0, &mut Vec::new(), &mut all);
        all.sort_by(|x, y| y.total_cmp(x));
        if all.is_empty() {
            continue;
        }
        for solutions in [1, 2, 5, 1000] {
            let s = solve(&p, &Limits { solutions, ..weak(u64::MAX) }, &Control::default()).unwrap();
            assert_eq!((s.stop, s.ranked.len()), (StopReason::Proved, all.len().min(solutions)), "case {case}");
            assert_eq!((&s.ranked[0].candidates, s.ranked[0].objective), (&s.candidates, s.objective));
            for (k, (found, expected)) in s.ranked.iter().zip(&all).enumerate() {
                assert_eq!(p.objective(&found.candidates), Some(found.objective));
                let distinct = s.ranked[..k].iter().all(|other| other.candidates != found.candidates);
                // Closer than the resolution, two may come in either order.
                let close = (found.objective - expected).abs() <= s.resolution;
                assert!(distinct && close, "case {case} {k}: {} {expected}", found.objective);
            }
        }
    }
}

/// The objectives of all assignments.
fn subsets(p: &Problem, from: usize, chosen: &mut Vec<usize>, all: &mut Vec<f64>) {
    all.extend(p.objective(chosen));
    for a in from..p.candidates().len() {
        let (i, j) = p.candidates()[a];
        if chosen.iter().all(|&b| p.candidates()[b].0 != i && p.candidates()[b].1 != j) {
            chosen.push(a);
            subsets(p, a + 1, chosen, all);
            chosen.pop();
        }
    }
}

#[test]
fn order_and_relabelling_do_not_change_the_optimum() {
    let mut r = Random(3);
    for _ in 0..200 {
        let plain = Plain::random(&mut r, 6, false);
        let p = plain.plain_problem();
        let reference = solve(&p, &full(), &Control::default()).unwrap();
        assert_eq!(reference, solve(&p, &full(), &Control::default()).unwrap());
        // Same problem, candidates added in another order: the same pairs and bits.
        let mut order: Vec<usize> = (0..plain.candidates.len()).collect();
        for k in (1..order.len()).rev() {
            order.swap(k, r.below(k + 1));
        }
        let shuffled = solve(&plain.problem(&order), &full(), &Control::default()).unwrap();
        assert_eq!((&shuffled.pairs, shuffled.objective.to_bits()), (&reference.pairs, reference.objective.to_bits()));
        // Features relabelled: the same objective up to rounding.
        let mut other = plain.clone();
        other.candidates.iter_mut().for_each(|c| *c = (plain.n.0 - 1 - c.0, plain.n.1 - 1 - c.1, c.2));
        other.cost.0.reverse();
        other.cost.1.reverse();
        let relabelled = solve(&other.plain_problem(), &full(), &Control::default()).unwrap();
        assert!((relabelled.objective - reference.objective).abs() <= 1e-12 * (1.0 + reference.objective.abs()));
    }
}

#[test]
fn qaplib_form_equals_enumeration_of_permutations() {
    let mut r = Random(4);
    for _ in 0..60 {
        let n = 1 + r.below(6);
        let mut draw = || (0..n * n).map(|_| r.below(10) as f64).collect::<Vec<_>>();
        let (a, b) = (draw(), draw());
        let p = Problem::from_qaplib(n, &a, &b).unwrap();
        let s = solve(&p, &full(), &Control::default()).unwrap();
        let mut best = f64::INFINITY;
        let mut perm: Vec<usize> = (0..n).collect();
        permutations(&mut perm, 0, &mut |q| {
            let cost = (0..n * n).map(|e| a[e] * b[q[e / n] * n + q[e % n]]).sum::<f64>();
            best = best.min(cost);
        });
        assert_eq!(s.objective, -best + 0.0);
        assert_eq!((s.proved, s.gap(), s.resolution), (true, 0.0, 0.0));
        assert_eq!(s.pairs.len(), n);
    }
}

fn permutations(p: &mut Vec<usize>, at: usize, visit: &mut impl FnMut(&[usize])) {
    if at == p.len() {
        return visit(p);
    }
    for k in at..p.len() {
        p.swap(at, k);
        permutations(p, at + 1, visit);
        p.swap(at, k);
    }
}

#[test]
fn small_and_empty_problems() {
    let run = |b: ProblemBuilder| solve(&b.build().unwrap(), &full(), &Control::default()).unwrap();
    for (n, m) in [(0, 0), (0, 3), (4, 2)] {
        let mut b = ProblemBuilder::new(n, m);
        b.unmatched_cost(0.25).unwrap();
        let s = run(b);
        assert_eq!((s.pairs.len(), s.objective, s.proved), (0, -0.25 * (n + m) as f64, true));
    }
    for (score, cost, expected) in
        [(2.0, 0.0, 2.0), (-2.0, 0.0, 0.0), (-2.0, 0.75, -1.5), (-2.0, 1.5, -2.0), (0.0, 0.0, 0.0)]
    {
        let mut b = ProblemBuilder::new(1, 1);
        b.candidate(0, 0, score).unwrap();
        b.unmatched_cost(cost).unwrap();
        let s = run(b);
        assert_eq!((s.objective, s.upper_bound, s.proved), (expected, expected, true));
    }
    let mut b = ProblemBuilder::new(2, 2);
    b.candidate(0, 0, 1.0).unwrap();
    b.candidate(1, 0, 1.0).unwrap();
    b.must_match_all(true);
    assert_eq!(solve(&b.build().unwrap(), &full(), &Control::default()), Err(SolveError::Infeasible));
}

#[test]
fn extreme_magnitudes_keep_a_valid_bound() {
    for scale in [1e-300, 1e-30, 1.0, 1e30, 1e290, f64::MIN_POSITIVE / 8.0] {
        let mut b = ProblemBuilder::new(3, 3);
        for i in 0..3 {
            for j in 0..3 {
                b.candidate(i, j, scale * (1 + (i * 5 + j * 7) % 4) as f64).unwrap();
            }
        }
        b.pair(0, 4, -scale).unwrap();
        b.pair(1, 5, scale * 2.0).unwrap();
        let p = b.build().unwrap();
        let s = solve(&p, &full(), &Control::default()).unwrap();
        check_valid(&p, &s);
        assert!(s.proved && s.objective > 0.0 && s.gap() <= 1e-9 * s.objective, "{scale}: {s:?}");
    }
}

#[test]
fn invalid_input_is_refused_with_its_place() {
    let mut b = ProblemBuilder::new(2, 3);
    assert_eq!(b.candidate(2, 0, 1.0), Err(ProblemError::FeatureOutOfRange { side: "left", index: 2, count: 2 }));
    assert_eq!(b.candidate(0, 3, 1.0), Err(ProblemError::FeatureOutOfRange { side: "right", index: 3, count: 3 }));
    assert!(matches!(b.candidate(0, 0, f64::NAN), Err(ProblemError::NonFinite { .. })));
    assert_eq!((b.candidate(0, 0, 1.0), b.candidate(0, 1, 1.0), b.candidate(1, 1, 1.0)), (Ok(0), Ok(1), Ok(2)));
    assert_eq!(b.pair(0, 3, 1.0), Err(ProblemError::CandidateOutOfRange { index: 3, count: 3 }));
    assert_eq!(b.pair(1, 1, 1.0), Err(ProblemError::SelfPair { a: 1 }));
    assert_eq!(b.pair(0, 1, 1.0), Err(ProblemError::ExclusivePair { a: 0, b: 1 }));
    assert_eq!(b.pair(1, 2, 1.0), Err(ProblemError::ExclusivePair { a: 1, b: 2 }));
    assert!(matches!(b.pair(0, 2, f64::INFINITY), Err(ProblemError::NonFinite { .. })));
    assert!(matches!(b.unmatched_cost(f64::NAN), Err(ProblemError::NonFinite { .. })));
    assert!(matches!(
        b.unmatched_costs(&[0.0], &[0.0; 3]),
        Err(ProblemError::WrongLength { found: 1, expected: 2, .. })
    ));
    b.pair(2, 0, 1.0).unwrap();
    let mut twice = b.clone();
    twice.pair(0, 2, 1.0).unwrap();
    assert_eq!(twice.build().unwrap_err(), ProblemError::DuplicatePair { a: 0, b: 2 });
    let mut twice = b.clone();
    twice.candidate(0, 1, 0.0).unwrap();
    assert_eq!(twice.build().unwrap_err(), ProblemError::DuplicateCandidate { left: 0, right: 1 });
    let mut large = b.clone();
    large.candidate(1, 2, 1e308).unwrap();
    large.candidate(1, 0, -1e308).unwrap();
    assert_eq!(large.build().unwrap_err(), ProblemError::TooLarge);
    assert!(matches!(Problem::from_qaplib(2, &[0.0; 3], &[0.0; 4]), Err(ProblemError::WrongLength { what: "A", .. })));
    let p = b.build().unwrap();
    assert_eq!((p.objective(&[0, 2]), p.objective(&[0, 1]), p.objective(&[9])), (Some(3.0), None, None));
}

#[test]
fn a_stop_ends_the_search_with_a_valid_bound() {
    let mut r = Random(6);
    let (mut stopped, mut proved) = (0, 0);
    for case in 0..200 {
        let plain = Plain::random(&mut r, 5, false);
        let p = plain.plain_problem();
        let (calls, reports) = (Cell::new(0), Cell::new(0));
        let stop = || {
            calls.set(calls.get() + 1);
            calls.get() > case % 10
        };
        let progress = |_: &salient_kernels::assignment::Progress| reports.set(reports.get() + 1);
        let s =
            solve(&p, &weak(u64::MAX), &Control { stop: &stop, progress: &progress, ..Control::default() }).unwrap();
        check_valid(&p, &s);
        assert!(s.upper_bound >= plain.brute().unwrap() - 1e-12);
        assert!(reports.get() >= s.nodes);
        if s.stop == StopReason::Stopped {
            stopped += 1;
        } else {
            proved += 1;
        }
    }
    assert!(stopped > 0 && proved > 0, "{stopped} {proved}");
}
