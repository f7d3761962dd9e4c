//! A loop of your own at 500 Hz with the guard alone: it proposes any joint positions and sends what the
//! guard passes.
//!
//! `cargo run -p foretrace-control --example guard_alone`
//!
//! No daemon, no pen, no plan. The proposals are bad on purpose: jumps beyond the position limits, non-finite
//! numbers, and 60 ms of silence in the middle of a wave. `send` stands for your driver: it prints what a
//! consumer would receive and has an independent judge check it. Three rules make it safe: send nothing but
//! `verdict.command`; after lost time continue from where the arm is (`consumer_state`); end with
//! `StopProfile`.

use std::error::Error;
use std::time::{Duration, Instant};

use foretrace_control::arm::JointLimits;
use foretrace_control::guard::{CommandChecker, Commanded, Guard, Reasons, StopProfile, consumer_state};
use foretrace_control::units::Stamp;

const JOINTS: usize = 2;
const PERIOD_NS: u64 = 2_000_000;
/// The consumer extrapolates a command for this long after its stamp, then brakes independently.
const VALID_NS: u64 = 5 * PERIOD_NS;
const MOVING_TICKS: u64 = 1500;
const STALLED_TICK: u64 = 700;

fn main() -> Result<(), Box<dyn Error>> {
    let limits = JointLimits::new([[-3.1, 3.1], [-1.0, 0.5]], [3.0, 1.5], [40.0, 20.0])?
        .with_jerk([4000.0, 2000.0])?
        .with_stale_braking(VALID_NS as f64 * 1e-9, [20.0, 10.0])?;
    let (guard, stop) = (Guard::new(limits), StopProfile::new(limits));
    let mut driver = Driver { judge: CommandChecker::new(limits), altered: 0, why: [0; 5] };

    let clock = Instant::now();
    let now = || Stamp(clock.elapsed().as_nanos() as u64);
    // Where the arm was measured, at rest.
    let mut last = Commanded::at_rest(now(), [0.2, -0.3]).ok_or("the arm's joints are not finite")?;
    for tick in 0.. {
        // The command for the instant after the next is computed when the last one begins to hold.
        std::thread::sleep(Duration::from_nanos(last.stamp().since(now()).max(0).cast_unsigned()));
        if tick == STALLED_TICK {
            std::thread::sleep(Duration::from_millis(60));
        }
        if now() >= last.stamp() + PERIOD_NS {
            // Time was lost: the consumer has extrapolated, then braked. Continue from there.
            let at = now();
            let arm = consumer_state(&last, last.stamp() + VALID_NS, limits.deceleration(), at);
            last = Commanded::new(at, arm).ok_or("the arm's joints are not finite")?;
        }
        let stamp = last.stamp() + PERIOD_NS;
        let q = if tick < MOVING_TICKS {
            proposal(tick, last.q())
        } else {
            let qd = stop.next(&last, stamp);
            let h = stamp.seconds_since(last.stamp());
            std::array::from_fn(|i| last.q()[i] + qd[i] * h)
        };
        let verdict = guard.clamp(&last, &q, stamp);
        driver.send(&verdict.command, verdict.reasons);
        last = verdict.command;
        if tick > MOVING_TICKS && StopProfile::is_done(&last) {
            println!(
                "at rest {} ticks after the last proposal, at {:.4?} rad",
                tick - MOVING_TICKS,
                last.q()
            );
            break;
        }
    }
    driver.report()
}

/// The loop's next goal \[rad\]. The guard is no planner: far goals are approached as fast as the limits
/// allow, and overshot.
fn proposal(tick: u64, q: &[f64; JOINTS]) -> [f64; JOINTS] {
    let t = tick as f64 * PERIOD_NS as f64 * 1e-9;
    let wave = [1.2 * (2.0 * t).sin(), -0.2 + 0.3 * (3.0 * t).cos()];
    match tick % 500 {
        100..110 => [f64::NAN, f64::INFINITY],
        250..300 => [100.0, -100.0],
        _ => std::array::from_fn(|i| q[i] + 0.02 * (wave[i] - q[i])),
    }
}

/// Stands for the connection to the arm.
struct Driver {
    judge: CommandChecker<JOINTS>,
    altered: u64,
    why: [u64; 5],
}

impl Driver {
    const WHY: [(Reasons, &'static str); 5] = [
        (Reasons::NOT_FINITE, "no number"),
        (Reasons::POSITION, "position"),
        (Reasons::VELOCITY, "velocity"),
        (Reasons::ACCELERATION, "acceleration"),
        (Reasons::JERK, "jerk"),
    ];

    fn send(&mut self, command: &Commanded<JOINTS>, reasons: Reasons) {
        // Your driver here: positions, velocities, the stamp at which they hold, and until when they may be
        // extrapolated.
        self.judge.observe(command.stamp(), command.stamp() + VALID_NS, command.q(), command.qd());
        self.altered += u64::from(!reasons.is_empty());
        for (count, (reason, _)) in self.why.iter_mut().zip(Self::WHY) {
            *count += u64::from(reasons.contains(reason));
        }
    }

    fn report(&self) -> Result<(), Box<dyn Error>> {
        let seen = self.judge.statistics();
        println!("{} commands, {} of them not as proposed:", seen.count, self.altered);
        for (count, (_, name)) in self.why.iter().zip(Self::WHY) {
            println!("  {name:<12} {count}");
        }
        println!(
            "largest velocity {:.3} rad/s, acceleration {:.2} rad/s²",
            seen.max_velocity_radps, seen.max_acceleration_radps2
        );
        match seen.limit_violations {
            0 => Ok(()),
            broken => Err(format!("{broken} commands broke a limit: {:?}", seen.violations).into()),
        }
    }
}
