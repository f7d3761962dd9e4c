//! The instants at which models predict, the true positions, and both as CSV for others to predict elsewhere.

use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::super::{CharacterSequence, PADDING_STEPS};
use super::{LEADS_MS, STRIDE_S};

/// Half the stretch of true motion that defines its direction \[s\].
const DIRECTION_S: f64 = 0.01;

/// One instant of one sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instant {
    /// Which sequence of the set.
    pub sequence: usize,
    /// t, the newest point seen.
    pub point: usize,
    /// Bit i: the target [`LEADS_MS`]`[i]` ahead is scored.
    pub leads: u32,
}

impl Instant {
    /// Indices into [`LEADS_MS`] of the scored targets.
    pub fn scored(self) -> impl Iterator<Item = usize> {
        (0..LEADS_MS.len()).filter(move |lead| self.leads & (1 << lead) != 0)
    }
}

/// A true position and the direction of the motion there, relative to the newest point seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Displacement since p\[t\] \[raw units\].
    pub position: [f64; 2],
    /// Displacement of the pen around the target \[raw units\]; zero where it rests.
    pub motion: [f64; 2],
}

/// The instants of a set.
#[derive(Debug, Clone)]
pub struct Targets {
    /// p of every sequence; one point more than it has displacements, rest left out.
    points: Vec<Vec<[f64; 2]>>,
    /// For every point of every sequence the last one of its stroke.
    stroke_ends: Vec<Vec<usize>>,
    rates_hz: Vec<f64>,
    /// In the order of the sequences and of time; only those with scored targets.
    pub instants: Vec<Instant>,
}

impl Targets {
    /// Every scored target of `sequences`.
    #[must_use]
    pub fn of(sequences: &[CharacterSequence]) -> Self {
        let points: Vec<Vec<[f64; 2]>> = sequences.iter().map(points).collect();
        let stroke_ends: Vec<Vec<usize>> =
            points.iter().zip(sequences).map(|(p, s)| stroke_ends(p.len(), &s.jump)).collect();
        let rates_hz = sequences.iter().map(|s| s.rate_hz).collect();
        let mut targets = Self { points, stroke_ends, rates_hz, instants: Vec::new() };
        for (sequence, s) in sequences.iter().enumerate() {
            let stride = stride(s.rate_hz);
            let count = targets.points.get(sequence).map_or(0, Vec::len);
            for point in (stride..count).step_by(stride) {
                // The newest step seen must not be a jump itself.
                if s.jump.get(point - 1).copied().unwrap_or(true) {
                    continue;
                }
                let leads = (0..LEADS_MS.len())
                    .filter(|lead| targets.truth(sequence, point, *lead).is_some())
                    .fold(0, |bits, lead| bits | 1 << lead);
                if leads != 0 {
                    targets.instants.push(Instant { sequence, point, leads });
                }
            }
        }
        targets
    }

    /// `later` is the instant after `before`, in the same stroke.
    #[must_use]
    pub fn follows(&self, before: Instant, later: Instant) -> bool {
        let end = |instant: Instant| self.stroke_ends.get(instant.sequence)?.get(instant.point).copied();
        let stride = self.rates_hz.get(later.sequence).map_or(0, |rate_hz| stride(*rate_hz));
        before.sequence == later.sequence
            && before.point + stride == later.point
            && end(before).is_some()
            && end(before) == end(later)
    }

    /// Samples from the newest point to the target, with their fraction.
    #[must_use]
    pub fn steps_ahead(&self, sequence: usize, lead: usize) -> f64 {
        let rate_hz = self.rates_hz.get(sequence).copied().unwrap_or(f64::NAN);
        LEADS_MS.get(lead).map_or(f64::NAN, |ms| f64::from(*ms) * rate_hz / 1000.0)
    }

    /// Where the pen was `LEADS_MS[lead]` after `point`; `None` past the end of the stroke.
    #[must_use]
    pub fn truth(&self, sequence: usize, point: usize, lead: usize) -> Option<Truth> {
        let points = self.points.get(sequence)?;
        let last = *self.stroke_ends.get(sequence)?.get(point)?;
        let [x, y] = *points.get(point)?;
        let rate_hz = *self.rates_hz.get(sequence)?;
        let at = point as f64 + self.steps_ahead(sequence, lead);
        // A target on a sample may lie past it by a rounding error.
        if !(at <= last as f64 + 1e-9) {
            return None;
        }
        let position = between(points, at)?;
        let reach = DIRECTION_S * rate_hz;
        let before = between(points, (at - reach).max(point as f64))?;
        let after = between(points, (at + reach).min(last as f64))?;
        Some(Truth {
            position: [position[0] - x, position[1] - y],
            motion: [after[0] - before[0], after[1] - before[1]],
        })
    }

    /// p of a sequence.
    #[must_use]
    pub fn points(&self, sequence: usize) -> &[[f64; 2]] {
        self.points.get(sequence).map_or(&[], Vec::as_slice)
    }
}

/// The path at a fractional index, straight between its points.
pub(super) fn between(points: &[[f64; 2]], at: f64) -> Option<[f64; 2]> {
    let index = at.floor().max(0.0);
    let [x, y] = *points.get(index as usize)?;
    let Some([x1, y1]) = points.get(index as usize + 1) else { return Some([x, y]) };
    let share = at - index;
    Some([x + share * (x1 - x), y + share * (y1 - y)])
}

/// Samples from instant to instant.
fn stride(rate_hz: f64) -> usize {
    ((STRIDE_S * rate_hz).round() as usize).max(1)
}

fn points(sequence: &CharacterSequence) -> Vec<[f64; 2]> {
    let real = sequence.v.len().saturating_sub(PADDING_STEPS);
    let mut at = [0.0; 2];
    let mut points = vec![at];
    for v in sequence.v.iter().take(real) {
        at = [at[0] + v[0], at[1] + v[1]];
        points.push(at);
    }
    points
}

/// `jump[t]`: from point t to point t + 1 the stroke changes.
fn stroke_ends(count: usize, jump: &[bool]) -> Vec<usize> {
    let mut ends = vec![0; count];
    let mut end = count.saturating_sub(1);
    for (point, slot) in ends.iter_mut().enumerate().rev() {
        if jump.get(point).copied().unwrap_or(false) {
            end = point;
        }
        *slot = end;
    }
    ends
}

/// Writes `NAME-points.csv` (file, segment, t, x, y, stroke_start) and `NAME-targets.csv` (file, segment, t,
/// lead).
///
/// # Errors
/// Whatever the file system says.
pub fn export(
    folder: &Path,
    name: &str,
    sequences: &[CharacterSequence],
) -> io::Result<[std::path::PathBuf; 2]> {
    std::fs::create_dir_all(folder)?;
    let targets = Targets::of(sequences);
    let paths = [folder.join(format!("{name}-points.csv")), folder.join(format!("{name}-targets.csv"))];
    foretrace_host::whole::write(&paths[0], |out| {
        writeln!(out, "file,segment,t,t_s,x,y,stroke_start")?;
        for (index, s) in sequences.iter().enumerate() {
            for (t, [x, y]) in targets.points(index).iter().enumerate() {
                let start = t == 0 || s.jump.get(t - 1).copied().unwrap_or(false);
                let (file, segment, time) = (quoted(&s.file), s.segment, t as f64 / s.rate_hz);
                writeln!(out, "{file},{segment},{t},{time:.6},{x},{y},{}", u8::from(start))?;
            }
        }
        Ok(())
    })?;
    foretrace_host::whole::write(&paths[1], |out| write_targets(out, sequences, &targets))?;
    Ok(paths)
}

fn write_targets(
    out: &mut BufWriter<std::fs::File>,
    sequences: &[CharacterSequence],
    targets: &Targets,
) -> io::Result<()> {
    writeln!(out, "file,segment,t,lead")?;
    for instant in &targets.instants {
        let Some(s) = sequences.get(instant.sequence) else { continue };
        let file = quoted(&s.file);
        for ms in instant.scored().filter_map(|lead| LEADS_MS.get(lead)) {
            writeln!(out, "{file},{},{},{ms}", s.segment, instant.point)?;
        }
    }
    Ok(())
}

/// A CSV field, in quotes where it has to be.
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}
