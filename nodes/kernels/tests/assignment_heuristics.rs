//! The heuristics one by one, against proved optima; and what holds of the solver on problems like the matcher's.

#![expect(clippy::float_cmp, reason = "exact equality is what is claimed")]
#![expect(clippy::unwrap_used, reason = "helpers of tests lie outside any test function")]

use salient_kernels::assignment::{
    Control, Heuristics, Limits, Problem, ProblemBuilder, Proposal, StopReason, Synthetic, solve,
};
use std::cell::RefCell;

fn problems() -> Vec<Problem> {
    let mut all = Vec::new();
    for seed in 0..4 {
        for shift in [0.0, 0.3] {
            all.push(Synthetic { shift, ..Synthetic::hard(20, seed) }.build().unwrap().0);
            all.push(Synthetic { shift, right: 13, ..Synthetic::none(16, seed) }.build().unwrap().0);
        }
    }
    all
}

fn optimum(p: &Problem) -> f64 {
    let s = solve(p, &Limits { node_limit: 100_000, ..Limits::default() }, &Control::default()).unwrap();
    assert!(s.proved);
    s.objective
}

#[test]
fn every_heuristic_proposes_an_assignment_near_the_optimum() {
    // Sums over all problems of what each reaches of the optimum.
    let mut share = [0.0; 5];
    let problems = problems();
    for p in &problems {
        let best = optimum(p);
        let h = Heuristics::new(p);
        let (greedy, spectral) = (h.greedy().unwrap(), h.spectral(200).unwrap());
        let ipfp = h.frank_wolfe(None, 50).unwrap();
        let tabu = h.tabu(None, 5, 300, 7).unwrap();
        assert_eq!(Some(&tabu), h.tabu(None, 5, 300, 7).as_ref());
        let proposals = [greedy, spectral, ipfp];
        let fused = h.fuse(&proposals, 100).unwrap();
        for proposal in proposals.iter().chain([&tabu, &fused]) {
            assert_eq!(p.objective(&proposal.candidates), Some(proposal.objective));
            assert!(proposal.objective <= best);
        }
        assert!(proposals.iter().all(|x| x.objective <= fused.objective));
        for start in &proposals {
            assert!(h.frank_wolfe(Some(start), 50).unwrap().objective >= start.objective);
            assert!(h.tabu(Some(start), 1, 50, 1).unwrap().objective >= start.objective);
        }
        for (share, proposal) in share.iter_mut().zip(proposals.iter().chain([&fused, &tabu])) {
            *share += proposal.objective / best / problems.len() as f64;
        }
    }
    let [greedy, spectral, ipfp, fused, tabu] = share;
    assert!(greedy > 0.85 && spectral > 0.65 && ipfp > 0.95 && fused > 0.95 && tabu > 0.999, "{share:?}");
}

#[test]
fn fusion_is_the_best_assignment_of_the_proposed_candidates() {
    for p in problems() {
        let h = Heuristics::new(&p);
        let all: Vec<Proposal> = p
            .candidates()
            .iter()
            .enumerate()
            .map(|(a, _)| Proposal { candidates: vec![a], objective: p.objective(&[a]).unwrap() })
            .collect();
        assert_eq!(h.fuse(&all, 100_000).unwrap().objective, optimum(&p));
        assert_eq!(h.fuse(&all[..1], 10).unwrap().objective, p.objective(&[]).unwrap().max(all[0].objective));
    }
}

#[test]
fn what_cannot_be_is_none() {
    let mut b = ProblemBuilder::new(2, 2);
    b.candidate(0, 0, 1.0).unwrap();
    b.candidate(1, 0, 1.0).unwrap();
    let free = b.clone().build().unwrap();
    let h = Heuristics::new(&free);
    for bad in [vec![0, 1], vec![5]] {
        let bad = Proposal { candidates: bad, objective: 0.0 };
        assert_eq!((h.tabu(Some(&bad), 1, 5, 0), h.frank_wolfe(Some(&bad), 5)), (None, None));
    }
    b.must_match_all(true);
    let p = b.build().unwrap();
    let h = Heuristics::new(&p);
    assert_eq!([h.greedy(), h.spectral(9), h.frank_wolfe(None, 9), h.tabu(None, 2, 9, 0)], [None, None, None, None]);
    let empty = ProblemBuilder::new(0, 3).build().unwrap();
    let h = Heuristics::new(&empty);
    for found in [h.greedy(), h.spectral(9), h.frank_wolfe(None, 9), h.tabu(None, 2, 9, 0), h.fuse(&[], 9)] {
        assert_eq!(found, Some(Proposal { candidates: vec![], objective: 0.0 }));
    }
}

/// Left and right exchanged, candidates and pairs in another order.
fn swapped(p: &Problem) -> Problem {
    let text = salient_kernels::assignment::dd::write(p).unwrap().text;
    let mut lines: Vec<String> = Vec::new();
    let number = |w: &str| w.parse::<usize>().unwrap();
    let m = p.candidates().len();
    for line in text.lines() {
        let w: Vec<&str> = line.split(' ').collect();
        lines.push(match w[0] {
            "p" => format!("p {} {} {} {}", w[2], w[1], w[3], w[4]),
            "a" => format!("a {} {} {} {}", m - 1 - number(w[1]), w[3], w[2], w[4]),
            _ => format!("e {} {} {}", m - 1 - number(w[1]), m - 1 - number(w[2]), w[3]),
        });
    }
    lines[1..].reverse();
    // Assignments first: their lines are now the last.
    salient_kernels::assignment::dd::read(&lines.join("\n")).unwrap()
}

#[test]
fn a_swap_of_left_and_right_changes_nothing() {
    let limits = Limits { node_limit: 5, solutions: 3, starts: 60, ..Limits::default() };
    let mut open = 0;
    for p in problems().into_iter().chain([Synthetic::none(30, 9).build().unwrap().0]) {
        let q = swapped(&p);
        let trace = |p: &Problem| {
            let seen = RefCell::new(Vec::new());
            let progress = |s: &salient_kernels::assignment::Progress| {
                seen.borrow_mut().push((s.nodes, s.objective, s.upper_bound));
            };
            let s = solve(p, &limits, &Control { progress: &progress, ..Control::default() }).unwrap();
            (seen.into_inner(), s)
        };
        let ((path, s), (other_path, t)) = (trace(&p), trace(&q));
        assert_eq!(path, other_path);
        assert_eq!(s.objective.to_bits(), t.objective.to_bits());
        assert_eq!(s.upper_bound.to_bits(), t.upper_bound.to_bits());
        assert_eq!(s.root_bound.to_bits(), t.root_bound.to_bits());
        let mut pairs: Vec<_> = t.pairs.iter().map(|&(i, j)| (j, i)).collect();
        pairs.sort_unstable();
        assert_eq!(s.pairs, pairs);
        open += usize::from(s.stop == StopReason::NodeLimit);
    }
    assert!(open > 3, "some must stop with a gap: {open}");
}

#[test]
fn threads_change_nothing() {
    let (problem, _) = Synthetic::none(30, 2).build().unwrap();
    let limits = Limits { node_limit: 2, solutions: 3, starts: 200, ..Limits::default() };
    let alone = solve(&problem, &limits, &Control::default()).unwrap();
    let threads = |n: usize, call: &(dyn Fn(usize) + Sync)| {
        std::thread::scope(|scope| (0..n).rev().for_each(|i| drop(scope.spawn(move || call(i)))));
    };
    let together = solve(&problem, &limits, &Control { spread: &threads, ..Control::default() }).unwrap();
    assert_eq!(alone, together);
}
