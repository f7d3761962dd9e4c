//! Times the trust evidence: what scoring, correcting and shortening the preview add to a tick of the
//! recorded loop.
//!
//! Contract: the same calls as in a tick of the follower, with a preview of constant velocity. Every tick
//! takes its newest sample in and works out gain and share of every lead; where a grid step closed, pending
//! previews are also scored and a new one is stored. Absent: reading the pen and predicting, which have lines
//! of their own.

use std::hint::black_box;
use std::time::Instant;

use foretrace_config::Config;
use foretrace_control::estimate::LEADS;
use foretrace_control::estimate::record::{NewPreview, PreviewRecord};
use foretrace_control::estimate::refine::{Refinement, Refiner};
use foretrace_control::follower::MAX_STEPS_PER_TICK;
use foretrace_control::pen::{GridStep, PenTracker};
use foretrace_control::predict::LearnStep;
use foretrace_control::units::Stamp;
use serde::Serialize;

use crate::workload::Workload;
use crate::{CostQuantiles, cost, elapsed_us};
use foretrace_failure::Failure;

/// Cost per tick \[µs\].
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EvidenceCost {
    /// Ticks that close no grid step.
    pub between: CostQuantiles,
    /// Ticks that close one.
    pub closing: CostQuantiles,
}

/// Metres per normalised unit: typical of writing, and fixed, because only the cost is measured.
const UNIT_M: f64 = 1e-4;

/// Times it on `samples` ticks that close a grid step, and on those between.
pub(crate) fn evidence<const N: usize>(
    config: &Config,
    workload: &Workload<N>,
    samples: u32,
) -> Result<EvidenceCost, Failure> {
    let settings = config.follower_settings();
    let (mut between, mut closing) = (Vec::new(), Vec::new());
    while closing.len() < samples as usize {
        let before = closing.len();
        let mut tracker = PenTracker::new(settings.pen).map_err(|error| Failure::bad_input(error, ""))?;
        let step_s = settings.pen.step_ns as f64 * 1e-9;
        let (mut record, mut refiner) = (PreviewRecord::new(step_s, true), Refiner::new(step_s));
        // What the last tick left to learn from.
        let (mut made, mut look): (Option<GridStep>, Option<Refinement>) = (None, None);
        let mut path = [[0.0; 2]; LEADS];
        let mut newest_step: Option<GridStep> = None;
        for tick in &workload.ticks {
            tick.ingest(&mut tracker, &settings.plane);
            let mut steps = [LearnStep::default(); MAX_STEPS_PER_TICK];
            let (mut count, mut closed) = (0, None);
            while let Some(step) = tracker.next_step() {
                if let Some(slot) = steps.get_mut(count) {
                    let (motion, position) = (step.motion, step.position);
                    *slot = LearnStep { motion, position, scale_m: UNIT_M, ..LearnStep::default() };
                    count += 1;
                }
                closed = Some(step);
            }
            let begin = Instant::now();
            if let Some(step) = made {
                record.record_preview(&NewPreview { base: step.position, path: black_box(&path) });
            }
            if let Some(refinement) = &look {
                record.record_refinement(&refiner, refinement);
            }
            let closed_steps = black_box(steps.get(..count).unwrap_or_default());
            record.judge(&mut refiner, closed_steps);
            let mut us = elapsed_us(begin);
            (made, look) = (closed, None);
            if let Some(step) = closed {
                let ([x, y], [dx, dy]) = (step.position, step.displacement);
                for (lead, point) in (1..).zip(&mut path) {
                    *point = [x + f64::from(lead) * dx, y + f64::from(lead) * dy];
                }
                newest_step = closed;
            }
            let (Some(step), Some(pen)) = (newest_step, tracker.newest()) else { continue };
            let base = Stamp(step.index * settings.pen.step_ns);
            let phase = pen.stamp.since(base) as f64 / settings.pen.step_ns as f64;
            let begin = Instant::now();
            let [x0, y0] = step.position;
            let [x1, y1] = path.first().copied().unwrap_or_default();
            let expected = [x0 + phase * (x1 - x0), y0 + phase * (y1 - y0)];
            refiner.observe(pen.stamp, black_box(pen.position));
            let said = refiner.refinement(pen.position, phase, expected);
            let shares = record.report(1, 1, 1.0).believed();
            let mut used = path;
            for (((lead, predicted), used), share) in (1..).zip(&path).zip(&mut used).zip(shares) {
                *used = refiner.refined(&said, lead, *predicted, share);
            }
            black_box(used);
            look = Some(said);
            us += elapsed_us(begin);
            if tick.following {
                if closed.is_some() { closing.push(us) } else { between.push(us) }
            }
        }
        if closing.len() == before {
            break;
        }
    }
    Ok(EvidenceCost { between: cost(between), closing: cost(closing) })
}
