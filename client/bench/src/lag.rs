//! Times the lag estimator: what it adds to every tick of the recorded loop.
//!
//! Contract: one number per tick, of a joint state and a command taken in. Most ticks only store them; every
//! grid step adds one instant to the sums, and every fifth of these updates the estimate, which is the tail.

use std::hint::black_box;
use std::time::Instant;

use foretrace_control::arm::lag::LagEstimator;
use serde::Serialize;

use crate::workload::{J, Workload};
use crate::{CostQuantiles, cost, elapsed_us};

/// Cost per tick \[µs\].
#[derive(Debug, Clone, Copy, Serialize)]
pub struct LagCost {
    #[serde(flatten)]
    pub per_tick: CostQuantiles,
    /// The median of the ticks that add an instant to the sums, one in five at 500 Hz.
    pub p90: f64,
}

/// Times it on `samples` ticks, over and over the recorded loop.
pub(crate) fn lag<const N: usize>(workload: &Workload<N>, samples: u32) -> LagCost {
    let mut times = Vec::new();
    'laps: loop {
        let mut estimator = LagEstimator::<J>::new();
        for (tick, next) in workload.ticks.iter().zip(workload.ticks.iter().skip(1)) {
            if times.len() >= samples as usize {
                break 'laps;
            }
            // The workload's arm is perfect: its next joint state is this tick's command.
            let (measured, command) = (black_box(tick.joints.q), black_box(next.joints.q));
            let begin = Instant::now();
            estimator.measured(tick.now, &measured);
            estimator.commanded(next.now, &command);
            black_box(estimator.estimate());
            let us = elapsed_us(begin);
            if tick.following {
                times.push(us);
            }
        }
        if times.is_empty() {
            break;
        }
    }
    times.sort_by(f64::total_cmp);
    let p90 = times.get(times.len() * 9 / 10).copied().unwrap_or(f64::NAN);
    LagCost { per_tick: cost(times), p90 }
}
