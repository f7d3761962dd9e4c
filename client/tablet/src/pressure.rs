//! A pen's pressure as a share of what this hand presses.
//!
//! Contract: pure. Hands press differently hard, so the whole range of a device is used by few: 1 stands for
//! the hardest press so far, but never for less than a quarter of the device's range.

/// Least share of the device's range that counts as the whole of a hand's.
const LEAST: f64 = 0.25;

/// The range of a device, and what a hand used of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pressure {
    minimum: f64,
    range: f64,
    hardest: f64,
}

impl Pressure {
    /// Of a device that tells pressure from `minimum` to `maximum`; none where that is not a range.
    #[must_use]
    pub fn new(minimum: i32, maximum: i32) -> Option<Self> {
        let range = f64::from(maximum) - f64::from(minimum);
        (range > 0.0).then_some(Self { minimum: f64::from(minimum), range, hardest: LEAST })
    }

    /// Share of the hand's range, 0 to 1, for a `value` of the device.
    pub fn share(&mut self, value: i32) -> f32 {
        let of_device = ((f64::from(value) - self.minimum) / self.range).clamp(0.0, 1.0);
        self.hardest = self.hardest.max(of_device);
        (of_device / self.hardest) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_hand_reaches_the_whole_range_and_a_touch_does_not_become_a_press() {
        let mut pressure = Pressure::new(0, 8191).unwrap();
        // A first touch of a tenth is not the hardest that this hand can do.
        assert!((pressure.share(819) - 0.4).abs() < 1e-3);
        assert!((pressure.share(4096) - 1.0).abs() < 1e-6);
        assert!((pressure.share(2048) - 0.5).abs() < 1e-3);
        assert!((pressure.hardest - 0.5).abs() < 1e-3);
        assert_eq!((pressure.share(-5), pressure.share(i32::MAX)), (0.0, 1.0));
    }

    #[test]
    fn what_is_no_range_gives_no_pressure() {
        assert_eq!(Pressure::new(5, 5), None);
        assert_eq!(Pressure::new(i32::MAX, i32::MIN), None);
        assert!(Pressure::new(i32::MIN, i32::MAX).unwrap().share(0) > 0.9);
    }
}
