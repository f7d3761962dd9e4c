//! What a button's state means for the dead-man signal.
//!
//! Contract: no device, no clock of its own. A button that is held when the program begins, or when a daemon
//! comes back, counts only after it was released once: something may lie on it. Whatever cannot be read
//! counts as released.

use std::time::Duration;

/// What to do now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SwitchSignal {
    /// Say "go on".
    Beat,
    /// Say "stop", once.
    Stop,
    /// Say nothing.
    Silent,
}

/// A hold-to-run button.
#[derive(Debug, Clone, Copy)]
pub struct HoldSwitch {
    released_once: bool,
    held: bool,
    beaten: Option<Duration>,
    interval: Duration,
}

impl HoldSwitch {
    /// Beats every `interval` while it is held.
    pub const fn new(interval: Duration) -> Self {
        Self { released_once: false, held: false, beaten: None, interval }
    }

    /// The button is `held` at `now`, the time since some instant; `None`: it cannot be read.
    pub fn look(&mut self, now: Duration, held: Option<bool>) -> SwitchSignal {
        let held = held.unwrap_or(false);
        if !held {
            self.released_once = true;
            let was = std::mem::replace(&mut self.held, false);
            self.beaten = None;
            return if was { SwitchSignal::Stop } else { SwitchSignal::Silent };
        }
        if !self.released_once {
            return SwitchSignal::Silent;
        }
        self.held = true;
        if self.beaten.is_some_and(|beaten| now.saturating_sub(beaten) < self.interval) {
            return SwitchSignal::Silent;
        }
        self.beaten = Some(now);
        SwitchSignal::Beat
    }

    /// Nobody hears it any more, or somebody else does: it has to be released once before it counts.
    pub fn begin_again(&mut self) {
        *self = Self::new(self.interval);
    }

    /// It is held, and counts.
    pub const fn is_held(&self) -> bool {
        self.held
    }

    /// It is held since before it could count.
    pub const fn waits_for_release(&self) -> bool {
        !self.released_once
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(5);

    fn signals(switch: &mut HoldSwitch, from: u32, held: &[Option<bool>]) -> Vec<SwitchSignal> {
        held.iter().zip(from..).map(|(held, index)| switch.look(STEP * index, *held)).collect()
    }

    #[test]
    fn a_held_button_beats_at_its_interval_and_stops_once() {
        use SwitchSignal::{Beat, Silent, Stop};
        let mut switch = HoldSwitch::new(4 * STEP);
        let held = [&[Some(false)][..], &[Some(true); 9], &[Some(false); 3]].concat();
        let expected = [
            &[Silent][..],
            &[Beat, Silent, Silent, Silent, Beat, Silent, Silent, Silent, Beat],
            &[Stop, Silent, Silent],
        ];
        assert_eq!(signals(&mut switch, 0, &held), expected.concat());
        assert!(!switch.is_held());
    }

    #[test]
    fn what_was_held_before_it_began_does_not_count_until_it_was_released() {
        let mut switch = HoldSwitch::new(4 * STEP);
        assert!(
            signals(&mut switch, 0, &[Some(true); 50]).iter().all(|signal| *signal == SwitchSignal::Silent)
        );
        assert!(switch.waits_for_release());
        assert_eq!(
            signals(&mut switch, 50, &[Some(false), Some(true)]),
            [SwitchSignal::Silent, SwitchSignal::Beat]
        );
        switch.begin_again();
        assert!(
            signals(&mut switch, 60, &[Some(true); 9]).iter().all(|signal| *signal == SwitchSignal::Silent)
        );
    }

    #[test]
    fn a_device_that_is_gone_is_a_released_button() {
        let mut switch = HoldSwitch::new(4 * STEP);
        let seen = signals(&mut switch, 0, &[Some(false), Some(true), None, None]);
        assert_eq!(
            seen,
            [SwitchSignal::Silent, SwitchSignal::Beat, SwitchSignal::Stop, SwitchSignal::Silent]
        );
    }
}
