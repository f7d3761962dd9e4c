//! The bytes of the lock-step socket; `docs/extend/judge.md` has the same as tables.
//!
//! Contract: pure; little-endian, fixed sizes. Whatever is read is checked: every refusal says what, where
//! and what would do.

use foretrace_control::units::Stamp;
use foretrace_sim::arm::JOINTS;

/// First bytes of every message.
pub const MAGIC: [u8; 4] = *b"FTLS";
/// Version of the messages.
pub const VERSION: u16 = 1;
/// Sizes \[B\]: header, the law's hello, the arm's, command, state.
pub const HEADER: usize = 16;
/// See [`HEADER`].
pub const LAW_HELLO: usize = HEADER + 16 + 8 * JOINTS;
/// See [`HEADER`].
pub const ARM_HELLO: usize = HEADER + 24 + 8 * JOINTS;
/// See [`HEADER`].
pub const COMMAND: usize = HEADER + 24 + 16 * JOINTS;
/// See [`HEADER`].
pub const STATE: usize = HEADER + 24 + 24 * JOINTS;

/// The arm may not be farther than this from 0 \[rad\], nor faster \[rad/s\]: as at the daemon's own door.
const MOST_RAD: f64 = 4.0 * std::f64::consts::PI;
const MOST_RADPS: f64 = 100.0;
/// Legal rates \[Hz\] and largest group delay \[s\].
const RATES_HZ: [f64; 2] = [1.0, 100_000.0];
const MOST_DELAY_S: f64 = 1.0;

/// What a message is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Kind {
    /// The law says who it is.
    LawHello = 1,
    ArmHello = 2,
    Command = 3,
    State = 4,
}

impl Kind {
    /// Its whole size \[B\].
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::LawHello => LAW_HELLO,
            Self::ArmHello => ARM_HELLO,
            Self::Command => COMMAND,
            Self::State => STATE,
        }
    }
}

/// The unit of an arm's effort.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
#[repr(u32)]
pub enum ArmEffortUnit {
    /// It measures none; the numbers are ignored.
    None = 0,
    NewtonMetre = 1,
    Ampere = 2,
}

/// The first message of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LawHello {
    /// Length of a tick \[ns\].
    pub period_ns: u64,
    /// Instant at which the run begins.
    pub begin: Stamp,
    /// Where the settings have the arm begin \[rad\].
    pub home: [f64; JOINTS],
}

/// The answer of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmHello {
    /// Rate of its own controller \[Hz\].
    pub rate_hz: f64,
    /// From command to motion at low frequency \[s\]; `None`: unknown, the settings' dead time holds.
    pub group_delay_s: Option<f64>,
    pub effort: ArmEffortUnit,
    /// Where it stands, at rest \[rad\].
    pub q: [f64; JOINTS],
}

/// One tick of the law.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// The instant that the arm moves to, for which `q` holds: the end of the tick.
    pub until: Stamp,
    /// Counts up by one a message, from 0.
    pub tick: u64,
    /// The law is in charge and the command is to be obeyed; else the arm stands by itself.
    pub enabled: bool,
    /// \[rad\]
    pub q: [f64; JOINTS],
    /// \[rad/s\]
    pub qd: [f64; JOINTS],
}

/// What the arm answers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmAnswer {
    /// When this was measured: never before the state before it, never after the command's `until`.
    pub stamp: Stamp,
    /// That of the command that it answers.
    pub tick: u64,
    /// Its own safety system lets it move.
    pub motion_allowed: bool,
    /// \[rad\]
    pub q: [f64; JOINTS],
    /// \[rad/s\]
    pub qd: [f64; JOINTS],
    /// In the hello's unit.
    pub effort: [f64; JOINTS],
}

/// Bytes that are no message, or a message that may not be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// Not ours.
    #[error(
        "a message begins with {0:02x?} instead of \"FTLS\"; send the {HEADER} bytes of the header first"
    )]
    Magic([u8; 4]),
    /// Another version.
    #[error("a message is of version {0}, this program speaks {VERSION}; see docs/extend/judge.md")]
    Version(u16),
    /// Another message.
    #[error("a message is of kind {found}, expected {expected} ({expected:?})", expected = *.expected as u16)]
    Kind { found: u16, expected: Kind },
    /// Another size.
    #[error("a message of kind {kind} says that it has {found} bytes, it must have {expected}")]
    Length {
        kind: u16,
        /// As sent \[B\].
        found: u32,
        /// Its size \[B\].
        expected: usize,
    },
    /// Another arm.
    #[error("the arm has {0} joints, the law {JOINTS}; give one of {JOINTS}")]
    Joints(u32),
    /// A number out of its range.
    #[error("{field} is {value}, legal is {low} to {high}")]
    Range {
        field: &'static str,
        value: f64,
        low: f64,
        /// See `low`.
        high: f64,
    },
    /// A joint's number out of its range.
    #[error("{field} of joint {joint} is {value}, legal is -{most} to {most}")]
    Joint {
        field: &'static str,
        /// Base first, from 0.
        joint: usize,
        value: f64,
        most: f64,
    },
    /// An unknown unit or flag.
    #[error("{field} is {value}, legal is {legal}")]
    Choice { field: &'static str, value: u32, legal: &'static str },
    /// The answer to another command.
    #[error("a state answers command {found}, {expected} is due; send one state per command, in order")]
    Tick {
        found: u64,
        /// That of the newest command.
        expected: u64,
    },
    /// A stamp that goes back.
    #[error("a state is stamped {found} ns, before the one before it ({before} ns)")]
    Back {
        /// As sent \[ns\].
        found: u64,
        /// The stamp before \[ns\].
        before: u64,
    },
    /// A stamp from the future.
    #[error("a state is stamped {found} ns, after the instant that it was asked for ({until} ns)")]
    Future {
        /// As sent \[ns\].
        found: u64,
        /// The command's instant \[ns\].
        until: u64,
    },
}

struct FrameWriter<const SIZE: usize> {
    bytes: [u8; SIZE],
    at: usize,
}

impl<const SIZE: usize> FrameWriter<SIZE> {
    fn new(kind: Kind) -> Self {
        let mut out = Self { bytes: [0; SIZE], at: 0 };
        out.put(&MAGIC).put(&VERSION.to_le_bytes()).put(&(kind as u16).to_le_bytes());
        out.put(&(SIZE as u32).to_le_bytes()).put(&(JOINTS as u32).to_le_bytes());
        out
    }

    fn put(&mut self, bytes: &[u8]) -> &mut Self {
        if let Some(slot) = self.bytes.get_mut(self.at..self.at + bytes.len()) {
            slot.copy_from_slice(bytes);
        }
        self.at += bytes.len();
        self
    }

    fn floats(&mut self, values: &[f64]) -> &mut Self {
        for value in values {
            self.put(&value.to_le_bytes());
        }
        self
    }
}

struct FrameReader<'a>(&'a [u8]);

impl FrameReader<'_> {
    fn take<const SIZE: usize>(&mut self) -> [u8; SIZE] {
        // Sizes are checked before: nothing is ever short.
        let (head, rest) = self.0.split_at_checked(SIZE).unwrap_or((&[], &[]));
        self.0 = rest;
        head.try_into().unwrap_or([0; SIZE])
    }

    fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }

    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }

    fn joints(&mut self, field: &'static str, most: f64) -> Result<[f64; JOINTS], WireError> {
        let mut all = [0.0; JOINTS];
        for (joint, slot) in all.iter_mut().enumerate() {
            let value = self.f64();
            if !(value.abs() <= most) {
                return Err(WireError::Joint { field, joint, value, most });
            }
            *slot = value;
        }
        Ok(all)
    }
}

fn range(field: &'static str, value: f64, [low, high]: [f64; 2]) -> Result<f64, WireError> {
    if (low..=high).contains(&value) { Ok(value) } else { Err(WireError::Range { field, value, low, high }) }
}

/// Checks the header of a message of which [`HEADER`] bytes are there; the rest follows it.
///
/// # Errors
/// Anything but a message of this kind.
pub fn check_header(header: &[u8; HEADER], expected: Kind) -> Result<(), WireError> {
    let mut reader = FrameReader(header);
    let magic = reader.take();
    if magic != MAGIC {
        return Err(WireError::Magic(magic));
    }
    let (version, kind, length, joints) = (reader.u16(), reader.u16(), reader.u32(), reader.u32());
    if version != VERSION {
        return Err(WireError::Version(version));
    }
    if kind != expected as u16 {
        return Err(WireError::Kind { found: kind, expected });
    }
    if length as usize != expected.size() {
        return Err(WireError::Length { kind, found: length, expected: expected.size() });
    }
    if joints as usize != JOINTS {
        return Err(WireError::Joints(joints));
    }
    Ok(())
}

/// A message whole, without its header.
fn body<'a, const SIZE: usize>(bytes: &'a [u8; SIZE], kind: Kind) -> Result<FrameReader<'a>, WireError> {
    let mut header = [0; HEADER];
    header.copy_from_slice(&bytes[..HEADER]);
    check_header(&header, kind)?;
    Ok(FrameReader(&bytes[HEADER..]))
}

impl LawHello {
    #[must_use]
    pub fn encode(&self) -> [u8; LAW_HELLO] {
        let mut out = FrameWriter::new(Kind::LawHello);
        out.put(&self.period_ns.to_le_bytes()).put(&self.begin.0.to_le_bytes()).floats(&self.home);
        out.bytes
    }

    /// From bytes, for peers in Rust.
    ///
    /// # Errors
    /// Anything but such a message.
    pub fn decode(bytes: &[u8; LAW_HELLO]) -> Result<Self, WireError> {
        let mut reader = body(bytes, Kind::LawHello)?;
        let (period_ns, begin) = (reader.u64(), Stamp(reader.u64()));
        Ok(Self { period_ns, begin, home: reader.joints("home", MOST_RAD)? })
    }
}

impl ArmHello {
    #[must_use]
    pub fn encode(&self) -> [u8; ARM_HELLO] {
        let mut out = FrameWriter::new(Kind::ArmHello);
        out.floats(&[self.rate_hz, self.group_delay_s.unwrap_or(-1.0)]);
        out.put(&(self.effort as u32).to_le_bytes()).put(&[0; 4]).floats(&self.q);
        out.bytes
    }

    /// From bytes.
    ///
    /// # Errors
    /// Anything but such a message.
    pub fn decode(bytes: &[u8; ARM_HELLO]) -> Result<Self, WireError> {
        let mut reader = body(bytes, Kind::ArmHello)?;
        let rate_hz = range("the rate [Hz]", reader.f64(), RATES_HZ)?;
        let delay = reader.f64();
        let group_delay_s = if delay == -1.0 {
            None
        } else {
            Some(range("the group delay [s] (-1: unknown)", delay, [0.0, MOST_DELAY_S])?)
        };
        let effort = match reader.u32() {
            0 => ArmEffortUnit::None,
            1 => ArmEffortUnit::NewtonMetre,
            2 => ArmEffortUnit::Ampere,
            value => {
                let legal = "0 (none), 1 (Nm) or 2 (A)";
                return Err(WireError::Choice { field: "the effort unit", value, legal });
            }
        };
        reader.u32();
        Ok(Self { rate_hz, group_delay_s, effort, q: reader.joints("q [rad]", MOST_RAD)? })
    }
}

impl Command {
    #[must_use]
    pub fn encode(&self) -> [u8; COMMAND] {
        let mut out = FrameWriter::new(Kind::Command);
        out.put(&self.until.0.to_le_bytes()).put(&self.tick.to_le_bytes());
        out.put(&u32::from(self.enabled).to_le_bytes()).put(&[0; 4]).floats(&self.q).floats(&self.qd);
        out.bytes
    }

    /// From bytes, for peers in Rust.
    ///
    /// # Errors
    /// Anything but such a message.
    pub fn decode(bytes: &[u8; COMMAND]) -> Result<Self, WireError> {
        let mut reader = body(bytes, Kind::Command)?;
        let (until, tick) = (Stamp(reader.u64()), reader.u64());
        let enabled = flag(&mut reader)?;
        let (q, qd) = (reader.joints("q [rad]", MOST_RAD)?, reader.joints("q̇ [rad/s]", MOST_RADPS)?);
        Ok(Self { until, tick, enabled, q, qd })
    }
}

impl ArmAnswer {
    /// As bytes, for peers in Rust.
    #[must_use]
    pub fn encode(&self) -> [u8; STATE] {
        let mut out = FrameWriter::new(Kind::State);
        out.put(&self.stamp.0.to_le_bytes()).put(&self.tick.to_le_bytes());
        out.put(&u32::from(self.motion_allowed).to_le_bytes()).put(&[0; 4]);
        out.floats(&self.q).floats(&self.qd).floats(&self.effort);
        out.bytes
    }

    /// From bytes: the answer to `command` after a state measured at `before`, of an arm whose effort has
    /// `unit`.
    ///
    /// # Errors
    /// Anything but such an answer.
    pub fn decode(
        bytes: &[u8; STATE],
        command: &Command,
        before: Stamp,
        unit: ArmEffortUnit,
    ) -> Result<Self, WireError> {
        let mut reader = body(bytes, Kind::State)?;
        let (stamp, tick) = (Stamp(reader.u64()), reader.u64());
        if tick != command.tick {
            return Err(WireError::Tick { found: tick, expected: command.tick });
        }
        if stamp < before {
            return Err(WireError::Back { found: stamp.0, before: before.0 });
        }
        if stamp > command.until {
            return Err(WireError::Future { found: stamp.0, until: command.until.0 });
        }
        let motion_allowed = flag(&mut reader)?;
        let (q, qd) = (reader.joints("q [rad]", MOST_RAD)?, reader.joints("q̇ [rad/s]", MOST_RADPS)?);
        let effort =
            if unit == ArmEffortUnit::None { [0.0; JOINTS] } else { reader.joints("the effort", 1e6)? };
        Ok(Self { stamp, tick, motion_allowed, q, qd, effort })
    }
}

/// Bit 0 of the flags, and four bytes of room behind them.
fn flag(reader: &mut FrameReader<'_>) -> Result<bool, WireError> {
    let flags = reader.u32();
    reader.u32();
    if flags > 1 {
        return Err(WireError::Choice { field: "the flags", value: flags, legal: "0 or 1" });
    }
    Ok(flags == 1)
}
