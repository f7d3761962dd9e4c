//! A hand with a style: targets of a glyph to overlapping lognormal strokes to sampled ink.

use super::glyphs::StrokeTarget;
use super::lognormal::{Lognormal, TAIL};
use crate::data::Component;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// 2 % to 98 % of a stroke of 1 em at tempo 1 \[s\].
const STROKE_S: f64 = 0.23;
/// Shortest stroke [s]: the muscles' own limit.
const STROKE_MIN_S: f64 = 0.08;
/// Longer strokes are faster: time grows with this power of the length (isochrony would be 0).
const ISOCHRONY: f64 = 0.4;
/// Shortest hover between components \[s\].
const HOVER_MIN_S: f64 = 0.3;
/// z of the share of a stroke that is done when the next one sets in: on a smooth bend, at a reversal.
const OVERLAP_Z: [f64; 2] = [0.1, 1.6];

/// The style of a hand.
#[derive(Debug, Clone, PartialEq)]
pub struct Style {
    /// Drives every random choice of the hand.
    pub seed: u64,
    /// Forward slant \[rad\].
    pub slant_rad: f64,
    /// Width of letters relative to the table's.
    pub width: f64,
    /// Height of letters relative to the table's.
    pub height: f64,
    /// Speed of writing; 2 takes half the time.
    pub tempo: f64,
    /// Log response time σ of the strokes: larger is more skewed.
    pub sigma: f64,
    /// Standard deviation with which targets are missed \[em\].
    pub aim_em: f64,
    /// Standard deviation of bends \[rad\].
    pub bend_rad: f64,
    /// Relative standard deviation of stroke timing.
    pub timing: f64,
    /// How much strokes run into each other at corners, 0 (square) to 1 (round).
    pub roundness: f64,
    /// Amplitude of physiological tremor, 8 to 12 Hz \[em\].
    pub tremor_em: f64,
}

impl Style {
    /// The style of a seed: slant −6° to 16°, tempo 0.8 to 1.2, and so on, all from plausible ranges.
    #[must_use]
    pub fn from_seed(seed: u64) -> Self {
        let mut dice = Pcg64::seed_from_u64(seed ^ 0x5714_e57a_9e0f_ace5);
        let mut between = |low: f64, high: f64| low + (high - low) * dice.random::<f64>();
        Self {
            seed,
            slant_rad: between(-0.10, 0.28),
            width: between(0.85, 1.15),
            height: between(0.94, 1.06),
            tempo: between(0.8, 1.2),
            sigma: between(0.20, 0.32),
            aim_em: between(0.008, 0.022),
            bend_rad: between(0.03, 0.12),
            timing: between(0.04, 0.10),
            roundness: between(0.0, 0.8),
            tremor_em: between(0.001, 0.003),
        }
    }
}

/// A hand; its random sequence continues from glyph to glyph.
pub(super) struct GlyphWriter<'s> {
    style: &'s Style,
    dice: Pcg64,
}

impl<'s> GlyphWriter<'s> {
    pub(super) fn new(style: &'s Style) -> Self {
        Self { style, dice: Pcg64::seed_from_u64(style.seed) }
    }

    /// Writes one glyph: its components with the hover between them, sampled at `rate_hz`.
    pub(super) fn write(&mut self, targets: &[&[StrokeTarget]], rate_hz: f64) -> Vec<Component> {
        let plan = self.plan(targets);
        let tremor = self.tremor();
        let mut components: Vec<Component> = Vec::new();
        let samples = ((plan.end_s - plan.start_s) * rate_hz).floor().max(1.0) as usize;
        for i in 0..=samples {
            let t_s = plan.start_s + i as f64 / rate_hz;
            let contact = plan.down_s.iter().any(|&(from, to)| (from..=to).contains(&t_s));
            let [x, y] = plan.position(t_s);
            let shake = tremor.map(|wave| wave.iter().map(|w| w.at(t_s)).sum::<f64>());
            let point = [x + shake[0], y + shake[1]];
            match components.last_mut() {
                Some(c) if c.contact == contact => c.points.push(point),
                _ => components.push(Component { contact, points: vec![point], ..Component::default() }),
            }
        }
        // Rounding may leave a sample of hover at either end; a glyph begins and ends on the paper.
        components.retain(|c| c.contact || c.points.len() > 1);
        components
    }

    fn plan(&mut self, targets: &[&[StrokeTarget]]) -> GlyphPlan {
        let mut plan = GlyphPlan::default();
        let mut pen: Option<[f64; 2]> = None;
        for component in targets {
            let aimed: Vec<[f64; 2]> = component.iter().map(|t| self.aim(t)).collect();
            let (Some(&first), Some(&last)) = (aimed.first(), aimed.last()) else { continue };
            let mut down_s = 0.0;
            if let Some(from) = pen {
                let hover = self.hover(from, first);
                down_s = plan.follow(hover, TAIL);
            } else {
                plan.origin = first;
            }
            let mut before: Option<Lognormal> = None;
            let mut lifted_s = down_s;
            for ((from, to), target) in aimed.iter().zip(aimed.iter().skip(1)).zip(component.iter().skip(1)) {
                let mut stroke = self.stroke(*from, *to, f64::from(target.2).to_radians());
                match before {
                    Some(last) => {
                        let z = self.overlap(last.end_rad(), stroke.start_rad);
                        stroke.onset_s = last.time_at(z) - (stroke.time_at(-TAIL) - stroke.onset_s);
                    }
                    None => stroke.onset_s = down_s - (stroke.time_at(-TAIL) - stroke.onset_s),
                }
                lifted_s = stroke.time_at(TAIL);
                plan.strokes.push(stroke);
                before = Some(stroke);
            }
            plan.down_s.push((down_s, lifted_s));
            pen = Some(last);
        }
        plan.start_s = plan.down_s.first().map_or(0.0, |d| d.0);
        plan.end_s = plan.down_s.last().map_or(0.0, |d| d.1);
        plan
    }

    /// The hand's aim for a target: slanted, stretched, with a small error.
    fn aim(&mut self, &(x, y, _): &StrokeTarget) -> [f64; 2] {
        let y_em = f64::from(y) / 100.0 * self.style.height;
        let x_em = f64::from(x) / 100.0 * self.style.width + y_em * self.style.slant_rad.tan();
        [x_em + self.style.aim_em * self.normal(), y_em + self.style.aim_em * self.normal()]
    }

    fn stroke(&mut self, from: [f64; 2], to: [f64; 2], bend_rad: f64) -> Lognormal {
        let bend_rad = bend_rad + self.style.bend_rad * self.normal();
        let sigma = self.style.sigma * (1.0 + 0.5 * self.style.timing * self.normal());
        let mut stroke = Lognormal::between(from, to, bend_rad, 0.0, sigma);
        let pace = (1.0 + self.style.timing * self.normal()).max(0.5) / self.style.tempo;
        let seconds = (STROKE_S * stroke.length.powf(ISOCHRONY)).max(STROKE_MIN_S) * pace;
        stroke.mu = Lognormal::mu_for(seconds, sigma);
        stroke
    }

    fn hover(&mut self, from: [f64; 2], to: [f64; 2]) -> Lognormal {
        let bend_rad = 0.5 * self.normal();
        let mut stroke = Lognormal::between(from, to, bend_rad, 0.0, self.style.sigma);
        let pace = (1.0 + self.style.timing * self.normal()).max(0.5) / self.style.tempo;
        let seconds = ((HOVER_MIN_S + 0.08 * stroke.length.sqrt()) * pace).max(HOVER_MIN_S);
        stroke.mu = Lognormal::mu_for(seconds, self.style.sigma);
        stroke
    }

    /// Progress of a stroke, as z, when the next one sets in: larger for sharper corners.
    fn overlap(&mut self, end_rad: f64, start_rad: f64) -> f64 {
        let turn = (start_rad - end_rad + PI).rem_euclid(TAU) - PI;
        let sharpness = (turn.abs() / 1.3).min(1.0);
        let [smooth, corner] = OVERLAP_Z;
        let corner = corner - 0.7 * self.style.roundness;
        smooth + (corner - smooth) * sharpness + 0.15 * self.normal()
    }

    fn tremor(&mut self) -> [[Wave; 2]; 2] {
        let amplitude = self.style.tremor_em / 2.0;
        let mut wave = || Wave {
            amplitude,
            omega: TAU * (8.0 + 4.0 * self.dice.random::<f64>()),
            phase: TAU * self.dice.random::<f64>(),
        };
        [[wave(), wave()], [wave(), wave()]]
    }

    /// Standard normal, by Box and Muller; clipped at 2.5 so that no outlier spoils a letter.
    fn normal(&mut self) -> f64 {
        let (u, v): (f64, f64) = (self.dice.random(), self.dice.random());
        let z = (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos();
        z.clamp(-2.5, 2.5)
    }
}

#[derive(Debug, Clone, Copy)]
struct Wave {
    amplitude: f64,
    omega: f64,
    phase: f64,
}

impl Wave {
    fn at(&self, t_s: f64) -> f64 {
        self.amplitude * (self.omega * t_s + self.phase).sin()
    }
}

/// All strokes of a glyph on one clock, and when the pen is down.
#[derive(Debug, Default)]
struct GlyphPlan {
    origin: [f64; 2],
    strokes: Vec<Lognormal>,
    down_s: Vec<(f64, f64)>,
    start_s: f64,
    end_s: f64,
}

impl GlyphPlan {
    /// Appends a stroke that sets in when the last one is Φ(z) through; returns when it is itself.
    fn follow(&mut self, mut stroke: Lognormal, z: f64) -> f64 {
        let lifted_s = self.down_s.last().map_or(0.0, |d| d.1);
        stroke.onset_s = lifted_s - (stroke.time_at(-z) - stroke.onset_s);
        self.strokes.push(stroke);
        stroke.time_at(z)
    }

    fn position(&self, t_s: f64) -> [f64; 2] {
        self.strokes.iter().fold(self.origin, |[x, y], stroke| {
            let [dx, dy] = stroke.displacement(t_s);
            [x + dx, y + dy]
        })
    }
}
