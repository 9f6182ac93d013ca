//! `.dd` and QAPLIB text: what is written is read back, and what is wrong is told with its line.

#![expect(clippy::float_cmp, reason = "exact equality is what is claimed")]

use salient_kernels::assignment::qaplib::{Qap, QapSolution};
use salient_kernels::assignment::{Control, Limits, Problem, ProblemBuilder, Synthetic, dd, solve};

const SMALL: &str =
    "c a comment\n\np 2 3 3 2\na 0 0 2 -1.5\na 2 1 0 0.25\na 1 1 1 -1e-1\ni0 0 {1 2 3}\ne 1 0 -2\ne 0 2 0.5\nn0 0 1\n";

#[test]
fn dd_means_minus_cost() {
    let p = dd::read(SMALL).unwrap();
    assert_eq!((p.features(), p.candidates()), ((2, 3), &[(0, 2), (1, 1), (1, 0)][..]));
    assert_eq!(p.objective(&[0]), Some(1.5));
    assert_eq!(p.objective(&[0, 1]), Some(1.5 + 0.1 + 2.0));
    assert_eq!(p.objective(&[2, 0]), Some(1.5 - 0.25 - 0.5));
    assert_eq!(p.objective(&[]), Some(0.0));
}

#[test]
fn edges_of_exclusive_assignments_are_left_out() {
    let p = dd::read("p 1 2 2 1\na 0 0 0 -1\na 1 0 1 -2\ne 0 1 -50\n").unwrap();
    let s = solve(&p, &Limits::default(), &Control::default()).unwrap();
    assert_eq!((s.objective, s.proved), (2.0, true));
}

#[test]
fn dd_is_read_back_as_written() {
    for shift in [0.0, 0.4] {
        let (p, _) = Synthetic { shift, ..Synthetic::hard(12, 3) }.build().unwrap();
        let written = dd::write(&p).unwrap();
        let q = dd::read(&written.text).unwrap();
        assert_eq!(dd::write(&q).unwrap(), written);
        assert_eq!(written.offset, 0.0);
        let chosen = solve(&p, &Limits::default(), &Control::default()).unwrap();
        assert_eq!(q.objective(&chosen.candidates).unwrap().to_bits(), chosen.objective.to_bits());
    }
}

#[test]
fn unmatched_costs_become_an_offset() {
    let mut b = ProblemBuilder::new(2, 2);
    b.candidate(0, 0, 1.0).unwrap();
    b.candidate(1, 1, -4.0).unwrap();
    b.pair(0, 1, 0.5).unwrap();
    b.unmatched_costs(&[0.25, 2.0], &[0.5, 1.0]).unwrap();
    let p = b.clone().build().unwrap();
    let written = dd::write(&p).unwrap();
    let q = dd::read(&written.text).unwrap();
    for set in [&[][..], &[0], &[1], &[0, 1]] {
        assert_eq!(p.objective(set).unwrap(), written.offset + q.objective(set).unwrap());
    }
    b.must_match_all(true);
    assert_eq!(dd::write(&b.build().unwrap()), None);
}

#[test]
fn what_is_wrong_in_a_dd_file_is_told_with_its_line() {
    let cases = [
        ("", 0, "there is no `p` line"),
        ("c x\nq 1 2\n", 2, "`p` line must come before"),
        ("a 0 0 0 1\n", 1, "`p` line must come before"),
        ("p 1 1 0\n", 1, "4 numbers"),
        ("p 1 1 -1 0\n", 1, "`-1` is no index"),
        ("p 1 1 99999999999 0\n", 1, "not supported"),
        ("p 1 1 0 0\np 1 1 0 0\n", 2, "second `p`"),
        ("p 1 1 0 0\nz\n", 2, "`z` is none of"),
        ("p 1 1 1 0\na 0 0 0\n", 2, "4 numbers"),
        ("p 1 1 1 0\na 0 0 0 x\n", 2, "`x` is no finite number"),
        ("p 1 1 1 0\na 0 0 0 inf\n", 2, "`inf` is no finite number"),
        ("p 1 1 1 0\na 0 0 0 nan\n", 2, "`nan` is no finite number"),
        ("p 1 1 1 0\na 1 0 0 1\n", 2, "assignment 1, but"),
        ("p 1 1 1 0\na 0 1 0 1\n", 2, "left feature 1"),
        ("p 1 1 1 0\na 0 0 7 1\n", 2, "right feature 7"),
        ("p 1 2 2 0\na 0 0 0 1\na 0 0 1 1\n", 3, "given in line 2"),
        ("p 1 2 2 0\na 0 0 0 1\na 1 0 0 1\n", 3, "assigned in line 2"),
        ("p 1 1 1 0\n", 1, "0 assignments, but"),
        ("p 2 2 2 1\na 0 0 0 1\na 1 1 1 1\n", 3, "0 edges, but"),
        ("p 2 2 2 1\na 0 0 0 1\na 1 1 1 1\ne 0 1\n", 4, "3 numbers"),
        ("p 2 2 2 1\na 0 0 0 1\na 1 1 1 1\ne 0 2 1\n", 4, "assignment 2, but"),
        ("p 2 2 2 1\na 0 0 0 1\na 1 1 1 1\ne 1 1 1\n", 4, "paired with itself"),
        ("p 2 2 2 2\na 0 0 0 1\na 1 1 1 1\ne 0 1 1\ne 1 0 1\n", 5, "given in line 4"),
        ("p 2 2 2 1\na 0 0 0 1e308\na 1 1 1 1e308\ne 0 1 1e308\n", 4, "too large"),
    ];
    for (text, line, message) in cases {
        let error = dd::read(text).unwrap_err();
        assert_eq!(error.line, line, "{text:?}: {error}");
        assert!(error.to_string().contains(message), "{text:?}: {error}");
    }
}

#[test]
fn damaged_text_is_an_error_or_a_problem_and_never_a_panic() {
    let qap = "3\n0 1 2\n1 0 3\n2 3 0\n\n0 5 1\n5 0 2\n1 2 0\n";
    for text in [SMALL, qap] {
        for at in 0..text.len() {
            for damage in ["", "-", "9", " ", "\n", "e", "p", "\u{e9}"] {
                let damaged = format!("{}{damage}{}", &text[..at], &text[at + 1..]);
                let _ = dd::read(&damaged);
                let _ = Qap::read(&damaged);
                let _ = QapSolution::read(&damaged);
            }
        }
    }
}

#[test]
fn qaplib_instances_and_solutions() {
    let text = "2\n0 3\n1 0\n\n4 5\n6 7\n";
    let q = Qap::read(text).unwrap();
    assert_eq!((q.n, &q.a[..], &q.b[..]), (2, &[0.0, 3.0, 1.0, 0.0][..], &[4.0, 5.0, 6.0, 7.0][..]));
    assert_eq!(Qap::read(&q.write()).unwrap(), q);
    assert_eq!((q.cost(&[0, 1]), q.cost(&[1, 0]), q.cost(&[0, 0])), (Some(21.0), Some(23.0), None));
    let s = solve(&q.problem().unwrap(), &Limits::default(), &Control::default()).unwrap();
    assert_eq!((s.objective, s.pairs), (-21.0, vec![(0, 0), (1, 1)]));
    let solution = QapSolution::read("2 21\n1,2\n").unwrap();
    assert_eq!(solution, QapSolution { cost: 21.0, permutation: vec![0, 1] });
    assert_eq!(QapSolution::read(&solution.write()).unwrap(), solution);
    assert_eq!(Qap::read("0\n").unwrap().problem().unwrap().features(), (0, 0));
    let cases: [(&str, usize, &str); 6] = [
        ("", 0, "before the size"),
        ("x\n", 1, "`x` is no index"),
        ("2\n0 1 1 0\n0 1\n1", 4, "before entry (2, 2) of the second matrix"),
        ("1\n0\nq\n", 3, "`q` is no finite number"),
        ("1\n0\n0\n5\n", 4, "follows the last"),
        ("10001\n", 1, "above 10000"),
    ];
    for (text, line, message) in cases {
        let error = Qap::read(text).unwrap_err();
        assert!(error.line == line && error.message.contains(message), "{text:?}: {error}");
    }
    for text in ["2 1\n1 1\n", "2 1\n0 1\n", "2 1\n1 3\n", "2 1\n1\n", "1 1\n1 2\n"] {
        assert!(QapSolution::read(text).is_err(), "{text:?}");
    }
}

#[test]
fn generated_problems_are_as_described() {
    let make = |s: &Synthetic| -> (Problem, Vec<Option<usize>>) { s.build().unwrap() };
    let hard = Synthetic::hard(30, 5);
    let (p, truth) = make(&hard);
    assert_eq!((p.features(), p.candidates().len()), ((30, 30), 180));
    assert_eq!(truth.iter().flatten().count(), 21);
    for (i, j) in truth.iter().enumerate().filter_map(|(i, j)| Some((i, (*j)?))) {
        assert!(p.candidates().contains(&(i, j)));
    }
    assert_eq!(dd::write(&p), dd::write(&make(&hard).0));
    assert_ne!(dd::write(&p), dd::write(&make(&Synthetic::hard(30, 6)).0));
    assert_eq!(make(&Synthetic::none(30, 5)).1, vec![None; 30]);
}
