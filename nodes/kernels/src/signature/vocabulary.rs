//! Words that stand for points of many shapes, and how often a shape uses each (bags of features: Bronstein, Bronstein, Guibas & Ovsjanikov 2011).

use crate::random::Random;
use crate::stop::{Pace, Stop};

fn square(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// The nearest of the words and the squared distance to it; the first of equally near ones.
fn nearest(words: &[f64], point: &[f64]) -> (usize, f64) {
    let all = words.chunks_exact(point.len()).map(|word| square(word, point));
    all.enumerate().fold((0, f64::INFINITY), |best, (i, d)| if d < best.1 { (i, d) } else { best })
}

/// Words: centres of clusters, and how wide these are.
#[derive(Debug, Clone, PartialEq)]
pub struct Words {
    /// Centres, one row of `width` values each.
    pub centres: Vec<f64>,
    /// The median squared distance of a point from its word.
    pub spread: f64,
}

/// `count` words for points of `width` values each: k-means from a seeded k-means++ start (Arthur & Vassilvitskii 2007), until no point changes its
/// word, but at most `rounds` times. Fewer words where there are fewer different points; `None` after `stop`, or without points.
#[must_use]
pub fn words(points: &[f64], width: usize, count: usize, seed: u64, rounds: usize, stop: Stop) -> Option<Words> {
    let mut centres = start(points, width, count, seed, stop)?;
    let n = points.len() / width;
    let pace = Pace::new(stop, 256);
    let mut word = vec![usize::MAX; n];
    let mut away = vec![0.0; n];
    for _ in 0..rounds.max(1) {
        let mut changed = false;
        for (i, point) in points.chunks_exact(width).enumerate() {
            if pace.ends() {
                return None;
            }
            let (at, distance) = nearest(&centres, point);
            changed |= word[i] != at;
            (word[i], away[i]) = (at, distance);
        }
        if !changed {
            break;
        }
        centres = means(points, width, &word, &centres);
    }
    away.sort_by(f64::total_cmp);
    Some(Words { spread: away[n / 2], centres })
}

/// The first word at random, each next one with a chance by its squared distance from those before.
fn start(points: &[f64], width: usize, count: usize, seed: u64, stop: Stop) -> Option<Vec<f64>> {
    let n = points.len().checked_div(width).filter(|n| *n > 0)?;
    let mut random = Random::new(&[seed, n as u64]);
    let row = |i: usize| &points[i * width..(i + 1) * width];
    let mut centres = row(random.below(n as u64) as usize).to_vec();
    let mut away: Vec<f64> = points.chunks_exact(width).map(|p| square(p, &centres)).collect();
    for _ in 1..count {
        if stop() {
            return None;
        }
        let total: f64 = away.iter().sum();
        let mut left = random.unit() * total;
        let Some(mut next) = away.iter().rposition(|d| *d > 0.0) else { break };
        for (i, d) in away.iter().enumerate() {
            left -= d;
            if left < 0.0 {
                next = i;
                break;
            }
        }
        centres.extend_from_slice(row(next));
        away.iter_mut().zip(points.chunks_exact(width)).for_each(|(d, p)| *d = d.min(square(p, row(next))));
    }
    Some(centres)
}

/// The mean of the points of each word; a word without points stays.
fn means(points: &[f64], width: usize, word: &[usize], before: &[f64]) -> Vec<f64> {
    let mut sums = vec![0.0; before.len()];
    let mut counts = vec![0.0; before.len() / width];
    for (point, at) in points.chunks_exact(width).zip(word) {
        counts[*at] += 1.0;
        sums[at * width..(at + 1) * width].iter_mut().zip(point).for_each(|(s, x)| *s += x);
    }
    for (at, count) in counts.iter().enumerate() {
        for i in at * width..(at + 1) * width {
            sums[i] = if *count > 0.0 { sums[i] / count } else { before[i] };
        }
    }
    sums
}

/// How often each word is used by weighted points: a point is shared by words by exp(-d² / (softness spread)), its shares sum to its weight, and all weights to 1.
#[must_use]
pub fn frequencies(words: &Words, points: &[f64], weights: &[f64], width: usize, softness: f64) -> Vec<f64> {
    let unit = (softness * words.spread).max(f64::MIN_POSITIVE);
    let total = weights.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    let mut found = vec![0.0; words.centres.len() / width];
    for (point, weight) in points.chunks_exact(width).zip(weights) {
        let (_, least) = nearest(&words.centres, point);
        let shares: Vec<f64> =
            words.centres.chunks_exact(width).map(|word| (-(square(word, point) - least) / unit).exp()).collect();
        let sum: f64 = shares.iter().sum();
        found.iter_mut().zip(&shares).for_each(|(f, s)| *f += weight / total * s / sum);
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stop::NEVER;

    /// Points about three places.
    fn points() -> Vec<f64> {
        let mut random = Random::new(&[3]);
        let mut all = Vec::new();
        for i in 0..300 {
            let [x, y] = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]][i % 3];
            all.extend([x + random.signed(), y + random.signed()]);
        }
        all
    }

    #[test]
    fn words_are_the_means_of_the_points_nearest_to_them() {
        let points = points();
        for count in [3, 7] {
            let words = words(&points, 2, count, 1, 100, NEVER).unwrap();
            assert_eq!(words.centres.len(), 2 * count);
            let mut sums = vec![[0.0; 3]; count];
            for p in points.chunks(2) {
                let away = |w: &[f64]| (p[0] - w[0]).hypot(p[1] - w[1]);
                let all: Vec<f64> = words.centres.chunks(2).map(away).collect();
                let at = (0..count).min_by(|a, b| all[*a].total_cmp(&all[*b])).unwrap();
                sums[at] = [sums[at][0] + p[0], sums[at][1] + p[1], sums[at][2] + 1.0];
            }
            for (sum, word) in sums.iter().zip(words.centres.chunks(2)) {
                assert!((sum[0] / sum[2] - word[0]).abs() < 1e-9 && (sum[1] / sum[2] - word[1]).abs() < 1e-9);
            }
            if count == 3 {
                assert!(sums.iter().all(|s| s[2] == 100.0), "{sums:?}");
            }
        }
        // The median of x² + y² with x and y even from -1 to 1 is about 0.64: pi r² / 4 = 1 / 2.
        let spread = words(&points, 2, 3, 1, 100, NEVER).unwrap().spread;
        assert!((0.5..0.78).contains(&spread), "{spread}");
    }

    #[test]
    fn no_more_words_than_points_and_none_without() {
        let few = words(&[1.0, 2.0, 1.0], 1, 5, 1, 10, NEVER).unwrap();
        assert_eq!((few.centres.len(), few.spread), (2, 0.0));
        assert!(words(&[], 3, 5, 1, 10, NEVER).is_none());
        assert!(words(&points(), 2, 5, 1, 10, &|| true).is_none());
    }

    #[test]
    fn shares_follow_the_distance() {
        let words = Words { centres: vec![0.0, 1.0], spread: 0.5 };
        // Squared distances of 0.25's are 1/16 and 9/16, a difference of 1/2 over softness 1 times spread 1/2.
        let found = frequencies(&words, &[0.25, 0.5], &[3.0, 1.0], 1, 1.0);
        let share = 1.0 / (1.0 + (-1.0_f64).exp());
        assert!((found[0] - (0.75 * share + 0.125)).abs() < 1e-12 && (found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
    }
}
