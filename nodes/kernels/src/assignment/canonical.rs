//! One form for equal problems: candidates by (left, right), and of the two ways to call the sides left and right always the same one.
//!
//! So neither the order in which candidates were added nor a swap of the two sides changes anything that follows: not the objective, not
//! the bound, not the number of nodes.

use super::problem::Problem;

/// A problem in canonical form. If all of the smaller side must be matched, that is the left side.
#[derive(Clone, Debug)]
pub(super) struct Canonical {
    /// Numbers of features, the smaller first.
    pub n: [usize; 2],
    pub candidates: Vec<(u32, u32)>,
    /// Index of each candidate in the problem.
    pub source: Vec<usize>,
    pub linear: Vec<f64>,
    pub cost: [Vec<f64>; 2],
    /// Symmetric CSR.
    pub row: Vec<usize>,
    pub col: Vec<u32>,
    pub val: Vec<f64>,
    pub must_match_all: bool,
}

impl Canonical {
    pub fn new(p: &Problem) -> Self {
        let make = |swap: bool| Self::without_pairs(p, swap);
        if p.n_left != p.n_right {
            return make(p.n_left > p.n_right).with_pairs(p);
        }
        let (mut given, mut swapped) = (make(false), make(true));
        let mut order = given.key().cmp(swapped.key());
        if order.is_eq() {
            (given, swapped) = (given.with_pairs(p), swapped.with_pairs(p));
            let key = |c: &Self| c.col.iter().zip(&c.val).map(|(&b, v)| (b, v.to_bits())).collect::<Vec<_>>();
            order = (&given.row, key(&given)).cmp(&(&swapped.row, key(&swapped)));
            return if order.is_le() { given } else { swapped };
        }
        if order.is_lt() { given } else { swapped }.with_pairs(p)
    }

    fn key(&self) -> impl Iterator<Item = (u64, u64)> {
        let candidates = self.candidates.iter().map(|c| (u64::from(c.0), u64::from(c.1)));
        let values = self.linear.iter().chain(self.cost.iter().flatten()).map(|v| (0, v.to_bits()));
        candidates.chain(values)
    }

    fn without_pairs(p: &Problem, swap: bool) -> Self {
        let place = |a: usize| {
            let (i, j) = p.candidates[a];
            if swap { (j as u32, i as u32) } else { (i as u32, j as u32) }
        };
        let mut source: Vec<usize> = (0..p.candidates.len()).collect();
        source.sort_unstable_by_key(|&a| place(a));
        let mut cost = [p.left_cost.clone(), p.right_cost.clone()];
        let mut n = [p.n_left, p.n_right];
        if swap {
            cost.reverse();
            n.reverse();
        }
        Self {
            n,
            candidates: source.iter().map(|&a| place(a)).collect(),
            linear: source.iter().map(|&a| p.linear[a]).collect(),
            source,
            cost,
            row: Vec::new(),
            col: Vec::new(),
            val: Vec::new(),
            must_match_all: p.must_match_all,
        }
    }

    fn with_pairs(mut self, p: &Problem) -> Self {
        let mut variable = vec![0_u32; self.source.len()];
        self.source.iter().enumerate().for_each(|(v, &a)| variable[a] = v as u32);
        let mut own: Vec<(u32, f64)> = Vec::new();
        self.row.push(0);
        for &a in &self.source {
            own.clear();
            own.extend((p.row[a]..p.row[a + 1]).map(|e| (variable[p.col[e] as usize], p.val[e])));
            own.sort_unstable_by_key(|e| e.0);
            self.col.extend(own.iter().map(|e| e.0));
            self.val.extend(own.iter().map(|e| e.1));
            self.row.push(self.col.len());
        }
        self
    }
}
