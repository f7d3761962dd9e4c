//! Modes that a robot reports, with the numbers of Universal Robots' real-time interface.

use std::fmt;

use super::vocabulary::{UnknownValue, wire_enum};

wire_enum! {
    /// Safety mode of the robot, numbered as Universal Robots do (RTDE `safety_mode`); 0 is ours.
    pub enum SafetyMode: u32 {
        /// Not reported.
        Unknown = 0 => "unknown",
        /// Normal.
        Normal = 1 => "normal",
        /// Reduced.
        Reduced = 2 => "reduced",
        /// Protective stop.
        ProtectiveStop = 3 => "protective stop",
        /// Recovery.
        Recovery = 4 => "recovery",
        /// Safeguard stop.
        SafeguardStop = 5 => "safeguard stop",
        /// System emergency stop.
        SystemEmergencyStop = 6 => "system emergency stop",
        /// Robot emergency stop.
        RobotEmergencyStop = 7 => "robot emergency stop",
        /// Violation.
        Violation = 8 => "violation",
        /// Fault.
        Fault = 9 => "fault",
        /// Joint identity being checked.
        ValidateJointId = 10 => "validate joint id",
        /// Undefined, as reported by the robot.
        Undefined = 11 => "undefined",
    }
}

impl SafetyMode {
    /// Whether the robot follows commands in this mode. `Unknown` counts as yes: simple arms do not report
    /// it.
    pub const fn permits_motion(self) -> bool {
        matches!(self, Self::Unknown | Self::Normal | Self::Reduced)
    }
}

wire_enum! {
    /// Robot mode, numbered as Universal Robots do (RTDE `robot_mode`) plus one: theirs begins at -1.
    pub enum RobotMode: u32 {
        /// No controller (UR -1); also "not reported".
        NoController = 0 => "no controller",
        /// Disconnected (UR 0).
        Disconnected = 1 => "disconnected",
        /// Safety settings to be confirmed (UR 1).
        ConfirmSafety = 2 => "confirm safety",
        /// Booting (UR 2).
        Booting = 3 => "booting",
        /// Power off (UR 3).
        PowerOff = 4 => "power off",
        /// Power on, brakes closed (UR 4).
        PowerOn = 5 => "power on",
        /// Idle (UR 5).
        Idle = 6 => "idle",
        /// Moved by hand (UR 6).
        Backdrive = 7 => "backdrive",
        /// Running (UR 7).
        Running = 8 => "running",
        /// Firmware update (UR 8).
        UpdatingFirmware = 9 => "updating firmware",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_normal_reduced_and_unreported_safety_modes_permit_motion() {
        let moving: Vec<_> =
            SafetyMode::ALL.iter().filter(|m| m.permits_motion()).map(|m| *m as u32).collect();
        assert_eq!(moving, [0, 1, 2]);
    }
}
