//! Numbers that nobody can foresee and that are the same every time.

/// Knuth's MMIX generator (TAOCP 2, 3.3.4, table 1), of which the high bits are used.
#[derive(Debug, Clone)]
pub(crate) struct BenchDice(u64);

impl BenchDice {
    /// Fixed, so that the same input gives the same result.
    pub(crate) const SEED: u64 = 0x9e37_79b9_7f4a_7c15;
    /// [`Self::next`] is below it.
    pub(crate) const BOUND: u64 = 1 << 31;

    pub(crate) const fn new() -> Self {
        Self(Self::SEED)
    }

    pub(crate) const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }

    /// A place in a list of `count`, which is not empty.
    pub(crate) const fn place(&mut self, count: usize) -> usize {
        self.next() as usize % count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_comes_about_equally_often() {
        let (mut dice, mut counts) = (BenchDice::new(), [0; 7]);
        for _ in 0..7000 {
            counts[dice.place(7)] += 1;
        }
        assert!(counts.iter().all(|count| (900..1100).contains(count)), "{counts:?}");
    }
}
