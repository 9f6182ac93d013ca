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
        [self.nn, self.first_tier, self.second_tier, self.e, self.dcg, self.map].into_iter().chain(self.precision)
    }

    fn values_mut(&mut self) -> impl Iterator<Item = &mut f64> {
        [&mut self.nn, &mut self.first_tier, &mut self.second_tier, &mut self.e, &mut self.dcg, &mut self.map]
            .into_iter()
            .chain(&mut self.precision)
    }
}

/// The order of `scores`, greatest first; among equals by `names`, so that the order of the input does not matter.
#[must_use]
pub fn ranked(scores: &[f64], names: &[String]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..scores.len() as u32).collect();
    order.sort_by(|&a, &b| {
        let (a, b) = (a as usize, b as usize);
        scores[b].total_cmp(&scores[a]).then_with(|| names[a].cmp(&names[b]))
    });
    order
}
