//! Modes of robot and safety, and the rules by which they change.

/// Seconds before a protective stop may be unlocked.
const UNLOCK_AFTER_S: u64 = 5;
/// Half seconds that powering on and releasing brakes take here; a real arm takes several seconds.
const HALF_SECONDS: u64 = 1;

/// Power and brakes; numbers as RTDE's `robot_mode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotMode {
    /// 3
    PowerOff,
    /// 4: becomes idle.
    PowerOn {
        /// Cycle in which it does; `None` until the first cycle.
        until: Option<u64>,
        /// Brakes are to be released then.
        release: bool,
    },
    /// 5: powered, brakes engaged.
    Idle,
    /// 5 still: brakes are released, then it runs.
    Releasing { until: Option<u64> },
    /// 6: moved by hand, drives without torque.
    Backdrive,
    /// 7
    Running,
}

impl RobotMode {
    /// RTDE's number, and the dashboard's word.
    const fn known_as(self) -> (i32, &'static str) {
        match self {
            Self::PowerOff => (3, "POWER_OFF"),
            Self::PowerOn { .. } => (4, "POWER_ON"),
            Self::Idle | Self::Releasing { .. } => (5, "IDLE"),
            Self::Backdrive => (6, "BACKDRIVE"),
            Self::Running => (7, "RUNNING"),
        }
    }

    /// RTDE's `robot_mode`.
    #[must_use]
    pub const fn number(self) -> i32 {
        self.known_as().0
    }

    #[must_use]
    pub const fn word(self) -> &'static str {
        self.known_as().1
    }

    /// The joints hold themselves.
    #[must_use]
    pub const fn brakes_released(self) -> bool {
        matches!(self, Self::Running)
    }

    /// Goes on with what takes time.
    pub fn step(&mut self, cycle: u64, rate_hz: u32) {
        let takes = HALF_SECONDS * u64::from(rate_hz) / 2;
        match self {
            Self::PowerOn { until, .. } | Self::Releasing { until } if until.is_none() => {
                *until = Some(cycle.saturating_add(takes));
            }
            Self::PowerOn { until: Some(until), release } if cycle >= *until => {
                *self = if *release { Self::Releasing { until: None } } else { Self::Idle };
            }
            Self::Releasing { until: Some(until) } if cycle >= *until => *self = Self::Running,
            _ => {}
        }
    }
}

/// Why a protective stop came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProtectiveReason {
    /// The arm is not where its targets led: C153A0.
    Deviation,
    /// A target far from the one before: C204A1.
    SuddenChange,
    /// A joint beyond its range.
    PositionLimit,
    /// A program or somebody at the fault port asked for it.
    Asked,
}

impl ProtectiveReason {
    /// Code and argument, where it has them.
    #[must_use]
    pub const fn code(self) -> (i32, i32) {
        match self {
            Self::Deviation => (153, 0),
            Self::SuddenChange => (204, 1),
            Self::PositionLimit | Self::Asked => (0, 0),
        }
    }

    /// As a line of the log.
    #[must_use]
    pub const fn text(self) -> &'static str {
        match self {
            Self::Deviation => "C153A0: Protective Stop: Position deviates from path",
            Self::SuddenChange => "C204A1: Path sanity check failed: Sudden change in target position",
            Self::PositionLimit => "Protective Stop: Joint position beyond its limit",
            Self::Asked => "Protective Stop: asked for",
        }
    }
}

/// What only an operator at the pendant ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SafetyBreach {
    /// A limit of the safety settings was exceeded.
    Violation,
    /// The safety system itself is at fault.
    Fault,
    /// Joints beyond their safety limits: to be brought back by hand.
    Recovery,
}

/// What stops the robot.
#[derive(Debug, Clone, Copy)]
pub struct Safety {
    rate_hz: u32,
    /// Since which cycle, and why.
    protective: Option<(u64, ProtectiveReason)>,
    /// In which cycle an emergency stop began that has not taken the power yet.
    braking: Option<u64>,
    /// What only an operator ends.
    pub breach: Option<SafetyBreach>,
    /// An emergency stop button is pressed.
    pub emergency: bool,
    /// The safeguard input is open.
    pub safeguard: bool,
}

impl Safety {
    #[must_use]
    pub const fn new(rate_hz: u32) -> Self {
        Self { rate_hz, protective: None, braking: None, breach: None, emergency: false, safeguard: false }
    }

    /// The button is pressed in `cycle`; the stop goes on until the power is off.
    pub fn emergency_stop(&mut self, cycle: u64) {
        self.emergency = true;
        self.braking.get_or_insert(cycle);
    }

    /// For how many cycles an emergency stop has had the power on.
    #[must_use]
    pub fn braking_for(&self, cycle: u64) -> Option<u64> {
        self.braking.map(|since| cycle.saturating_sub(since))
    }

    /// The power is off: what an emergency stop was to bring about.
    pub const fn power_is_off(&mut self) {
        self.braking = None;
    }

    /// An emergency stop button is pressed, or was and the power is still on.
    #[must_use]
    pub const fn emergency_stopped(&self) -> bool {
        self.emergency || self.braking.is_some()
    }

    /// Whether the power may be switched on.
    #[must_use]
    pub fn lets_power_on(&self) -> bool {
        !self.emergency_stopped() && matches!(self.breach, None | Some(SafetyBreach::Recovery))
    }

    /// A protective stop in `cycle`; the first reason stays.
    pub fn protective_stop(&mut self, cycle: u64, why: ProtectiveReason) {
        self.protective.get_or_insert((cycle, why));
    }

    /// Why there is a protective stop.
    #[must_use]
    pub fn protective(&self) -> Option<ProtectiveReason> {
        self.protective.map(|(_, why)| why)
    }

    /// Unlocks a protective stop.
    ///
    /// # Errors
    ///
    /// The dashboard's answer, within 5 s of the stop.
    pub fn unlock(&mut self, cycle: u64) -> Result<(), &'static str> {
        let Some((since, _)) = self.protective else { return Ok(()) };
        if cycle.saturating_sub(since) < UNLOCK_AFTER_S * u64::from(self.rate_hz) {
            return Err("Cannot unlock protective stop until 5s after occurrence. Always inspect cause of \
                        protective stop before unlocking");
        }
        self.protective = None;
        Ok(())
    }

    #[must_use]
    pub const fn clear(&self) -> bool {
        self.number() == 1
    }

    /// Whether a program may go on, if only after a pause.
    #[must_use]
    pub const fn lets_programs_be(&self) -> bool {
        matches!(self.number(), 1 | 5)
    }

    /// RTDE's `safety_mode`, the dashboard's word, and RTDE's `safety_status_bits`.
    const fn known_as(&self) -> (i32, &'static str, u32) {
        match self.breach {
            Some(SafetyBreach::Violation) => (8, "VIOLATION", 1 << 8 | 1 << 10),
            Some(SafetyBreach::Fault) => (9, "FAULT", 1 << 9 | 1 << 10),
            _ if self.emergency_stopped() => (7, "ROBOT_EMERGENCY_STOP", 1 << 6 | 1 << 7 | 1 << 10),
            _ if self.protective.is_some() => (3, "PROTECTIVE_STOP", 1 << 2 | 1 << 10),
            Some(SafetyBreach::Recovery) => (4, "RECOVERY", 1 << 3 | 1 << 10),
            None if self.safeguard => (5, "SAFEGUARD_STOP", 1 << 4 | 1 << 10),
            None => (1, "NORMAL", 1),
        }
    }

    /// RTDE's `safety_mode`.
    #[must_use]
    pub const fn number(&self) -> i32 {
        self.known_as().0
    }

    #[must_use]
    pub const fn word(&self) -> &'static str {
        self.known_as().1
    }

    /// RTDE's `safety_status_bits`.
    #[must_use]
    pub const fn bits(&self) -> u32 {
        self.known_as().2
    }
}
