//! `foretrace arm sim`: a simulated UR5 controller as a process of its own.
//!
//! Contract: cycles at its own rate by absolute sleeps; cycles that the machine missed are made up for, each
//! with the command that was due then, because a real controller would not have missed them. Outlives the
//! daemon: without commands it brakes and stays, and follows again when a daemon comes back.

use std::path::PathBuf;
use std::time::Duration;

use foretrace_client::{
    ArmLine, JointState, Mode, RobotMode, SafetyMode, arm_flags, host_boot_id, monotonic_now_ns,
};
use foretrace_control::arm::JointLimits;
use foretrace_control::extent::ExtentWatch;
use foretrace_control::units::Stamp;
use foretrace_sim::arm::{ArmModel, JOINTS};

use super::guide::Guide;
use super::intake::Intake;
use super::options::LagArgs;
use super::ports::{Daemons, Reads};
use super::record::Record;
use super::refused::{Refused, Teller};
use super::report::{ArmReport, CommandReport, DelaySeen, SimReport, summary};
use crate::attach::{attach_within, instance_of};
use crate::extent::ExtentFigures;
use crate::failure::{Cause, Failure};
use crate::interrupt::Interrupt;
use crate::os;
use crate::output::{JsonArgs, note};
use crate::punctual::{self, CpuWait};
use crate::settings::SettingsArgs;
use crate::stopped::starved;

/// Simulate a UR5 behind its controller: receive joint commands, move like the arm, report joint states
///
/// The controller takes one command per cycle, adds the pure delay asked for and one cycle, a critically
/// damped servo with the look-ahead as its group delay (servoj), a joint loop of 2 ms, and clamps at 3.34
/// rad/s and 40 rad/s². Its joints are ideal unless told otherwise. It brakes by itself when no commands
/// come. Every command received is checked against the settings' limits; the result is printed at the end.
#[derive(Debug, clap::Args)]
#[command(
    allow_negative_numbers = true,
    after_help = "Examples:\n  foretrace arm sim --lag-ms 66                  in all 100 ms late\n  \
                  foretrace arm sim --look-ahead-ms 0 --lag-ms 30  a pure delay\n  foretrace arm sim \
                  --lag-ms 20 --jitter-ms 5 --lag-change 20:60\n  foretrace arm sim --damping 0.52 \
                  --stiction-mrad 1:2,2:2 --gain 5:0.5"
)]
pub(crate) struct SimArgs {
    /// Cycles per second of the controller [default: robot.controller_rate_hz of the settings]
    #[arg(long, value_name = "HZ", value_parser = clap::value_parser!(u32).range(50..=2000))]
    rate: Option<u32>,

    #[command(flatten)]
    lag: LagArgs,

    /// End after this many seconds; otherwise on Ctrl-C
    #[arg(long, value_name = "S", value_parser = crate::values::lasting)]
    seconds: Option<f64>,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    /// Start at these joint positions, base first [rad], for example --from=0.5,-1.9,-1.7,-1.1,1.6,0
    /// [default: home]
    #[arg(long, value_name = "Q1,...,Q6", value_delimiter = ',', num_args = 1..)]
    from: Option<Vec<f64>>,

    /// Write every joint state as CSV: t_s (monotonic clock), q1..q6 [rad]
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,

    /// Move the arm by hand while it is not armed, with the keys of the terminal: to rehearse `foretrace
    /// calibrate plane` and `foretrace move home`
    #[arg(long)]
    guide: bool,

    /// Ask for no real-time priority
    #[arg(long)]
    no_rights: bool,

    /// Compute without a pause from so long after the first command on, as a broken arm's process might
    #[arg(long, value_name = "S", hide = true, value_parser = crate::values::lasting)]
    spin_after: Option<f64>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(crate) fn run(args: &SimArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let interrupt = Interrupt::listen()?;
    let config = args.settings.load()?;
    let (robot, settings) = (config.robot(), config.settings());
    let rate_hz = args.rate.unwrap_or(settings.robot.controller_rate_hz);
    let cycle_s = 1.0 / f64::from(rate_hz);
    let from = args.from.as_deref().map_or(Ok(robot.home), |from| standing(from, &robot.limits))?;
    let intake = Intake::new(host_boot_id(), robot.limits, cycle_s, from)
        .ok_or_else(|| Failure::bad_input("robot.home_rad is not finite", "correct the settings"))?;
    let arm = args.lag.settings(cycle_s);
    let model = ArmModel::at_rest(arm, from);
    let record = args.record.as_deref().map(Record::create).transpose()?;
    let guide = args.guide.then(|| Guide::open(&robot.chain, &robot.limits)).transpose()?;
    let instance = instance_of(settings)?;
    let foretrace = attach_within(&instance, Duration::from_secs_f64(args.wait))?;
    let daemon = Daemons::attached(foretrace, Reads::CommandsOnly)?;
    note!(
        "arm: {rate_hz} Hz, look-ahead {} ms, in all {:.1} ms late, instance {}",
        args.lag.look_ahead_ms,
        arm.group_delay_s() * 1e3,
        instance.number()
    );

    let mut sim = Simulation {
        cycle_ns: 1_000_000_000 / u64::from(rate_hz),
        model,
        intake,
        guide,
        daemon,
        record,
        delay: DelaySeen::default(),
        extent: ExtentWatch::new(&config.follower_settings()),
        teller: Teller::default(),
        cycles: 0,
        late_cycles: 0,
        cpu: CpuWait::of_this_thread(),
        starved_ns: 0,
        gone_ns: (settings.safety.joint_state_timeout_ms * 1e6) as u64,
    };
    // Last, so that nothing that reads files has it; below the daemon's loop, whose commands it takes.
    let missing = punctual::ask("arm", punctual::below_the_loop(settings), args.no_rights);
    sim.run(args.seconds, args.spin_after, &interrupt);
    if let Some(record) = sim.record.take() {
        record.finish()?;
    }
    let report = sim.report(f64::from(rate_hz), missing);
    summary(&report);
    args.json.write(&report)
}

/// Parses the joint positions of `--from` [rad].
fn standing(from: &[f64], limits: &JointLimits<JOINTS>) -> Result<[f64; JOINTS], Failure> {
    let wrong =
        |why: String| Failure::new(Cause::Usage, why, "give --from=Q1,...,Q6, base first, in radians");
    let q: [f64; JOINTS] = from
        .try_into()
        .map_err(|_| wrong(format!("--from has {} numbers, the arm {JOINTS} joints", from.len())))?;
    for (joint, (q, [low, high])) in q.iter().zip(limits.position()).enumerate() {
        if !(*q >= *low && *q <= *high) {
            return Err(wrong(format!("--from puts joint {joint} at {q} rad, legal {low:.3} to {high:.3}")));
        }
    }
    Ok(q)
}

struct Simulation {
    cycle_ns: u64,
    model: ArmModel,
    intake: Intake,
    guide: Option<Guide>,
    daemon: Daemons,
    record: Option<Record>,
    delay: DelaySeen,
    /// Where the tool has been since the first command was taken.
    extent: ExtentWatch<JOINTS>,
    teller: Teller,
    cycles: u64,
    late_cycles: u64,
    cpu: CpuWait,
    /// Longest that a cycle came late because others had the CPU, and that after which the daemon takes the
    /// arm for gone \[ns\].
    starved_ns: u64,
    gone_ns: u64,
}

impl Simulation {
    fn run(&mut self, seconds: Option<f64>, spin_after: Option<f64>, interrupt: &Interrupt) {
        let begin = monotonic_now_ns();
        let after = |s: f64| begin.saturating_add((s.max(0.0) * 1e9) as u64);
        let end = seconds.map_or(u64::MAX, after);
        let (mut due, mut spins) = (begin + self.cycle_ns, None);
        while due < end && !interrupt.is_set() {
            os::sleep_until(due);
            let now = monotonic_now_ns();
            self.late(now.saturating_sub(due));
            self.receive(Stamp(due));
            self.guided(due);
            // From the first command on.
            if let (None, Some(s), Some(_)) = (spins, spin_after, self.intake.newest()) {
                spins = Some(now + (s * 1e9) as u64);
            }
            if spins.is_some_and(|spins| now >= spins) {
                note!("arm: computes without a pause from now on");
                while !interrupt.is_set() {
                    std::hint::spin_loop();
                }
            }
            let mut made = 0;
            while due <= now {
                self.cycle(due);
                due += self.cycle_ns;
                made += 1;
            }
            self.late_cycles += u64::saturating_sub(made, 1);
            self.daemon.look();
        }
    }

    /// A cycle is late by `ns`: tells what the daemon takes for an arm that is gone, if others had the CPU.
    fn late(&mut self, ns: u64) {
        let starved_ns = self.cpu.lately_ns().unwrap_or(0).min(ns);
        self.starved_ns = self.starved_ns.max(starved_ns);
        if starved_ns + self.cycle_ns >= self.gone_ns {
            note!("arm: {}", starved(starved_ns));
        }
    }

    fn receive(&mut self, due: Stamp) {
        let intake = &mut self.intake;
        if let Some(ports) = &mut self.daemon.ports {
            ports.commands.drain(|command| {
                // Not at `due`: an echo must not say that a command was taken before it was sent.
                intake.receive(command, Stamp(monotonic_now_ns()), due);
            });
        }
    }

    fn guided(&mut self, due: u64) {
        let Some(guide) = &mut self.guide else { return };
        let rest = self.intake.rest(Stamp(due));
        if let Some(q) = guide.look(rest, due) {
            self.intake.put(q);
        }
    }

    /// Reports the joints as they are at `due`, then moves through one cycle.
    fn cycle(&mut self, due: u64) {
        let joints = self.model.joints();
        self.cycles += 1;
        let refused = self.refused();
        self.teller.look(&refused, due);
        let mut state = JointState {
            robot_stamp_ns: self.cycles * self.cycle_ns,
            commands_received: self.intake.accepted(),
            commands_refused: refused.total(),
            q: joints.q,
            qd: joints.qd,
            safety_mode: SafetyMode::Normal.into(),
            robot_mode: RobotMode::Running.into(),
            line: ArmLine { flags: arm_flags::SIMULATED, ..ArmLine::default() },
            ..JointState::default()
        };
        if let Some((command, taken)) = self.intake.newest() {
            state.echo(command, taken.0);
            // On its way home the tool may be anywhere.
            if command.mode != u32::from(Mode::Homing) {
                self.extent.see(&joints.q);
            }
        }
        if let Some(ports) = &mut self.daemon.ports {
            // Without a daemon there is no receiver; the lookout handles that.
            let _ = ports.states.publish(due, state);
        }
        if let Some(record) = &mut self.record {
            record.add(due, &joints.q);
        }
        let target = self.intake.target(Stamp(due));
        self.model.cycle(target);
        self.delay.add(self.model.delay_s());
    }

    /// The client library refuses first; those commands never reach the intake.
    fn refused(&self) -> Refused {
        let commands = self.daemon.ports.as_ref().map(|ports| &ports.commands);
        let (count, newest) = commands.map_or((0, None), |c| (c.rejections().total(), c.newest_refused()));
        self.intake.refused().with(count, newest)
    }

    fn report(&self, rate_hz: f64, not_real_time: Option<String>) -> SimReport {
        let lag_ms_at =
            |t_s| Some(1e3 * self.model.settings().group_delay_at(t_s)).filter(|ms| ms.is_finite());
        SimReport {
            commands: CommandReport::of(
                self.intake.statistics(),
                self.intake.accepted(),
                self.intake.lost(),
                self.refused(),
            ),
            arm: ArmReport {
                rate_hz,
                cycles: self.cycles,
                late_cycles: self.late_cycles,
                starved_ms: self.starved_ns as f64 * 1e-6,
                not_real_time,
                daemons: self.daemon.count,
                lag_ms: lag_ms_at(0.0),
                lag_at_end_ms: lag_ms_at(self.cycles as f64 * self.cycle_ns as f64 * 1e-9),
                delay_ms: self.delay.report(),
            },
            envelope: self.extent.extent().map(ExtentFigures::from),
        }
    }
}

const _: () = assert!(JOINTS == foretrace_client::JOINTS);
