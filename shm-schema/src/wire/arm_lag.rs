//! `ArmLag`: the measured lag of the arm, and the plan's dead time. Part of [`crate::TickRecord`] and
//! [`crate::Status`].

use iceoryx2::prelude::ZeroCopySend;

use super::layout::wire;

wire! {
    /// The arm's lag from a command's stamp to the motion, measured in normal operation.
    "foretrace.ArmLagV1"
    pub struct ArmLag {
        /// Dead time by which the plan looks ahead \[ns\].
        pub dead_time_ns: u64,
        /// Group delay at low frequency \[s\].
        pub lag_s: f64,
        /// Its standard deviation \[s\]; negative: the lag is unknown, and the fields beside it are
        /// meaningless.
        pub std_s: f64,
        /// Shift of the commands that fits the recent motion best \[s\]; shorter than the group delay if the
        /// arm is a filter.
        pub shift_s: f64,
    }
}

impl ArmLag {
    /// Planned for `dead_time_ns`, nothing measured.
    pub const fn unknown(dead_time_ns: u64) -> Self {
        Self { dead_time_ns, lag_s: 0.0, std_s: -1.0, shift_s: 0.0 }
    }

    /// Whether a lag was measured.
    pub fn is_known(&self) -> bool {
        self.std_s >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lag_is_known_by_its_deviation() {
        let unknown = ArmLag::unknown(7);
        assert!(unknown.dead_time_ns == 7 && !unknown.is_known());
        assert!(ArmLag { std_s: 0.0, ..unknown }.is_known() && ArmLag { std_s: 0.1, ..unknown }.is_known());
    }
}
