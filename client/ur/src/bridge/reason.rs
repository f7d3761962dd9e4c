//! Why the arm does not follow: in plain words, whose turn it is, and how to go on.
//!
//! Contract: every reason stops the arm and is latched: after it, the arm moves again only after somebody has
//! armed the daemon again. What differs is what has to happen before arming is possible.

use serde::Serialize;

/// Why the arm does not follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum HaltReason {
    ProtectiveStop,
    SafeguardStop,
    /// Emergency stop of the robot or of the system around it.
    EmergencyStop,
    /// Safety violation or fault.
    SafetyFault,
    /// Recovery mode: joints outside their safety limits.
    Recovery,
    /// Brakes closed or drives off.
    NotRunning,
    /// Booting, or safety settings to be confirmed, or a firmware update.
    Booting,
    Backdrive,
    Paused,
    /// Speed slider or the controller's own limits.
    Slowed,
    /// The operator stopped the program.
    StoppedByOperator,
    /// Another program took the place of ours.
    Replaced,
    /// The controller ended the program because no counters came.
    StoppedByWatchdog,
    /// Our program stopped by itself: counters stayed away.
    CountersLate,
    /// Our program, or the bridge, refused a target too far away.
    TargetJump,
    /// Our program ended by an error of its own.
    ProgramFailed,
    /// Our program does not answer.
    NoAnswer,
    /// Our program did not start.
    DidNotStart,
    ForeignProgram,
    /// The controller is in local control.
    LocalControl,
    /// Another client holds one of the registers.
    InUse,
    /// The controller cannot be reached.
    Unreachable,
    /// The port is closed: the service is off.
    ServiceOff,
    /// The connection was lost, or nothing comes any more.
    ConnectionLost,
    /// The controller was restarted.
    Restarted,
    /// The pen would come too near to the paper for a model that is not calibrated.
    Uncalibrated,
    /// What was found behind the connection does not fit the settings.
    DoesNotFit,
    /// The daemon runs with other settings than the bridge.
    OtherSettings,
}

/// What has to happen before the arm can be armed again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Return {
    /// The bridge gets ready by itself as soon as the cause is gone.
    ByItself,
    /// An operator acts on the pendant; then the bridge gets ready by itself.
    Operator,
    /// Whoever runs the bridge starts it again.
    NewBridge,
}

impl HaltReason {
    /// Whose turn it is.
    #[must_use]
    pub const fn returns(self) -> Return {
        match self {
            Self::ProtectiveStop
            | Self::SafeguardStop
            | Self::EmergencyStop
            | Self::SafetyFault
            | Self::Recovery
            | Self::NotRunning
            | Self::Backdrive
            | Self::Paused
            | Self::Slowed
            | Self::ForeignProgram
            | Self::LocalControl
            | Self::ServiceOff
            | Self::Restarted
            | Self::DoesNotFit => Return::Operator,
            Self::StoppedByOperator | Self::Replaced | Self::ProgramFailed | Self::Uncalibrated => {
                Return::NewBridge
            }
            Self::Booting
            | Self::StoppedByWatchdog
            | Self::CountersLate
            | Self::TargetJump
            | Self::NoAnswer
            | Self::DidNotStart
            | Self::InUse
            | Self::Unreachable
            | Self::ConnectionLost
            | Self::OtherSettings => Return::ByItself,
        }
    }

    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::ProtectiveStop => "protective stop",
            Self::SafeguardStop => "safeguard stop",
            Self::EmergencyStop => "emergency stop",
            Self::SafetyFault => "the controller reports a safety violation or fault",
            Self::Recovery => "recovery mode: a joint is outside its safety limits",
            Self::NotRunning => "the arm is switched off, or its brakes are closed",
            Self::Booting => "the controller is starting up",
            Self::Backdrive => "the arm is being moved by hand",
            Self::Paused => "the program is paused",
            Self::Slowed => "speed scaling is below 100 %",
            Self::StoppedByOperator => "the program was stopped on the pendant",
            Self::Replaced => "another program took the place of the bridge's",
            Self::StoppedByWatchdog => {
                "the controller ended the program, because no counters came from the bridge"
            }
            Self::CountersLate => "counters stayed away for too many cycles, and the arm stopped by itself",
            Self::TargetJump => "a target was too far from the one before, and the arm stopped",
            Self::ProgramFailed => "the program on the controller ended by an error",
            Self::NoAnswer => "the program on the controller does not answer",
            Self::DidNotStart => "the program was sent, but does not run",
            Self::ForeignProgram => "another program runs on the controller",
            Self::LocalControl => "the controller is in local control",
            Self::InUse => "another client holds a register that the bridge needs",
            Self::Unreachable => "the controller cannot be reached",
            Self::ServiceOff => {
                "the controller refuses the connection: it is starting up, or its RTDE service is off"
            }
            Self::ConnectionLost => "the connection to the controller is lost",
            Self::Restarted => "the controller was restarted",
            Self::OtherSettings => "the daemon runs with other settings than the bridge",
            Self::DoesNotFit => "the controller that was found does not fit the settings",
            Self::Uncalibrated => "the pen would come nearer to the paper than an uncalibrated model allows",
        }
    }

    /// How to go on; arming comes on top of it.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::ProtectiveStop => "find out why, then release it on the pendant (foretrace never does)",
            Self::SafeguardStop => "clear the safeguard and reset it as your installation says",
            Self::EmergencyStop => "release the button, then switch on and release the brakes on the pendant",
            Self::SafetyFault => "read the pendant; the safety system has to be restarted there",
            Self::Recovery => "move the joint back within its limits on the pendant",
            Self::NotRunning => "switch the arm on and release its brakes on the pendant",
            Self::Booting => "wait; if the pendant asks for it, confirm the safety settings",
            Self::Backdrive => "let go of the freedrive button",
            Self::Paused => "press play on the pendant; stop ends the program for this bridge",
            Self::Slowed => "set the speed slider to 100 %; in reduced mode leave the area that causes it",
            Self::StoppedByOperator => "when whoever pressed stop agrees, start `foretrace arm ur` again",
            Self::Replaced => {
                "end the client that sent it, or agree with its owner; then start `foretrace arm ur` again"
            }
            Self::StoppedByWatchdog | Self::CountersLate => {
                "look for what held up this machine or the network; `foretrace doctor --robot` measures"
            }
            Self::TargetJump => "the arm was moved, or the daemon was: check the settings, then arm",
            Self::ProgramFailed => {
                "read the log of the pendant and report it; then start `foretrace arm ur` again"
            }
            Self::NoAnswer => "wait; the program is started again",
            Self::DidNotStart => "read the log of the pendant; the bridge tries again every 10 s",
            Self::ForeignProgram => "stop it on the pendant; the bridge does not stop programs of others",
            Self::LocalControl => "switch to remote control at the top right of the pendant",
            Self::InUse => {
                "stop the other client or fieldbus, or choose another robot.ur.register_base; \
                 the bridge tries again"
            }
            Self::Unreachable => "check cable, address and power of the controller; the bridge tries again",
            Self::ServiceOff => {
                "on the pendant: Settings, Security, Services: enable RTDE; and Security, General: \
                 allow inbound access to port 30004"
            }
            Self::ConnectionLost => "check the cable; the bridge connects again by itself",
            Self::Restarted => "switch the arm on and release its brakes on the pendant",
            Self::OtherSettings => {
                "start both with the same --config FILE, --preset and --set: dead-man and limits are judged by them"
            }
            Self::DoesNotFit => {
                "put right what is named; the bridge looks again, and has to be started anew for other settings"
            }
            Self::Uncalibrated => {
                "run `foretrace calibrate kinematics --robot HOST` and use what it writes, \
                 or start with --uncalibrated"
            }
        }
    }
}

impl std::fmt::Display for HaltReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; {}", self.text(), self.remedy())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    impl HaltReason {
        pub const ALL: [Self; 28] = [
            Self::ProtectiveStop,
            Self::SafeguardStop,
            Self::EmergencyStop,
            Self::SafetyFault,
            Self::Recovery,
            Self::NotRunning,
            Self::Booting,
            Self::Backdrive,
            Self::Paused,
            Self::Slowed,
            Self::StoppedByOperator,
            Self::Replaced,
            Self::StoppedByWatchdog,
            Self::CountersLate,
            Self::TargetJump,
            Self::ProgramFailed,
            Self::NoAnswer,
            Self::DidNotStart,
            Self::ForeignProgram,
            Self::LocalControl,
            Self::InUse,
            Self::Unreachable,
            Self::ServiceOff,
            Self::ConnectionLost,
            Self::Restarted,
            Self::Uncalibrated,
            Self::DoesNotFit,
            Self::OtherSettings,
        ];
    }

    #[test]
    fn every_reason_has_words_of_its_own_and_a_way_on() {
        let texts: HashSet<_> = HaltReason::ALL.iter().map(|reason| reason.text()).collect();
        assert_eq!(texts.len(), HaltReason::ALL.len());
        for reason in HaltReason::ALL {
            assert!(reason.remedy().len() > 10 && reason.text().len() > 5, "{reason}");
        }
    }

    #[test]
    fn safety_stops_are_an_operators_to_end() {
        for reason in [
            HaltReason::ProtectiveStop,
            HaltReason::SafeguardStop,
            HaltReason::EmergencyStop,
            HaltReason::SafetyFault,
        ] {
            assert_eq!(reason.returns(), Return::Operator);
        }
    }
}
