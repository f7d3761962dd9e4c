//! The hold-to-run button's way from a page to the dead-man switch, without the switch itself.
//!
//! Contract: pure; time is an argument. Only a press replaces the dead-man switch. A button that
//! was held when the place was refused or the daemon changed counts only after it was released once; a button
//! that is let go gives the place back.

use foretrace_client::DeadMan;

/// The place is given back this long after the button was let go \[ns\].
const KEPT_NS: u64 = 1_000_000_000;

/// What is to be done with the dead-man switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ButtonStep {
    Nothing,
    Claim,
    Beat,
    Stop,
    GiveBack,
}

/// What was last known of the button.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Grip {
    held: bool,
    waits_for_release: bool,
    beaten_ns: u64,
    let_go_ns: u64,
}

impl Grip {
    /// Looks at the button; `has`: the place of the switch is this console's.
    pub(crate) fn look(&mut self, held: bool, has: bool, now_ns: u64) -> ButtonStep {
        let was = std::mem::replace(&mut self.held, held);
        if !held {
            self.waits_for_release = false;
            if was {
                self.let_go_ns = now_ns;
            }
        }
        match (has, held) {
            _ if self.waits_for_release => ButtonStep::Nothing,
            (true, true) if !was || self.beat_is_due(now_ns) => {
                self.beaten_ns = now_ns;
                ButtonStep::Beat
            }
            (false, true) if !was => ButtonStep::Claim,
            (true, false) if was => ButtonStep::Stop,
            (true, false) if now_ns.saturating_sub(self.let_go_ns) >= KEPT_NS => ButtonStep::GiveBack,
            _ => ButtonStep::Nothing,
        }
    }

    /// The place was claimed with this outcome.
    pub(crate) fn claimed(&mut self, taken: bool, now_ns: u64) -> ButtonStep {
        if taken {
            self.beaten_ns = now_ns;
            ButtonStep::Beat
        } else {
            self.waits_for_release = true;
            ButtonStep::Nothing
        }
    }

    fn beat_is_due(&self, now_ns: u64) -> bool {
        u128::from(now_ns.saturating_sub(self.beaten_ns)) >= DeadMan::INTERVAL.as_nanos()
    }

    /// A button that is held counts only after a release.
    pub(crate) fn wait_for_release(&mut self) {
        self.waits_for_release = self.held;
    }

    pub(crate) const fn is_held(self) -> bool {
        self.held
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: u64 = DeadMan::INTERVAL.as_nanos() as u64;

    #[test]
    fn a_press_claims_then_beats_and_a_release_stops_and_gives_the_place_back() {
        let mut grip = Grip::default();
        assert_eq!(grip.look(true, false, 1), ButtonStep::Claim);
        assert_eq!(grip.claimed(true, 1), ButtonStep::Beat);
        assert_eq!(grip.look(true, true, 2), ButtonStep::Nothing);
        assert_eq!(grip.look(true, true, 1 + INTERVAL), ButtonStep::Beat);
        let end = 2 + INTERVAL;
        assert_eq!(grip.look(false, true, end), ButtonStep::Stop);
        assert_eq!(grip.look(false, true, end + KEPT_NS - 1), ButtonStep::Nothing);
        assert_eq!(grip.look(false, true, end + KEPT_NS), ButtonStep::GiveBack);
    }

    #[test]
    fn a_refused_or_an_orphaned_press_does_nothing_until_it_is_released() {
        let mut grip = Grip::default();
        assert_eq!(grip.look(true, false, 1), ButtonStep::Claim);
        assert_eq!(grip.claimed(false, 1), ButtonStep::Nothing);
        for at in 1..100 {
            assert_eq!(grip.look(true, false, at * INTERVAL), ButtonStep::Nothing);
        }
        assert_eq!(grip.look(false, false, 100 * INTERVAL), ButtonStep::Nothing);
        assert_eq!(grip.look(true, false, 101 * INTERVAL), ButtonStep::Claim);
        grip.claimed(true, 101 * INTERVAL);
        grip.wait_for_release();
        assert_eq!(grip.look(true, true, 110 * INTERVAL), ButtonStep::Nothing);
        assert_eq!(grip.look(false, true, 111 * INTERVAL), ButtonStep::Stop);
        assert_eq!(grip.look(true, true, 112 * INTERVAL), ButtonStep::Beat);
    }
}
