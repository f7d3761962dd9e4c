//! Input events as plain numbers, and the codes that matter here. Source: linux/input-event-codes.h.

/// What an event is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// End of a group, or lost events.
    Syn,
    Key,
    Rel,
    Abs,
    /// Of no use here.
    Other,
}

impl Class {
    /// From the kernel's number.
    #[must_use]
    pub const fn of(number: u16) -> Self {
        match number {
            0 => Self::Syn,
            1 => Self::Key,
            2 => Self::Rel,
            3 => Self::Abs,
            _ => Self::Other,
        }
    }
}

/// One event of the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// When it happened, on the monotonic clock \[ns\].
    pub stamp_ns: u64,
    /// What it is about.
    pub class: Class,
    /// The axis or button.
    pub code: u16,
    /// Its new value, or its change.
    pub value: i32,
}

pub(crate) const SYN_REPORT: u16 = 0;
pub(crate) const SYN_DROPPED: u16 = 3;
pub(crate) const REL_X: u16 = 0;
pub(crate) const REL_Y: u16 = 1;
pub(crate) const ABS_X: u16 = 0;
pub(crate) const ABS_Y: u16 = 1;
pub(crate) const ABS_PRESSURE: u16 = 0x18;
pub(crate) const ABS_TILT_X: u16 = 0x1a;
pub(crate) const ABS_TILT_Y: u16 = 0x1b;
pub(crate) const BTN_LEFT: u16 = 0x110;
pub(crate) const BTN_RIGHT: u16 = 0x111;
pub(crate) const BTN_MIDDLE: u16 = 0x112;
pub(crate) const BTN_TOOL_PEN: u16 = 0x140;
pub(crate) const BTN_TOOL_RUBBER: u16 = 0x141;
pub(crate) const BTN_TOOL_BRUSH: u16 = 0x142;
pub(crate) const BTN_TOOL_PENCIL: u16 = 0x143;
pub(crate) const BTN_TOOL_AIRBRUSH: u16 = 0x144;
pub(crate) const BTN_STYLUS3: u16 = 0x149;
pub(crate) const BTN_TOUCH: u16 = 0x14a;
pub(crate) const BTN_STYLUS: u16 = 0x14b;
pub(crate) const BTN_STYLUS2: u16 = 0x14c;
