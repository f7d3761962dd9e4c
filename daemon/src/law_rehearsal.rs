//! The law's own cost on this machine, measured at start-up: can a loop with these settings keep its rate?
//!
//! Contract: the same `Follower` as the loop's, an arm that is where it was commanded, a pen that draws
//! circles, simulated time. Measures processor time of the thread, so that a busy machine does not look like
//! a slow law. Commands nothing.

use std::f64::consts::TAU;

use foretrace_config::Config;
use foretrace_control::follower::{
    Budget, Follower, FollowerError, JointReading, Mode, NoClock, Request, StepInput,
};
use foretrace_control::pen::PenReading;
use foretrace_control::units::Stamp;

use crate::error::DaemonError;
use crate::rt::os;
use crate::wire::JOINTS;

/// Ticks measured at most, and the number after which a slow law is certain.
const TICKS: usize = 400;
const ENOUGH: usize = 20;
/// Limit on processor time once there are enough ticks \[ns\].
const SPEND_NS: u64 = 100_000_000;
/// Ticks in motion that do not count, because caches are cold.
const WARM_UP: usize = 20;
/// Circles of this radius \[m\], so many per second: fast writing.
const RADIUS_M: f64 = 0.02;
const TURNS_HZ: f64 = 1.0;
/// Sampling interval of the pen \[ns\].
const SAMPLE_NS: u64 = 5_000_000;

/// Cost of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LawCost {
    /// Median processor time \[ns\].
    pub p50_ns: u64,
    /// 99th percentile \[ns\].
    pub p99_ns: u64,
    /// The period \[ns\].
    pub period_ns: u64,
    pub ticks: usize,
}

impl LawCost {
    /// In half of the ticks less than half of the period is left for everything else: the loop will be late.
    #[must_use]
    pub const fn is_too_slow(&self) -> bool {
        2 * self.p50_ns > self.period_ns
    }

    /// The problem and its remedy, if the law is too slow.
    #[must_use]
    pub fn complaint(&self, config: &Config) -> Option<String> {
        let settings = config.settings();
        self.is_too_slow().then(|| {
            format!(
                "a tick of these settings costs {} us of processor time (median of {}; p99 {} us), the \
                 period has {} us: the \
                 loop will be late and stop the arm; set mpc.backend and ik.backend to \"exact\", a shorter \
                 mpc.horizon \
                 than {}, or a rate below {} Hz",
                self.p50_ns / 1000,
                self.ticks,
                self.p99_ns / 1000,
                self.period_ns / 1000,
                settings.mpc.horizon,
                settings.control_loop.rate_hz,
            )
        })
    }
}

/// Measures the law of `config` in a separate thread; takes a fraction of a second.
///
/// # Errors
/// The law refuses the settings, or the system a thread.
pub fn rehearse_law(config: &Config) -> Result<LawCost, DaemonError> {
    let system = |source| DaemonError::System { what: "rehearsing the law", source };
    let there = config.clone();
    let thread = std::thread::Builder::new()
        .name("foretrace-rehearsal".to_owned())
        .stack_size(1 << 22)
        .spawn(move || match there.settings().mpc.horizon {
            10 => measure::<10>(&there),
            20 => measure::<20>(&there),
            _ => measure::<30>(&there),
        })
        .map_err(system)?;
    let measured = thread.join().map_err(|_| system(std::io::Error::other("it ended by a fault")))?;
    Ok(measured?)
}

fn measure<const N: usize>(config: &Config) -> Result<LawCost, FollowerError> {
    let settings = config.follower_settings();
    let (period_ns, home) = (settings.period_ns, settings.ik.home);
    let mut follower = Follower::<N, JOINTS>::new(settings)?;
    let budget = Budget { max_iterations: config.settings().mpc.max_iterations, shed: false };
    let mut joints = JointReading { stamp: Stamp(0), q: home, qd: [0.0; JOINTS], motion_allowed: true };
    let begin = Stamp(10_000_000_000);
    let (mut next_sample, mut moving, mut spent) = (begin, 0, 0_u64);
    let mut costs = Vec::with_capacity(TICKS);
    for tick in 0..4 * TICKS as u64 {
        let now = begin.plus_ns(tick * period_ns);
        joints.stamp = now;
        let angle = TAU * TURNS_HZ * now.since(begin) as f64 * 1e-9;
        let sample = PenReading::new(now, [RADIUS_M * angle.cos(), RADIUS_M * angle.sin()], true);
        let arrived = now >= next_sample;
        if arrived {
            next_sample = now.plus_ns(SAMPLE_NS);
        }
        let input = StepInput {
            pen: if arrived { std::slice::from_ref(&sample) } else { &[] },
            joints: Some(&joints),
            request: (tick == 1).then_some(Request::Arm),
            ..StepInput::nothing(now)
        };
        let before = os::thread_cpu_ns();
        let output = follower.step(&input, budget, &mut NoClock);
        let cost = os::thread_cpu_ns().saturating_sub(before);
        if let Some(command) = output.command {
            (joints.q, joints.qd) = (command.q, command.qd);
        }
        moving += usize::from(output.mode == Mode::Following);
        if moving > WARM_UP {
            costs.push(cost);
            spent += cost;
        }
        if costs.len() >= TICKS || spent > SPEND_NS && costs.len() >= ENOUGH {
            break;
        }
    }
    costs.sort_unstable();
    let at = |hundredths: usize| costs.get(costs.len() * hundredths / 100).copied().unwrap_or(0);
    Ok(LawCost { p50_ns: at(50), p99_ns: at(99), period_ns, ticks: costs.len() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::config;

    #[test]
    fn the_law_of_the_preset_is_measured_while_it_follows() {
        let cost = rehearse_law(&config()).unwrap();
        assert!(cost.ticks >= ENOUGH && cost.p50_ns > 0 && cost.p99_ns >= cost.p50_ns, "{cost:?}");
        assert_eq!(cost.period_ns, 2_000_000);
    }

    #[test]
    fn a_law_that_takes_more_than_half_of_the_period_is_complained_of_with_what_to_do() {
        let cost = |p50_ns| LawCost { p50_ns, p99_ns: 9_000_000, period_ns: 2_000_000, ticks: 100 };
        assert_eq!(cost(1_000_000).complaint(&config()), None);
        let text = cost(1_000_001).complaint(&config()).unwrap();
        for part in ["costs 1000 us", "p99 9000 us", "has 2000 us", "mpc.backend", "500 Hz"] {
            assert!(text.contains(part), "{text}");
        }
    }
}
