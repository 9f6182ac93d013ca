//! splitmix64 (Steele, Lea & Flood 2014): small, and the same on every machine.

/// The generator's state.
pub(super) struct Random(u64);

impl Random {
    /// Starts a stream that depends on all of `seeds` and their order.
    pub(super) fn new(seeds: &[u64]) -> Self {
        let mut random = Self(0);
        for &seed in seeds {
            random.0 ^= seed;
            random.0 = random.bits();
        }
        random
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [0, 1).
    pub(super) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub(super) fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}
