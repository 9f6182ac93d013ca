//! What every search of one problem reads: scores as doubles, who shares a feature, and answers to what is asked again and again.

use super::model::Model;

/// No variable.
pub(super) const NONE: u32 = u32::MAX;

/// Shared by all searches. Scores of the model are integers whose sums stay below 2^52 in magnitude, so that doubles hold and add them exactly.
pub(super) struct Tables<'a> {
    pub m: &'a Model,
    /// First variable of each left.
    pub start: Vec<usize>,
    /// Variables by right, and where each right's begin.
    by_right: Vec<u32>,
    right_start: Vec<usize>,
    pub linear: Vec<f64>,
    pub val: Vec<f64>,
    /// What greedy insertion adds to a variable's gain: an estimate of what it will still earn.
    pub potential: Vec<f64>,
    quick: Option<Quick>,
}

/// Tables that answer at once.
struct Quick {
    /// The pair term of every two variables.
    pairs: Vec<f64>,
    /// The variable of every left and right, [`NONE`] where there is none.
    variable: Vec<u32>,
}

/// Above this many entries there are no quick tables: 8 MB would not stay in the processor's cache.
const MOST: usize = 1 << 20;

impl Quick {
    fn new(m: &Model) -> Option<Self> {
        let n = m.left.len();
        if n * n > MOST || m.n_left * m.n_right > MOST {
            return None;
        }
        let (mut pairs, mut variable) = (vec![0.0; n * n], vec![NONE; m.n_left * m.n_right]);
        for a in 0..n {
            variable[m.left[a] as usize * m.n_right + m.right[a] as usize] = a as u32;
            for e in m.row[a]..m.row[a + 1] {
                pairs[a * n + m.col[e] as usize] = m.val[e] as f64;
            }
        }
        Some(Self { pairs, variable })
    }
}

impl<'a> Tables<'a> {
    pub fn new(m: &'a Model) -> Self {
        let start = starts(&m.left, m.n_left);
        let right_start = starts(&m.right, m.n_right);
        let (mut next, mut by_right) = (right_start.clone(), vec![0; m.right.len()]);
        for (a, &r) in m.right.iter().enumerate() {
            by_right[next[r as usize]] = a as u32;
            next[r as usize] += 1;
        }
        let share = 2 * m.n_left as i64;
        let potential = |a: usize| m.val[m.row[a]..m.row[a + 1]].iter().map(|&h| h.max(0) / share).sum::<i64>() as f64;
        Self {
            start,
            by_right,
            right_start,
            linear: m.linear.iter().map(|&c| c as f64).collect(),
            val: m.val.iter().map(|&h| h as f64).collect(),
            potential: (0..m.left.len()).map(potential).collect(),
            quick: Quick::new(m),
            m,
        }
    }

    /// The variables of a left.
    pub fn of_left(&self, left: u32) -> std::ops::Range<usize> {
        self.start[left as usize]..self.start[left as usize + 1]
    }

    /// The variables of a right.
    pub fn of_right(&self, right: u32) -> &[u32] {
        &self.by_right[self.right_start[right as usize]..self.right_start[right as usize + 1]]
    }

    /// The pair term of two variables.
    pub fn pair(&self, a: usize, b: usize) -> f64 {
        match &self.quick {
            Some(quick) => quick.pairs[a * self.m.left.len() + b],
            None => self.m.pair(a, b) as f64,
        }
    }

    /// The variable of a left and a right, [`NONE`] if there is none.
    pub fn find(&self, left: u32, right: u32) -> u32 {
        if let Some(quick) = &self.quick {
            return quick.variable[left as usize * self.m.n_right + right as usize];
        }
        let own = self.of_left(left);
        self.m.right[own.clone()].binary_search(&right).map_or(NONE, |at| (own.start + at) as u32)
    }
}

/// Where the variables of each feature begin, if they are in the order of features.
fn starts(feature: &[u32], n: usize) -> Vec<usize> {
    let mut start = vec![0; n + 1];
    for &k in feature {
        start[k as usize + 1] += 1;
    }
    for k in 0..n {
        start[k + 1] += start[k];
    }
    start
}
