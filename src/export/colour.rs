//! Colours for numbers.

use clap::ValueEnum;

/// Red, green and blue in the sRGB space of screens.
pub type Colour = [u8; 3];

/// Where nothing is to be said.
pub const PLAIN: Colour = [200, 200, 200];

/// Viridis (S. van der Walt and N. Smith, CC0), every 32nd colour: equal steps look equal.
const VIRIDIS: [Colour; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];
/// Blue for negative, near white for zero, red for positive; the same lightness on both sides.
const DIVERGING: [Colour; 7] =
    [[20, 55, 120], [48, 110, 180], [128, 176, 214], [243, 243, 240], [226, 158, 122], [190, 84, 48], [112, 28, 24]];
const GREY: [Colour; 2] = [[20, 20, 20], [240, 240, 240]];
/// Low frequencies are red, high ones blue, as in fig. 7 of the paper.
const FREQUENCY: [Colour; 6] =
    [[196, 32, 38], [236, 112, 60], [248, 196, 106], [190, 214, 220], [92, 150, 200], [38, 74, 160]];

/// How values of a function become vertex colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ColourMap {
    /// `diverging` for functions that have a sign, `viridis` for others.
    #[default]
    Auto,
    /// From dark violet to yellow, perceptually uniform, between the least and the greatest value.
    Viridis,
    /// From blue to red, white for zero, as far in both directions.
    Diverging,
    /// From dark to light, between the least and the greatest value.
    Grey,
}

impl ColourMap {
    /// The colour of each value. One that is not finite is plain.
    #[must_use]
    pub fn colours(self, values: &[f64], signed: bool) -> Vec<Colour> {
        let finite = || values.iter().copied().filter(|v| v.is_finite());
        let (mut low, mut high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        let map: &[Colour] = match self {
            Self::Auto if signed => &DIVERGING,
            Self::Diverging => &DIVERGING,
            Self::Grey => &GREY,
            Self::Auto | Self::Viridis => &VIRIDIS,
        };
        if map == DIVERGING {
            high = high.abs().max(low.abs());
            low = -high;
        }
        let one = |v: &f64| {
            let share = if high > low { (v - low) / (high - low) } else { 0.5 };
            if v.is_finite() { between(map, share) } else { PLAIN }
        };
        values.iter().map(one).collect()
    }
}

/// The colour of each frequency by its logarithm, the lowest red and the highest blue.
#[must_use]
pub fn of_frequencies(lambda: &[f64]) -> Vec<Colour> {
    let logs: Vec<f64> = lambda.iter().map(|x| x.ln()).collect();
    let (low, high) =
        (logs.iter().copied().fold(f64::INFINITY, f64::min), logs.iter().copied().fold(f64::NEG_INFINITY, f64::max));
    let share = |x: &f64| if high > low { (x - low) / (high - low) } else { 0.5 };
    logs.iter().map(|x| between(&FREQUENCY, share(x))).collect()
}

/// The colour of a place in a box, so that near places have near colours.
#[must_use]
pub fn of_place(p: [f64; 3], [low, high]: [[f64; 3]; 2]) -> Colour {
    std::array::from_fn(|k| {
        let share = if high[k] > low[k] { (p[k] - low[k]) / (high[k] - low[k]) } else { 0.5 };
        (40.0 + 195.0 * share).round() as u8
    })
}

fn between(map: &[Colour], share: f64) -> Colour {
    let x = share.clamp(0.0, 1.0) * (map.len() - 1) as f64;
    let at = (x as usize).min(map.len() - 2);
    let part = x - at as f64;
    std::array::from_fn(|k| {
        let (one, other) = (f64::from(map[at][k]), f64::from(map[at + 1][k]));
        (one + (other - one) * part).round() as u8
    })
}

/// Linear light from a component as screens have it (IEC 61966-2-1).
#[must_use]
pub fn linear(component: u8) -> f64 {
    let c = f64::from(component) / 255.0;
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_signed_function_is_white_at_zero_whatever_its_range() {
        let colours = ColourMap::Auto.colours(&[-1.0, 0.0, 4.0, f64::NAN], true);
        assert_eq!(colours[1..], [[243, 243, 240], [112, 28, 24], PLAIN]);
        // A quarter of the way to the blue end.
        assert_ne!(colours[0], DIVERGING[0]);
        assert!(colours[0][2] > colours[0][0]);
    }

    #[test]
    fn an_unsigned_function_spans_the_map() {
        let colours = ColourMap::Auto.colours(&[3.0, 5.0, 4.0], false);
        assert_eq!(colours, [VIRIDIS[0], VIRIDIS[8], VIRIDIS[4]]);
        assert_eq!(ColourMap::Grey.colours(&[7.0, 7.0], false), [[130; 3]; 2]);
        assert!(ColourMap::Auto.colours(&[], true).is_empty());
    }

    #[test]
    fn low_frequencies_are_red_and_high_ones_blue() {
        let colours = of_frequencies(&[1.0, 100.0, 10.0]);
        assert_eq!([colours[0], colours[1]], [FREQUENCY[0], FREQUENCY[5]]);
        assert_eq!(linear(255), 1.0);
        assert!((linear(188) - 0.5).abs() < 0.01);
    }
}
