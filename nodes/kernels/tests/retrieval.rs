//! Figures of ranked lists: by hand, and against golden/retrieval.py, which writes them from the definitions.

// A test may fail where it stands.
#![allow(clippy::unwrap_used)]

use salient_kernels::retrieval::{Merit, ranked};

const GOLDEN: &str = include_str!("golden/retrieval.csv");

fn values(m: &Merit) -> Vec<f64> {
    [m.nn, m.first_tier, m.second_tier, m.e, m.dcg, m.map, m.recall].into_iter().chain(m.precision).collect()
}

#[test]
fn an_independent_script_agrees() {
    let mut cases = 0;
    for line in GOLDEN.lines() {
        let cells: Vec<&str> = line.split(',').collect();
        let relevant: Vec<bool> = cells[1].chars().map(|c| c == '1').collect();
        let merit = Merit::of(&relevant, cells[2].parse().unwrap()).unwrap();
        for (i, (found, expected)) in values(&merit).iter().zip(&cells[3..]).enumerate() {
            let expected: f64 = expected.parse().unwrap();
            assert!((found - expected).abs() < 1e-12, "{} figure {i}: {found}, not {expected}", cells[0]);
        }
        assert_eq!(cells.len(), 3 + 18);
        cases += 1;
    }
    assert_eq!(cases, 60);
}

#[test]
fn by_hand() {
    // Of a class of 3 (besides the query), found at places 1, 3 and 6 of 6.
    let merit = Merit::of(&[true, false, true, false, false, true], 3).unwrap();
    let ideal = 1.0 + 1.0 + 1.0 / 3f64.log2();
    let expected = [
        1.0,
        2.0 / 3.0,
        1.0,
        2.0 / 3.0,
        (1.0 + 1.0 / 3f64.log2() + 1.0 / 6f64.log2()) / ideal,
        (1.0 + 2.0 / 3.0 + 0.5) / 3.0,
        1.0,
    ];
    for (found, expected) in values(&merit).iter().zip(expected) {
        assert!((found - expected).abs() < 1e-15, "{found}, not {expected}");
    }
    // A third is found at once, two thirds at a precision of 2/3, all at 1/2.
    let third = 2.0 / 3.0;
    assert_eq!(merit.precision, [1.0, 1.0, 1.0, 1.0, third, third, third, 0.5, 0.5, 0.5, 0.5]);
}

#[test]
fn a_perfect_list_is_1_but_for_e_and_an_empty_class_has_none() {
    let relevant: Vec<bool> = (0..40).map(|i| i < 19).collect();
    let merit = Merit::of(&relevant, 19).unwrap();
    let e = 2.0 * 19.0 / (32.0 + 19.0);
    assert!(values(&merit).iter().enumerate().all(|(i, x)| (x - if i == 3 { e } else { 1.0 }).abs() < 1e-15));
    assert_eq!(Merit::of(&relevant, 0), None);
    assert_eq!(Merit::mean([]), None);
    let worst = Merit::of(&[false], 1).unwrap();
    assert_eq!(Merit::mean([&merit, &worst]).unwrap().nn, 0.5);
}

#[test]
fn equal_scores_are_ranked_by_name() {
    let names = ["b", "a", "c"];
    assert_eq!(ranked(&[0.5, 0.5, 1.0], |i| names[i], usize::MAX), [2, 1, 0]);
}
