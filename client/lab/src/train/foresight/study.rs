//! What a network may see: the loop's features, less those that an ablation leaves out, or more.

use foretrace_control::pen::{TARGET_RMS, Touch};
use foretrace_control::predict::models::foresight::features::{block_for, block_of, kinds};
use foretrace_control::predict::models::foresight::{FEATURES, turned};

use super::network::ForesightShape;

/// Inputs about the whole letter.
const LETTER: usize = 12;
/// Labels are told apart by as many inputs.
const LABELS: usize = 96;

/// What an ablation leaves out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Without {
    /// Touch, its age and that of the phase before.
    pub contact: bool,
    /// The direction of motion in the plane.
    pub direction: bool,
    /// Time since pen down or up and since the last jump.
    pub time: bool,
}

/// What a network knows of the past.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Context {
    /// The last 0.24 s.
    #[default]
    Short,
    /// The last second, as far as the history reaches.
    Second,
    /// The last second, and where the pen has been since the letter began.
    Letter,
    /// That, and which letter it is going to be: a bound on what a recogniser could bring.
    Told,
}

impl Context {
    /// All of them, in the order of what they know.
    pub const ALL: [Self; 4] = [Self::Short, Self::Second, Self::Letter, Self::Told];

    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Short => "short",
            Self::Second => "second",
            Self::Letter => "letter",
            Self::Told => "told",
        }
    }
}

/// The inputs of a network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Study {
    pub without: Without,
    /// Known of the past.
    pub context: Context,
}

impl Study {
    /// Steps of a block of the history.
    #[must_use]
    pub fn block(&self, step_s: f64) -> usize {
        if self.context == Context::Short { block_of(step_s) } else { block_for(1.0, step_s) }
    }

    /// Width of a row.
    #[must_use]
    pub fn inputs(&self) -> usize {
        let more = match self.context {
            Context::Short | Context::Second => 0,
            Context::Letter => LETTER,
            Context::Told => LETTER + LABELS,
        };
        ForesightShape::of(FEATURES + more).inputs
    }

    /// Inputs that an ablation holds at zero.
    pub(super) fn absent(&self) -> impl Iterator<Item = usize> {
        let Without { contact, direction, time } = self.without;
        let none = 0..0;
        let of = |absent, kind| if absent { kind } else { none.clone() };
        of(contact, kinds::CONTACT)
            .chain(of(direction, kinds::DIRECTION))
            .chain(of(time, kinds::TIME))
            .collect::<Vec<_>>()
            .into_iter()
    }

    /// Turns the loop's features into this study's.
    pub(super) fn amend(&self, row: &mut [f32], teller: &Teller, frame: [f64; 2]) {
        for absent in self.absent() {
            row[absent] = 0.0;
        }
        if self.context == Context::Letter || self.context == Context::Told {
            let letter = row[FEATURES..].iter_mut().zip(teller.letter(frame));
            letter.for_each(|(slot, number)| *slot = number as f32);
        }
        if self.context == Context::Told {
            row[FEATURES + LETTER + teller.label] = 1.0;
        }
    }
}

/// What is known of the letter under way.
#[derive(Debug, Clone)]
pub(super) struct Teller {
    label: usize,
    /// From where the letter began \[normalised\].
    at: [f64; 2],
    low: [f64; 2],
    high: [f64; 2],
    /// From where the present stroke or hover began.
    stroke: [f64; 2],
    touch: Option<bool>,
    strokes: f64,
    way: f64,
    seconds: f64,
}

impl Teller {
    pub(super) fn new(label: &str) -> Self {
        // Printable characters have inputs of their own, longer labels share them.
        let sum = label.bytes().fold(0_usize, |sum, byte| (sum * 31 + usize::from(byte)) % 7919);
        let label = match label.as_bytes() {
            [byte @ 32..=126] => usize::from(byte - 32),
            _ => sum % LABELS,
        };
        Self {
            label,
            at: [0.0; 2],
            low: [0.0; 2],
            high: [0.0; 2],
            stroke: [0.0; 2],
            touch: None,
            strokes: 0.0,
            way: 0.0,
            seconds: 0.0,
        }
    }

    /// A jump: where the pen is now relative to the letter's beginning is not known.
    pub(super) fn interrupt(&mut self) {
        self.stroke = [0.0; 2];
        self.touch = None;
    }

    pub(super) fn observe(&mut self, [x, y]: [f64; 2], touch: Touch, step_s: f64) {
        self.at = [self.at[0] + x, self.at[1] + y];
        self.way += x.hypot(y);
        self.seconds += step_s;
        for (axis, at) in self.at.iter().enumerate() {
            self.low[axis] = self.low[axis].min(*at);
            self.high[axis] = self.high[axis].max(*at);
        }
        if self.touch != Some(touch.contact) {
            self.stroke = [0.0; 2];
            self.strokes += f64::from(u8::from(touch.contact));
            self.touch = Some(touch.contact);
        }
        self.stroke = [self.stroke[0] + x, self.stroke[1] + y];
    }

    fn letter(&self, frame: [f64; 2]) -> [f64; LETTER] {
        /// Ordinary steps in a letter: makes numbers of order 1.
        const STEPS: f64 = 30.0;
        let unit = TARGET_RMS * STEPS;
        let scaled = |v: [f64; 2]| v.map(|x| x / unit);
        let [a, b] = scaled(turned(frame, self.at));
        let [c, d] = scaled(turned(frame, self.stroke));
        let [e, f] = scaled(self.at);
        let [g, h] = scaled([self.high[0] - self.low[0], self.high[1] - self.low[1]]);
        let [i, j] = scaled([self.at[0] - self.low[0], self.at[1] - self.low[1]]);
        let age = self.seconds / (self.seconds + 0.5);
        [a, b, c, d, e, f, g, h, i, j, age, (self.strokes / 4.0).min(2.0)]
    }
}
