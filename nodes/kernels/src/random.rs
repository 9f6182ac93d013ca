//! Random numbers that are the same in every run and on every machine: splitmix64 (Steele, Lea & Flood 2014).

/// The generator's state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random(u64);

impl Random {
    /// Starts a stream from a state.
    #[must_use]
    pub fn from_state(state: u64) -> Self {
        Self(state)
    }

    /// Starts a stream that depends on all of `seeds` and their order.
    #[must_use]
    pub fn new(seeds: &[u64]) -> Self {
        let mut random = Self(0);
        for &seed in seeds {
            random.0 ^= seed;
            random.0 = random.bits();
        }
        random
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Below `n`, or 0 if `n` is 0, by the high half of a product (its bias is below n / 2^64).
    pub fn below(&mut self, n: u64) -> u64 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u64
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// A turn (unit quaternion, evenly distributed) and an offset in [0, 1) along each axis.
    pub fn frame(&mut self) -> ([f64; 4], [f64; 3]) {
        let offset = [self.unit(), self.unit(), self.unit()];
        loop {
            let q = [self.signed(), self.signed(), self.signed(), self.signed()];
            let length2 = q.iter().map(|x| x * x).sum::<f64>();
            if (0.01..=1.0).contains(&length2) {
                return (q.map(|x| x / length2.sqrt()), offset);
            }
        }
    }

    /// A random order of 0..n (Fisher-Yates).
    pub fn permutation(&mut self, n: usize) -> Vec<u32> {
        let mut order: Vec<u32> = (0..n as u32).collect();
        for i in (1..n).rev() {
            order.swap(i, self.below(i as u64 + 1) as usize);
        }
        order
    }
}
