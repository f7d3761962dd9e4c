//! The arm at a desk: what a loop needs of one, the built-in ones, and the limits of joints.

use std::collections::VecDeque;
use std::error::Error;

use foretrace_control::arm::JointLimits;
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{JointCommand, JointReading};
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};

/// Why an arm cannot go on.
pub type ArmError = Box<dyn Error + Send + Sync>;

/// What an arm measured, base first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// When; not after the instant at which it is read.
    pub stamp: Stamp,
    /// \[rad\]
    pub q: [f64; JOINTS],
    /// \[rad/s\]
    pub qd: [f64; JOINTS],
    /// In the arm's own unit; zeros where it measures none.
    pub effort: [f64; JOINTS],
    /// Its own safety system lets it move.
    pub motion_allowed: bool,
}

impl Measured {
    /// Without effort, free to move.
    #[must_use]
    pub const fn plain(stamp: Stamp, q: [f64; JOINTS], qd: [f64; JOINTS]) -> Self {
        Self { stamp, q, qd, effort: [0.0; JOINTS], motion_allowed: true }
    }

    /// As the law reads it.
    #[must_use]
    pub const fn reading(&self) -> JointReading<JOINTS> {
        let Self { stamp, q, qd, motion_allowed, .. } = *self;
        JointReading { stamp, q, qd, motion_allowed }
    }

    /// Its efforts, of this unit, as the law reads them.
    #[must_use]
    pub const fn efforts(&self, unit: EffortUnit) -> EffortReading<JOINTS> {
        EffortReading { stamp: self.stamp, effort: self.effort, unit }
    }
}

/// What a loop knows of the arm before it runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmFacts {
    /// From command to motion at low frequency \[s\]; `None`: the settings' dead time holds.
    pub group_delay_s: Option<f64>,
    /// Look-ahead of its servo \[s\], for a plan that models the servo; 0: none is known.
    pub look_ahead_s: f64,
    /// It lags by a servo of its own, for which plans lead; false for ideal arms and pure delays.
    pub servo: bool,
    /// Unit of the efforts that it measures; `None`: it measures none.
    pub effort: Option<EffortUnit>,
}

/// An arm, one control period at a time.
pub trait DeskArm: std::fmt::Debug + Send {
    /// What the loop knows of it.
    fn facts(&self) -> ArmFacts;

    /// The joints at rest at `now`, before the first period.
    ///
    /// # Errors
    /// An arm that cannot be reached.
    fn begin(&mut self, now: Stamp) -> Result<Measured, ArmError>;

    /// Moves through the period that ends at `until` with the command made at its beginning, which holds for
    /// its end; `None`: nobody is in charge, and it stands. Returns what is measured then.
    ///
    /// # Errors
    /// An arm that cannot go on.
    fn step(&mut self, until: Stamp, command: Option<&JointCommand<JOINTS>>) -> Result<Measured, ArmError>;

    /// A limit of the arm itself shaped its last cycle.
    fn clamped(&self) -> bool {
        false
    }
}

// It is copied once a run; a box would make every use of it a clone.
#[allow(clippy::large_enum_variant)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArmKind {
    /// Follows commands exactly, without delay.
    Ideal,
    /// Follows commands with this delay \[s\]; no limits.
    Delayed(f64),
    /// A simulated UR5 behind its servo.
    Ur5(ArmSettings),
}

impl ArmKind {
    /// What a loop knows of it.
    #[must_use]
    pub fn facts(self) -> ArmFacts {
        let (group_delay_s, look_ahead_s, servo) = match self {
            Self::Ideal => (0.0, 0.0, false),
            Self::Delayed(delay_s) => (delay_s, 0.0, false),
            Self::Ur5(arm) => (arm.group_delay_s(), arm.look_ahead_s, true),
        };
        ArmFacts { group_delay_s: Some(group_delay_s), look_ahead_s, servo, effort: None }
    }

    /// The arm, at rest at `home` \[rad\].
    #[must_use]
    pub fn built(self, home: [f64; JOINTS]) -> Box<dyn DeskArm> {
        match self {
            Self::Ideal => Box::new(IdealArm { q: home, qd: [0.0; JOINTS] }),
            Self::Delayed(delay_s) => {
                Box::new(DelayedArm { delay_s, q: home, qd: [0.0; JOINTS], underway: VecDeque::new() })
            }
            Self::Ur5(settings) => Box::new(ServoArm(ArmModel::at_rest(settings, home))),
        }
    }
}

/// [`ArmKind::Ideal`]
#[derive(Debug)]
struct IdealArm {
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
}

impl DeskArm for IdealArm {
    fn facts(&self) -> ArmFacts {
        ArmKind::Ideal.facts()
    }

    fn begin(&mut self, now: Stamp) -> Result<Measured, ArmError> {
        Ok(Measured::plain(now, self.q, self.qd))
    }

    fn step(&mut self, until: Stamp, command: Option<&JointCommand<JOINTS>>) -> Result<Measured, ArmError> {
        if let Some(command) = command {
            (self.q, self.qd) = (command.q, command.qd);
        }
        Ok(Measured::plain(until, self.q, self.qd))
    }
}

/// [`ArmKind::Delayed`]
#[derive(Debug)]
struct DelayedArm {
    delay_s: f64,
    q: [f64; JOINTS],
    qd: [f64; JOINTS],
    underway: VecDeque<JointCommand<JOINTS>>,
}

impl DeskArm for DelayedArm {
    fn facts(&self) -> ArmFacts {
        ArmKind::Delayed(self.delay_s).facts()
    }

    fn begin(&mut self, now: Stamp) -> Result<Measured, ArmError> {
        Ok(Measured::plain(now, self.q, self.qd))
    }

    fn step(&mut self, until: Stamp, command: Option<&JointCommand<JOINTS>>) -> Result<Measured, ArmError> {
        if let Some(command) = command {
            self.underway.push_back(*command);
            // The command that ends at or after the instant which the arm has reached holds for it, as a
            // line.
            let since = |c: &JointCommand<JOINTS>| command.stamp.seconds_since(c.stamp);
            let passed = |c: &JointCommand<JOINTS>| since(c) - self.delay_s > 1e-9;
            while self.underway.len() > 1 && self.underway.front().is_some_and(passed) {
                self.underway.pop_front();
            }
            if let Some(due) = self.underway.front().filter(|c| since(c) > self.delay_s - 1e-9) {
                (self.q, self.qd) = (due.q, due.qd);
            }
        }
        Ok(Measured::plain(until, self.q, self.qd))
    }
}

/// [`ArmKind::Ur5`]
#[derive(Debug)]
struct ServoArm(ArmModel);

impl DeskArm for ServoArm {
    fn facts(&self) -> ArmFacts {
        ArmKind::Ur5(*self.0.settings()).facts()
    }

    fn begin(&mut self, now: Stamp) -> Result<Measured, ArmError> {
        let joints = self.0.joints();
        Ok(Measured::plain(now, joints.q, joints.qd))
    }

    fn step(&mut self, until: Stamp, command: Option<&JointCommand<JOINTS>>) -> Result<Measured, ArmError> {
        if let Some(command) = command {
            // The controller follows the command's line; at the beginning of its cycle that is one period
            // back.
            let cycle_s = self.0.settings().cycle_s;
            let mut target = command.q;
            for (q, qd) in target.iter_mut().zip(&command.qd) {
                *q -= qd * cycle_s;
            }
            self.0.cycle(target);
        }
        self.begin(until)
    }

    fn clamped(&self) -> bool {
        self.0.clamped()
    }
}

/// A joint is asked for more velocity, or for more acceleration from `before` to `after` \[rad/s\], than it
/// is allowed.
pub(crate) fn exceeds(
    limits: &JointLimits<JOINTS>,
    before: &[f64; JOINTS],
    after: &[f64; JOINTS],
    period_s: f64,
) -> bool {
    // Tolerance for rounding.
    const ROUNDING: f64 = 1.0 + 1e-6;
    let allowed = limits.velocity().iter().zip(limits.acceleration());
    before.iter().zip(after).zip(allowed).any(|((before, after), (velocity, acceleration))| {
        after.abs() > velocity * ROUNDING || (after - before).abs() > acceleration * period_s * ROUNDING
    })
}
