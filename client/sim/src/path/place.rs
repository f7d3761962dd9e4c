//! Characters in device units to one stamped path in the writing workspace.
//!
//! One constant scale for all of them. Recorded hover paths and gaps stay as they are; where a recording has
//! no hover path between two strokes, and between characters, a travel is synthesised. Hover samples more
//! than half a glyph outside the workspace are left out (the pen was out of reach); characters whose ink does
//! not fit are skipped and named.

use super::travel::travel;
use super::{LabelSpan, PathSample, PenPath};
use crate::data::{Character, Component};

/// Speeds at which a synthetic travel may leave and arrive \[m/s\]; faster strokes are left more slowly.
const JOIN_SPEED_MAX_MPS: f64 = 0.4;
/// Samples over which those speeds are averaged: single steps of a coarse tablet are noisy.
const JOIN_SAMPLES: usize = 5;
/// Longer recorded gaps are shortened to this [s]: real gaps inside a character are shorter, and files hold
/// counter overflows.
const GAP_MAX_S: f64 = 10.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// One over another in the centre of the workspace.
    Centre,
    /// From left to right along a line, starting again at the left when the width is used up.
    Line,
}

/// The point of a character that is aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The middle of its ink.
    Middle,
    /// Half the median glyph height above y = 0 of its own coordinates: keeps letters on a common base line.
    Baseline,
}

/// Treatment of a lift between two strokes without recorded hover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lift {
    /// A travel is synthesised.
    Travel,
    /// It stays as it was recorded: the pen is elsewhere one sample later.
    Leap,
}

/// The writing workspace and how characters are laid into it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Centre of the workspace \[m\].
    pub centre_m: [f64; 2],
    /// Width and height of the workspace \[m\].
    pub size_m: [f64; 2],
    /// Height that a character of median height gets \[m\].
    pub glyph_height_m: f64,
    pub layout: Layout,
    /// The point of a character that is aligned.
    pub anchor: Anchor,
    /// Treatment of a lift without recorded hover.
    pub lift: Lift,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            centre_m: [0.0, 0.0],
            size_m: [0.3, 0.2],
            glyph_height_m: 0.03,
            layout: Layout::Centre,
            anchor: Anchor::Middle,
            lift: Lift::Travel,
        }
    }
}

/// Ink and the time base it needs to become a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ink<'a> {
    /// In the order of writing.
    pub characters: &'a [Character],
    /// Rate of the device \[Hz\].
    pub rate_hz: f64,
    /// Median glyph height of the set the characters come from \[device units\]; fixes the one scale.
    pub median_height: f64,
}

/// Ink that could not become a path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PathError {
    /// A number that must be positive and finite is not.
    #[error("{what} is {value}; legal: positive and finite")]
    NotPositive { what: &'static str, value: f64 },
    /// Not one character could be placed.
    #[error("no character could be placed ({skipped} skipped{}); workspace {width_m} x {height_m} \
             m", first_suffix(first.as_ref()))]
    Nothing {
        /// How many were skipped.
        skipped: usize,
        /// Why the first one was.
        first: Option<String>,
        /// Width of the workspace \[m\].
        width_m: f64,
        /// Height of the workspace \[m\].
        height_m: f64,
    },
}

fn first_suffix(first: Option<&String>) -> String {
    first.map(|why| format!("; first: {why}")).unwrap_or_default()
}

impl PenPath {
    /// Lays characters into the workspace as one path that starts at t = 0; the second value names what was
    /// skipped.
    ///
    /// Time between samples is that of their stamps, else one over the rate, except across recorded gaps,
    /// which keep their duration without samples, and synthetic travels. A character without components is a
    /// blank: on a line it takes up space.
    ///
    /// # Errors
    /// [`PathError`]: a rate, height or size that is not positive, or no character that fits.
    pub fn from_ink(ink: Ink<'_>, placement: &Placement) -> Result<(Self, Vec<String>), PathError> {
        for (what, value) in [
            ("the device's rate [Hz]", ink.rate_hz),
            ("the median glyph height", ink.median_height),
            ("the workspace's width [m]", placement.size_m[0]),
            ("the workspace's height [m]", placement.size_m[1]),
            ("the glyph height [m]", placement.glyph_height_m),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(PathError::NotPositive { what, value });
            }
        }
        let mut writer = Placer::new(ink, placement);
        for character in ink.characters {
            writer.place(character);
        }
        let skipped = writer.skipped;
        if writer.path.samples.is_empty() {
            let [width_m, height_m] = placement.size_m;
            let first = skipped.first().cloned();
            return Err(PathError::Nothing { skipped: skipped.len(), first, width_m, height_m });
        }
        Ok((writer.path, skipped))
    }
}

/// A point on its way into the path.
#[derive(Debug, Clone, Copy)]
struct TimedPoint {
    at_m: [f64; 2],
    contact: bool,
    /// How the time since the previous sample was spent.
    link: Elapsed,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Elapsed {
    /// The next sample of the device, so long after the one before [s].
    Sampled(f64),
    /// Nothing was seen for this long \[s\].
    Gap(f64),
    /// A lift without recorded hover; lasts at least this long \[s\].
    Travel(f64),
}

struct Placer<'a> {
    placement: &'a Placement,
    metres_per_unit: f64,
    period_s: f64,
    /// Left end of the next character on a line, from the left border \[m\].
    pen_x_m: f64,
    path: PenPath,
    skipped: Vec<String>,
}

impl<'a> Placer<'a> {
    fn new(ink: Ink<'_>, placement: &'a Placement) -> Self {
        let path = PenPath {
            samples: Vec::new(),
            rate_hz: ink.rate_hz,
            spans: Vec::new(),
            inserted_travels: 0,
            gaps: 0,
            leaps: Vec::new(),
        };
        Self {
            placement,
            metres_per_unit: placement.glyph_height_m / ink.median_height,
            period_s: 1.0 / ink.rate_hz,
            pen_x_m: 0.0,
            path,
            skipped: Vec::new(),
        }
    }

    fn place(&mut self, character: &Character) {
        let Some(bounds) = character.ink_bounds() else {
            if character.components.is_empty() {
                self.pen_x_m += 0.6 * self.placement.glyph_height_m;
            } else {
                self.skip(character, "it has no ink");
            }
            return;
        };
        let size = [0, 1].map(|axis| (bounds[1][axis] - bounds[0][axis]) * self.metres_per_unit);
        let Some(offset) = self.offset(bounds, size) else {
            let [w, h] = size.map(|s| s * 1e3);
            let why = format!("its ink of {w:.0} x {h:.0} mm does not fit into the workspace");
            self.skip(character, &why);
            return;
        };
        let steps = self.steps(character, offset);
        self.append(character, &steps);
    }

    fn skip(&mut self, character: &Character, why: &str) {
        self.skipped.push(format!("{:?} (segment {}): {why}", character.label, character.segment_index));
    }

    /// What to add to the scaled ink \[m\]; `None` when it does not fit.
    fn offset(&mut self, bounds: [[f64; 2]; 2], size: [f64; 2]) -> Option<[f64; 2]> {
        let Placement { centre_m, size_m, glyph_height_m, .. } = *self.placement;
        let [low, high] = bounds.map(|corner| corner.map(|c| c * self.metres_per_unit));
        if !(size[0] <= size_m[0] && size[1] <= size_m[1]) {
            return None;
        }
        let y = match self.placement.anchor {
            Anchor::Middle => centre_m[1] - (low[1] + high[1]) / 2.0,
            Anchor::Baseline => centre_m[1] - glyph_height_m / 2.0,
        };
        if !(y + low[1] >= centre_m[1] - size_m[1] / 2.0 && y + high[1] <= centre_m[1] + size_m[1] / 2.0) {
            return None;
        }
        let x = match self.placement.layout {
            Layout::Centre => centre_m[0] - (low[0] + high[0]) / 2.0,
            Layout::Line => {
                if self.pen_x_m + size[0] > size_m[0] {
                    self.pen_x_m = 0.0;
                }
                let left = centre_m[0] - size_m[0] / 2.0 + self.pen_x_m;
                self.pen_x_m += size[0] + 0.3 * glyph_height_m;
                left - low[0]
            }
        };
        Some([x, y])
    }

    /// The character's points in the workspace, with how the pen came to each.
    fn steps(&self, character: &Character, offset: [f64; 2]) -> Vec<TimedPoint> {
        let mut steps: Vec<TimedPoint> = Vec::new();
        // Time passed since the last kept point without one being kept.
        let mut unseen_s = 0.0;
        let mut seen_last = true;
        let mut last_s: Option<f64> = None;
        for component in &character.components {
            if let Some(gap_s) = component.dt_before_s {
                unseen_s = (unseen_s + gap_s).min(GAP_MAX_S);
                seen_last = false;
            }
            if component.is_dummy() {
                continue;
            }
            for (index, point) in component.points.iter().enumerate() {
                let at_m = [0, 1].map(|axis| point[axis] * self.metres_per_unit + offset[axis]);
                let now_s = component.stamps_s.get(index).copied();
                let told = index == 0 && component.dt_before_s.is_some();
                let stamped_s = now_s.zip(last_s).map(|(now, last)| now - last).filter(|s| *s > 0.0);
                last_s = now_s;
                if !component.contact && !self.inside(at_m) {
                    unseen_s +=
                        if told && now_s.is_some() { 0.0 } else { stamped_s.unwrap_or(self.period_s) };
                    seen_last = false;
                    continue;
                }
                // A gap that the recording tells is the whole time since the last sample.
                let since_s = match stamped_s.filter(|_| !told) {
                    Some(stamped_s) => (unseen_s + stamped_s).min(GAP_MAX_S),
                    None => unseen_s,
                };
                let link = match steps.last() {
                    Some(last) if index == 0 && self.lifted_unseen(last, component, at_m, seen_last) => {
                        Elapsed::Travel(since_s)
                    }
                    Some(_) if !seen_last => Elapsed::Gap(since_s.max(self.period_s)),
                    _ => Elapsed::Sampled(stamped_s.unwrap_or(self.period_s)),
                };
                steps.push(TimedPoint { at_m, contact: component.contact, link });
                (unseen_s, seen_last) = (0.0, true);
            }
        }
        steps
    }

    /// Two strokes without a hover between them, or a jump that is too fast for a hand.
    fn lifted_unseen(&self, last: &TimedPoint, next: &Component, at_m: [f64; 2], seen_last: bool) -> bool {
        let leap_m = (at_m[0] - last.at_m[0]).hypot(at_m[1] - last.at_m[1]);
        (last.contact && next.contact && !next.continues)
            || (seen_last && leap_m > self.placement.glyph_height_m)
    }

    /// Within reach of the tablet, which sees half a glyph beyond the workspace.
    fn inside(&self, at_m: [f64; 2]) -> bool {
        let Placement { centre_m, size_m, glyph_height_m, .. } = self.placement;
        let reach = |s: &f64| (s + glyph_height_m) / 2.0;
        at_m.iter().zip(centre_m).zip(size_m).all(|((p, c), s)| (p - c).abs() <= reach(s))
    }

    fn append(&mut self, character: &Character, steps: &[TimedPoint]) {
        for (index, step) in steps.iter().enumerate() {
            let link =
                if index == 0 && !self.path.samples.is_empty() { Elapsed::Travel(0.0) } else { step.link };
            let leaps = self.placement.lift == Lift::Leap && matches!(link, Elapsed::Travel(_));
            if leaps {
                self.path.leaps.push(self.path.samples.len());
            }
            if let (false, Elapsed::Travel(at_least_s), Some(&last)) = (leaps, link, self.path.samples.last())
            {
                let arriving = self.arriving(steps.get(index..).unwrap_or_default());
                let rate_hz = self.path.rate_hz;
                let hover = travel(last, self.leaving(), step.at_m, arriving, rate_hz, at_least_s);
                self.path.samples.extend(hover);
                self.path.inserted_travels += 1;
            }
            let elapsed_s = match link {
                Elapsed::Gap(gap_s) => gap_s,
                Elapsed::Travel(at_least_s) if leaps => at_least_s.max(self.period_s),
                Elapsed::Sampled(elapsed_s) => elapsed_s,
                Elapsed::Travel(_) => self.period_s,
            };
            self.path.gaps += usize::from(matches!(link, Elapsed::Gap(_)));
            let t_s = self.path.samples.last().map_or(0.0, |last| last.t_s + elapsed_s);
            if index == 0 {
                let start = self.path.samples.len();
                self.path.spans.push(LabelSpan { label: character.label.clone(), samples: start..start });
            }
            let [x_m, y_m] = step.at_m;
            self.path.samples.push(PathSample { t_s, x_m, y_m, contact: step.contact });
        }
        let end = self.path.samples.len();
        if let Some(span) = self.path.spans.last_mut().filter(|_| !steps.is_empty()) {
            span.samples.end = end;
        }
    }

    /// Velocity with which the last written samples end \[m/s\].
    fn leaving(&self) -> [f64; 2] {
        let samples = &self.path.samples;
        let recent = samples.get(samples.len().saturating_sub(JOIN_SAMPLES)..).unwrap_or_default();
        match (recent.first(), recent.last()) {
            (Some(a), Some(b))
                if b.t_s - a.t_s > 0.0 && b.t_s - a.t_s < self.period_s * 2.0 * JOIN_SAMPLES as f64 =>
            {
                limited([(b.x_m - a.x_m) / (b.t_s - a.t_s), (b.y_m - a.y_m) / (b.t_s - a.t_s)])
            }
            _ => [0.0; 2],
        }
    }

    /// Velocity with which the coming samples begin \[m/s\].
    fn arriving(&self, coming: &[TimedPoint]) -> [f64; 2] {
        let sampled_s = |step: &TimedPoint| match step.link {
            Elapsed::Sampled(elapsed_s) => Some(elapsed_s),
            _ => None,
        };
        let steps: Vec<f64> = coming.iter().skip(1).map_while(sampled_s).take(JOIN_SAMPLES - 1).collect();
        let run = steps.len();
        match (coming.first(), coming.get(run)) {
            (Some(a), Some(b)) if run > 0 => {
                let even = steps.iter().all(|step| *step == self.period_s);
                let elapsed_s = if even { run as f64 * self.period_s } else { steps.iter().sum() };
                limited([0, 1].map(|axis| (b.at_m[axis] - a.at_m[axis]) / elapsed_s))
            }
            _ => [0.0; 2],
        }
    }
}

fn limited(velocity: [f64; 2]) -> [f64; 2] {
    let speed = velocity[0].hypot(velocity[1]);
    let share = if speed > JOIN_SPEED_MAX_MPS { JOIN_SPEED_MAX_MPS / speed } else { 1.0 };
    velocity.map(|v| v * share)
}
