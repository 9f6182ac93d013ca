//! Features of one side that may be exchanged: branches that are images of each other are searched once.
//!
//! A permutation `s` of the rights is a *symmetry* if `c_(i,j) = c_(i,s(j))` and `h_(i,j)(k,l) = h_(i,s(j))(k,s(l))` for all lefts i, k and rights
//! j, l; of the lefts likewise. If it keeps the features of what is chosen so far, it maps every assignment below the branch that takes
//! `(i, l)` to one of the same objective below `(i, s(l))`. What bounds have excluded is no better than the best known, and stays so under `s`.
//!
//! Only for problems that have every candidate and must match every left, such as those of QAPLIB.

use std::collections::BTreeMap;

use super::model::Model;

/// Larger problems are not looked at: `n^4` terms are compared.
const LARGEST: usize = 32;
/// Places tried for one answer; if there were more to try it is no, which is always safe.
const TRIES: usize = 2000;

/// Which features of one side look alike, alone and in pairs.
struct Side {
    n: usize,
    /// `[j * n + l]`: equal where all terms are; on the diagonal, those of one feature.
    class: Vec<u32>,
}

pub(super) struct Symmetry {
    left: Side,
    right: Side,
}

impl Symmetry {
    /// `None` where there is none to be found, on either side.
    pub fn new(m: &Model) -> Option<Self> {
        let (rows, columns) = (m.n_left, m.n_right);
        if !(m.mandatory && m.dense && m.left.len() == rows * columns && rows.max(columns) <= LARGEST) {
            return None;
        }
        let at = |i: usize, j: usize| i * columns + j;
        let found = Self {
            left: Side::new(rows, columns, |i, k, j, l| (at(i, j), at(k, l)), m),
            right: Side::new(columns, rows, |j, l, i, k| (at(i, j), at(k, l)), m),
        };
        (found.left.repeats() || found.right.repeats()).then_some(found)
    }

    /// Whether a symmetry of the lefts (of the rights) takes one to the other and keeps all that are fixed.
    pub fn exchanges(&self, of_lefts: bool, fixed: &[u32], one: u32, other: u32) -> bool {
        let side = if of_lefts { &self.left } else { &self.right };
        let mut image = vec![None; side.n];
        let mut used = vec![false; side.n];
        let mut tries = TRIES;
        let given = fixed.iter().map(|&f| (f, f)).chain([(one, other)]);
        for (from, to) in given {
            let (from, to) = (from as usize, to as usize);
            if !side.fits(&image, from, to) {
                return false;
            }
            (image[from], used[to]) = (Some(to), true);
        }
        side.extends(&mut image, &mut used, 0, &mut tries)
    }
}

impl Side {
    /// The classes of `n` features; `pair` gives the variables of two of them with two of the `others`.
    fn new(n: usize, others: usize, pair: impl Fn(usize, usize, usize, usize) -> (usize, usize), m: &Model) -> Self {
        let mut known: BTreeMap<Vec<i64>, u32> = BTreeMap::new();
        let mut class = Vec::with_capacity(n * n);
        for j in 0..n {
            for l in 0..n {
                let term = |p: usize, q: usize| {
                    let (a, b) = pair(j, l, p, q);
                    if j == l { if p == q { m.linear[a] } else { 0 } } else { m.pair(a, b) }
                };
                let mut terms = vec![i64::from(j == l)];
                terms.extend((0..others).flat_map(|p| (0..others).map(move |q| (p, q))).map(|(p, q)| term(p, q)));
                let new = known.len() as u32;
                class.push(*known.entry(terms).or_insert(new));
            }
        }
        Self { n, class }
    }

    /// Whether two features might be exchanged.
    fn repeats(&self) -> bool {
        let mut own: Vec<u32> = (0..self.n).map(|j| self.class[j * self.n + j]).collect();
        own.sort_unstable();
        own.windows(2).any(|w| w[0] == w[1])
    }

    /// Whether `from` may go to `to` beside what has its image already.
    fn fits(&self, image: &[Option<usize>], from: usize, to: usize) -> bool {
        let class = |j: usize, l: usize| self.class[j * self.n + l];
        let agrees = |(other, image): (usize, &Option<usize>)| {
            image.is_none_or(|i| class(from, other) == class(to, i) && class(other, from) == class(i, to))
        };
        class(from, from) == class(to, to) && image.iter().enumerate().all(agrees)
    }

    /// Finds images for all others from `next` on.
    fn extends(&self, image: &mut [Option<usize>], used: &mut [bool], next: usize, tries: &mut usize) -> bool {
        let Some(from) = (next..self.n).find(|&j| image[j].is_none()) else { return true };
        // Itself first: most symmetries move few.
        for to in std::iter::once(from).chain((0..self.n).filter(|&j| j != from)) {
            if used[to] || !self.fits(image, from, to) {
                continue;
            }
            if *tries == 0 {
                return false;
            }
            *tries -= 1;
            (image[from], used[to]) = (Some(to), true);
            if self.extends(image, used, from + 1, tries) {
                return true;
            }
            (image[from], used[to]) = (None, false);
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::super::canonical::Canonical;
    use super::super::problem::Problem;
    use super::*;
    use crate::stop::NEVER;

    /// Flows of a path 0 - 1 - 2 and a feature without any, between the corners of a square.
    fn path_on_square() -> Symmetry {
        let mut a = vec![0.0; 16];
        (a[1], a[4], a[6], a[9]) = (1.0, 1.0, 1.0, 1.0);
        let b: Vec<f64> = (0..16_u32).map(|e| f64::from(((e / 4) ^ (e % 4)).count_ones())).collect();
        let problem = Problem::from_qaplib(4, &a, &b).unwrap();
        Symmetry::new(&Model::plain(&Canonical::new(&problem)).bounding(NEVER)).unwrap()
    }

    #[test]
    fn symmetries_of_a_square_and_a_path() {
        let s = path_on_square();
        // Which side is called left is the canonical form's choice: corners are all alike, the path's ends are, its middle is not.
        let alike = |of_lefts: bool, fixed: &[u32]| {
            let pairs = (0..4).flat_map(|j| (j + 1..4).map(move |l| (j, l)));
            pairs.filter(|&(j, l)| s.exchanges(of_lefts, fixed, j, l)).collect::<Vec<_>>()
        };
        let (square, path) = if alike(true, &[]).len() == 6 { (true, false) } else { (false, true) };
        assert_eq!(alike(square, &[]).len(), 6);
        assert_eq!(alike(path, &[]), [(0, 2)]);
        // With one corner fixed only its two neighbours may change places; with a neighbour fixed, too, none.
        assert_eq!(alike(square, &[0]), [(1, 2)]);
        assert_eq!(alike(square, &[0, 1]), []);
        assert_eq!(alike(path, &[1]), [(0, 2)]);
    }
}
