//! Figures of merit of ranked lists: the protocol of the Princeton Shape Benchmark (Shilane, Min, Kazhdan & Funkhouser 2004), mean
//! average precision, and precision at eleven levels of recall.
//!
//! A query is not in its own list. With C shapes of the query's class in the database besides the query itself:
//!
//! - *nearest neighbour*: 1 if the first is of the class;
//! - *first tier*, *second tier*: the share of the class among the first C, the first 2 C;
//! - *E*: 2 / (1/P + 1/R), precision and recall of the first 32;
//! - *DCG*: sum of G_1 and G_i / log2(i), G_i = 1 where the i-th is of the class, over its greatest possible value;
//! - *average precision*: the mean of the precisions at the places of the class; what is not in the list counts 0;
//! - *recall*: the share of the class that is in the list at all, which for a list of all is 1;
//! - *precision at a recall* of 0, 0.1, ... 1: the greatest precision at that recall or a higher one.

/// How many retrieved shapes the E-measure looks at.
pub const PAGE: usize = 32;

/// Levels of recall of the curve.
pub const LEVELS: usize = 11;

/// Figures of one query, or the means of several; each from 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Merit {
    /// Nearest neighbour.
    pub nn: f64,
    /// First tier.
    pub first_tier: f64,
    /// Second tier.
    pub second_tier: f64,
    /// E-measure of the first [`PAGE`].
    pub e: f64,
    /// Discounted cumulative gain.
    pub dcg: f64,
    /// Average precision.
    pub map: f64,
    /// Recall of the whole list.
    pub recall: f64,
    /// Precision at recall 0, 0.1, ... 1.
    pub precision: [f64; LEVELS],
}

impl Merit {
    /// Of a ranked list, best first: whether each is of the query's class, and how many of the class there are to be found. `None` if there are
    /// none.
    #[must_use]
    pub fn of(relevant: &[bool], class: usize) -> Option<Self> {
        if class == 0 {
            return None;
        }
        let c = class as f64;
        let within = |n: usize| relevant.iter().take(n).filter(|r| **r).count() as f64;
        let page = within(PAGE);
        let discount = |place: usize| if place == 0 { 1.0 } else { 1.0 / ((place + 1) as f64).log2() };
        let gain: f64 = relevant.iter().enumerate().filter(|(_, r)| **r).map(|(place, _)| discount(place)).sum();
        let ideal: f64 = (0..class).map(discount).sum();
        let mut found = 0.0;
        let mut precisions = Vec::with_capacity(class);
        for (place, _) in relevant.iter().enumerate().filter(|(_, r)| **r) {
            found += 1.0;
            precisions.push(found / (place + 1) as f64);
        }
        let mut precision = [0.0; LEVELS];
        for (level, best) in precision.iter_mut().enumerate() {
            // The first place at which level / 10 of the class is found, in integers: 0.3 * 10 is not 3.
            let first = (level * class).div_ceil(LEVELS - 1).max(1) - 1;
            *best = precisions.get(first..).unwrap_or_default().iter().copied().fold(0.0, f64::max);
        }
        Some(Self {
            nn: within(1),
            first_tier: within(class) / c,
            second_tier: within(2 * class) / c,
            // 2 / (1/P + 1/R) with P = page / shown and R = page / c.
            e: 2.0 * page / (relevant.len().min(PAGE) as f64 + c),
            dcg: gain / ideal,
            map: precisions.iter().sum::<f64>() / c,
            recall: found / c,
            precision,
        })
    }

    /// The mean; `None` of nothing.
    #[must_use]
    pub fn mean<'a>(of: impl IntoIterator<Item = &'a Self>) -> Option<Self> {
        let (mut sum, mut count) = (Self::default(), 0.0);
        for one in of {
            count += 1.0;
            sum.values_mut().zip(one.values()).for_each(|(s, x)| *s += x);
        }
        sum.values_mut().for_each(|s| *s /= count);
        (count > 0.0).then_some(sum)
    }

    fn values(&self) -> impl Iterator<Item = f64> + '_ {
        [self.nn, self.first_tier, self.second_tier, self.e, self.dcg, self.map, self.recall]
            .into_iter()
            .chain(self.precision)
    }

    fn values_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        [
            &mut self.nn,
            &mut self.first_tier,
            &mut self.second_tier,
            &mut self.e,
            &mut self.dcg,
            &mut self.map,
            &mut self.recall,
        ]
        .into_iter()
        .chain(&mut self.precision)
    }
}

/// The places of the greatest `scores`, at most `count`, greatest first; among equals by `names`, so that the order of the input does not matter.
#[must_use]
pub fn ranked<'a>(scores: &[f64], name: impl Fn(usize) -> &'a str, count: usize) -> Vec<u32> {
    let by = |a: &u32, b: &u32| {
        let (a, b) = (*a as usize, *b as usize);
        scores[b].total_cmp(&scores[a]).then_with(|| name(a).cmp(name(b))).then(a.cmp(&b))
    };
    let mut order: Vec<u32> = (0..scores.len() as u32).collect();
    // Of ten thousand the best hundred: not all need be sorted.
    if (1..order.len()).contains(&count) {
        order.select_nth_unstable_by(count - 1, by);
    }
    order.truncate(count);
    order.sort_unstable_by(by);
    order
}

/// Sum of absolute differences. Sums run side by side, for speed, so the last bits are not those of one sum in order.
#[must_use]
pub fn manhattan(a: &[f64], b: &[f64]) -> f64 {
    const WIDTH: usize = 8;
    let ((wide_a, rest_a), (wide_b, rest_b)) = (a.as_chunks::<WIDTH>(), b.as_chunks::<WIDTH>());
    let mut sums = [0.0; WIDTH];
    for (x, y) in wide_a.iter().zip(wide_b) {
        for k in 0..WIDTH {
            sums[k] += (x[k] - y[k]).abs();
        }
    }
    sums.iter().sum::<f64>() + rest_a.iter().zip(rest_b).map(|(x, y)| (x - y).abs()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_are_those_of_the_whole_order() {
        let scores: Vec<f64> = (0..60).map(|i| f64::from(i * 37 % 11)).collect();
        let names: Vec<String> = (0..60).map(|i| format!("{}", i * 53 % 60)).collect();
        let name = |i: usize| names[i].as_str();
        let mut all: Vec<u32> = (0..60).collect();
        all.sort_by(|a, b| {
            let (a, b) = (*a as usize, *b as usize);
            scores[b].partial_cmp(&scores[a]).unwrap().then(names[a].cmp(&names[b]))
        });
        for count in [0, 1, 7, 59, 60, usize::MAX] {
            assert_eq!(ranked(&scores, name, count), all[..count.min(60)]);
        }
    }

    #[test]
    fn distances_are_sums_of_differences() {
        let of = |n: usize, f: f64| (0..n).map(|i| (f * i as f64).sin()).collect::<Vec<_>>();
        for n in [0, 1, 8, 19] {
            let (a, b) = (of(n, 1.0), of(n, 2.0));
            let plain: f64 = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).sum();
            assert!((manhattan(&a, &b) - plain).abs() < 1e-12);
            assert_eq!(manhattan(&a, &b).to_bits(), manhattan(&b, &a).to_bits());
        }
    }
}
