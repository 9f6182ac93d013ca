//! Panel solves with a factor.

use super::factor::{Factor, TOGETHER};
use super::panel::{Row, add_multiple};
use crate::multifrontal::{Supernode, Symbolic};
use crate::simd::vectorised;

/// Replaces x by (L D L')^-1 x.
pub(super) fn solve<const B: usize>(symbolic: &Symbolic, factor: &Factor, x: &mut [Row<B>]) {
    vectorised(
        #[inline(always)]
        || {
            let mut values = factor.values.as_slice();
            for s in 0..symbolic.nodes.len() {
                forward(symbolic, s, &mut values, x);
            }
            for (row, inverse) in x.iter_mut().zip(&factor.inverse_pivots) {
                for lane in row {
                    *lane *= inverse;
                }
            }
            let mut values = factor.values.as_slice();
            for s in (0..symbolic.nodes.len()).rev() {
                backward(symbolic, s, &mut values, x);
            }
        },
    );
}

/// What a group of columns meets.
struct Reach<'a, const B: usize> {
    /// The panel's rows of the supernode's columns, from the group's first on.
    own: &'a mut [Row<B>],
    /// The panel's rows after the supernode, from row `end` on, and those of them that it touches.
    after: &'a mut [Row<B>],
    end: usize,
    rows: &'a [u32],
}

#[inline(always)]
fn reach<'a, const B: usize>(symbolic: &'a Symbolic, s: usize, x: &'a mut [Row<B>]) -> Reach<'a, B> {
    let Supernode { begin, end, .. } = symbolic.nodes[s];
    let (head, after) = x.split_at_mut(end);
    Reach { own: &mut head[begin..], after, end, rows: &symbolic.rows[symbolic.nodes[s].below()] }
}

#[inline(always)]
fn forward<const B: usize>(symbolic: &Symbolic, s: usize, values: &mut &[f64], x: &mut [Row<B>]) {
    let Reach { mut own, after, end, rows } = reach(symbolic, s, x);
    while !own.is_empty() {
        let group = Reach { own, after, end, rows };
        let done = match group.own.len() {
            TOGETHER.. => forward_group::<TOGETHER, B>(group, values),
            2.. => forward_group::<2, B>(group, values),
            _ => forward_group::<1, B>(group, values),
        };
        own = &mut own[done..];
    }
}

/// Solves for C columns, and subtracts them from all rows that they meet; C.
#[inline(always)]
fn forward_group<const C: usize, const B: usize>(reach: Reach<'_, B>, values: &mut &[f64]) -> usize {
    let Reach { own, after, end, rows } = reach;
    let (group, rest) = values.split_at(C * (own.len() + rows.len()));
    *values = rest;
    let (triangle, lines) = group.as_chunks::<C>().0.split_at(C);
    let (top, others) = own.split_at_mut(C);
    let mut x: [Row<B>; C] = std::array::from_fn(|c| top[c]);
    for i in 1..C {
        for c in 0..i {
            let known = x[c];
            add_multiple(&mut x[i], -triangle[i][c], &known);
        }
    }
    top.copy_from_slice(&x);
    let (inside, below) = lines.split_at(others.len());
    for (line, y) in inside.iter().zip(others) {
        subtract_line(y, line, &x);
    }
    for (line, &row) in below.iter().zip(rows) {
        subtract_line(&mut after[row as usize - end], line, &x);
    }
    C
}

#[inline(always)]
fn subtract_line<const C: usize, const B: usize>(y: &mut Row<B>, line: &[f64; C], x: &[Row<B>; C]) {
    let mut sum = *y;
    for c in 0..C {
        add_multiple(&mut sum, -line[c], &x[c]);
    }
    *y = sum;
}

/// The groups of a supernode from the last one.
#[inline(always)]
fn backward<const B: usize>(symbolic: &Symbolic, s: usize, values: &mut &[f64], x: &mut [Row<B>]) {
    let Reach { own, after, end, rows } = reach(symbolic, s, x);
    let mut first = own.len();
    while first > 0 {
        let last = if first % TOGETHER == 0 { TOGETHER } else { 2 - first % 2 };
        first -= last;
        let group = Reach { own: &mut own[first..], after, end, rows };
        match last {
            TOGETHER => backward_group::<TOGETHER, B>(group, values),
            2 => backward_group::<2, B>(group, values),
            _ => backward_group::<1, B>(group, values),
        }
    }
}

/// Subtracts from C rows what they meet, and solves for them.
#[inline(always)]
fn backward_group<const C: usize, const B: usize>(reach: Reach<'_, B>, values: &mut &[f64]) {
    let Reach { own, after, end, rows } = reach;
    let (rest, group) = values.split_at(values.len() - C * (own.len() + rows.len()));
    *values = rest;
    let (triangle, lines) = group.as_chunks::<C>().0.split_at(C);
    let (top, others) = own.split_at_mut(C);
    let (inside, below) = lines.split_at(others.len());
    // Two rows in flight, so that sums do not wait for each other.
    let mut sums = [[[0.0; B]; C]; 2];
    for (i, (line, y)) in inside.iter().zip(&*others).enumerate() {
        add_line(&mut sums[i % 2], line, y);
    }
    let ((lines, line), (pairs, single)) = (below.as_chunks::<2>(), rows.as_chunks::<2>());
    for (lines, pair) in lines.iter().zip(pairs) {
        add_line(&mut sums[0], &lines[0], &after[pair[0] as usize - end]);
        add_line(&mut sums[1], &lines[1], &after[pair[1] as usize - end]);
    }
    for (line, &row) in line.iter().zip(single) {
        add_line(&mut sums[0], line, &after[row as usize - end]);
    }
    for c in (0..C).rev() {
        for l in 0..B {
            top[c][l] -= sums[0][c][l] + sums[1][c][l];
        }
        for i in c + 1..C {
            let known = top[i];
            add_multiple(&mut top[c], -triangle[i][c], &known);
        }
    }
}

#[inline(always)]
fn add_line<const C: usize, const B: usize>(sums: &mut [Row<B>; C], line: &[f64; C], y: &Row<B>) {
    for c in 0..C {
        add_multiple(&mut sums[c], line[c], y);
    }
}

#[cfg(test)]
mod tests {
    use super::super::factor::Factor;
    use super::super::problem::{Problem, problems};
    use super::super::tridiagonal;
    use super::*;
    use crate::adjacency::on_rim;
    use crate::laplacian::{Area, laplacian};
    use crate::multifrontal::Fronts;
    use crate::random::Random;

    /// A bent grid of p by q squares, its vertices in random order, and its problems.
    fn grid(p: usize, q: usize) -> Vec<Problem> {
        let mut random = Random::new(&[p as u64, q as u64]);
        let n = (p + 1) * (q + 1);
        let mut names: Vec<u32> = (0..n as u32).collect();
        names.sort_by_cached_key(|_| (1e9 * random.unit()) as u64);
        let (mut points, mut faces) = (vec![[0.0; 3]; n], Vec::new());
        for j in 0..=q {
            for i in 0..=p {
                let name = |i: usize, j: usize| names[j * (p + 1) + i];
                let (x, y) = (i as f64 + 0.2 * random.signed(), j as f64 + 0.2 * random.signed());
                points[name(i, j) as usize] = [x, y, (0.3 * x).sin()];
                if i < p && j < q {
                    faces.push([name(i, j), name(i + 1, j), name(i + 1, j + 1)]);
                    faces.push([name(i, j), name(i + 1, j + 1), name(i, j + 1)]);
                }
            }
        }
        let operator = laplacian(&points, &faces, Area::Mixed, false).expect("a grid");
        problems(&operator, &on_rim(n, &faces)).expect("memory")
    }

    #[test]
    fn factors_count_and_solve() {
        let mut fronts = Fronts::default();
        // The last one has separators wider than a group of chunks.
        for (p, q, shift) in [(1, 1, 20.0), (40, 1, 100.0), (9, 7, 60.0), (45, 40, 90.0)] {
            let problems = grid(p, q);
            assert_eq!(problems.len(), if q > 1 { 2 } else { 1 });
            for problem in &problems {
                let (n, a) = (problem.n(), problem.dense());
                if n < 500 {
                    let values = tridiagonal::eigenvalues(&mut a.clone(), n, &mut []).expect("converges");
                    let below = values.iter().filter(|x| **x < shift).count();
                    assert_eq!(problem.count_below(shift, &mut fronts), Some(below));
                }
                let mut factor = Factor::default();
                let below = factor.compute(problem, shift, &mut fronts);
                assert_eq!(below, problem.count_below(shift, &mut fronts));
                assert_eq!(factor.values.len(), factor.values.capacity(), "it has grown");
                let mut random = Random::new(&[7]);
                let x: Vec<Row<4>> = (0..n).map(|_| std::array::from_fn(|_| random.signed())).collect();
                let mut y: Vec<Row<4>> = x.iter().map(|row| row.map(|x| -shift * x)).collect();
                for (y, line) in y.iter_mut().zip(a.chunks_exact(n)) {
                    for (entry, x) in line.iter().zip(&x) {
                        add_multiple(y, *entry, x);
                    }
                }
                solve(&problem.symbolic, &factor, &mut y);
                let near = |(x, y): (&Row<4>, &Row<4>)| (0..4).all(|l| (x[l] - y[l]).abs() < 1e-9);
                assert!(x.iter().zip(&y).all(near), "{p} x {q}, {n}");
            }
        }
    }

    #[test]
    fn breakdown_is_told() {
        // The first pivot is exactly zero.
        let problem = &grid(1, 1)[0];
        let shift = problem.lower.diagonal[0];
        assert_eq!(problem.count_below(shift, &mut Fronts::default()), None);
    }
}
