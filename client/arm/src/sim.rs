//! The simulated UR5 controller as a process of its own.
//!
//! Contract: cycles at its own rate by absolute sleeps; cycles that the machine missed are made up for, each
//! with the command that was due then, because a real controller would not have missed them.

use std::path::PathBuf;

use foretrace_client::wire::{ArmLine, arm_flags};
use foretrace_client::{Foretrace, JointState, Mode, RobotMode, SafetyMode, host_boot_id, monotonic_now_ns};
use foretrace_config::Config;
use foretrace_control::extent::ExtentWatch;
use foretrace_control::units::Stamp;
use foretrace_failure::Failure;
use foretrace_report::extent::ExtentFigures;
use foretrace_report::failures::unattached;
use foretrace_report::stopped::starved;
use foretrace_sim::arm::{ArmModel, ArmSettings, JOINTS};
use foretraced::rt::os::sleep_until_ns;

use crate::guide::Guide;
use crate::intake::CommandIntake;
use crate::joint_log::JointLog;
use crate::ports::{Daemons, Reads};
use crate::priority::{self, CpuWait};
use crate::refused::{RefusalReporter, RefusedCommands};
use crate::report::{ArmReport, CommandReport, DelaySeen, SimReport};
use foretrace_report::Tell;

/// What a simulated arm is, and how long it runs.
pub struct SimOptions {
    /// Cycles per second of the controller.
    pub rate_hz: u32,
    pub arm: ArmSettings,
    /// Where it stands at first, base first \[rad\].
    pub from: [f64; JOINTS],
    /// A new file for every joint state.
    pub record: Option<PathBuf>,
    pub guide: Option<Guide>,
    pub no_rights: bool,
    pub seconds: Option<f64>,
    /// Computes without a pause from so long after the first command on, as a broken arm's process might
    /// \[s\].
    pub spin_after: Option<f64>,
}

/// An arm that stands ready.
pub struct Simulation {
    options: SimOptions,
    cycle_ns: u64,
    model: ArmModel,
    intake: CommandIntake,
    log: Option<JointLog>,
    /// Where the tool has been since the first command was taken.
    extent: ExtentWatch<JOINTS>,
    priority: u32,
    /// The daemon takes an arm that is silent for longer for gone \[ns\].
    gone_ns: u64,
}

impl Simulation {
    /// # Errors
    ///
    /// The arm stands nowhere, or the file cannot be made.
    pub fn new(config: &Config, options: SimOptions) -> Result<Self, Failure> {
        let settings = config.settings();
        let (cycle_s, limits) = (1.0 / f64::from(options.rate_hz), config.robot().limits);
        let intake = CommandIntake::new(host_boot_id(), limits, cycle_s, options.from)
            .ok_or_else(|| Failure::bad_input("robot.home_rad is not finite", "correct the settings"))?;
        Ok(Self {
            cycle_ns: 1_000_000_000 / u64::from(options.rate_hz),
            model: ArmModel::at_rest(options.arm, options.from),
            intake,
            log: options.record.as_deref().map(JointLog::create).transpose()?,
            extent: ExtentWatch::new(&config.follower_settings()),
            // Below the daemon's loop, whose commands it takes.
            priority: priority::below_the_loop(settings),
            gone_ns: (settings.safety.joint_state_timeout_ms * 1e6) as u64,
            options,
        })
    }

    /// Cycles beside the daemon until it is `interrupted`, or its time is over.
    ///
    /// # Errors
    ///
    /// The daemon has no slot for it, or its file cannot be written.
    pub fn run(
        self,
        foretrace: Foretrace,
        interrupted: &dyn Fn() -> bool,
        tell: Tell<'_>,
    ) -> Result<SimReport, Failure> {
        let daemon = Daemons::attached(foretrace, Reads::CommandsOnly).map_err(unattached)?;
        // Last, so that nothing that reads files has it.
        let missing = priority::ask("arm", self.priority, self.options.no_rights, tell);
        let mut running = RunningArm {
            arm: self,
            daemon,
            tell,
            delay: DelaySeen::default(),
            reporter: RefusalReporter::default(),
            cycles: 0,
            late_cycles: 0,
            cpu: CpuWait::of_this_thread(),
            starved_ns: 0,
        };
        running.run(interrupted);
        if let Some(log) = running.arm.log.take() {
            log.finish()?;
        }
        Ok(running.report(missing))
    }
}

struct RunningArm<'a> {
    arm: Simulation,
    daemon: Daemons,
    tell: Tell<'a>,
    delay: DelaySeen,
    reporter: RefusalReporter,
    cycles: u64,
    late_cycles: u64,
    cpu: CpuWait,
    /// Longest that a cycle came late because others had the CPU \[ns\].
    starved_ns: u64,
}

impl RunningArm<'_> {
    fn run(&mut self, interrupted: &dyn Fn() -> bool) {
        let begin = monotonic_now_ns();
        let SimOptions { seconds, spin_after, .. } = self.arm.options;
        let after = |s: f64| begin.saturating_add((s.max(0.0) * 1e9) as u64);
        let (end, cycle_ns) = (seconds.map_or(u64::MAX, after), self.arm.cycle_ns);
        let (mut due, mut spins) = (begin + cycle_ns, None);
        while due < end && !interrupted() {
            sleep_until_ns(due);
            let now = monotonic_now_ns();
            self.late(now.saturating_sub(due));
            self.receive(Stamp(due));
            self.guided(due);
            // From the first command on.
            if let (None, Some(s), Some(_)) = (spins, spin_after, self.arm.intake.newest()) {
                spins = Some(now + (s * 1e9) as u64);
            }
            if spins.is_some_and(|spins| now >= spins) {
                (self.tell)("arm: computes without a pause from now on");
                while !interrupted() {
                    std::hint::spin_loop();
                }
            }
            let mut made = 0;
            while due <= now {
                self.cycle(due);
                due += cycle_ns;
                made += 1;
            }
            self.late_cycles += u64::saturating_sub(made, 1);
            self.daemon.look(self.tell);
        }
    }

    /// A cycle is late by `ns`: tells what the daemon takes for an arm that is gone, if others had the CPU.
    fn late(&mut self, ns: u64) {
        let starved_ns = self.cpu.lately_ns().unwrap_or(0).min(ns);
        self.starved_ns = self.starved_ns.max(starved_ns);
        if starved_ns + self.arm.cycle_ns >= self.arm.gone_ns {
            (self.tell)(&format!("arm: {}", starved(starved_ns)));
        }
    }

    fn receive(&mut self, due: Stamp) {
        let intake = &mut self.arm.intake;
        if let Some(ports) = self.daemon.ports() {
            ports.commands.drain(|command| {
                // Not at `due`: an echo must not say that a command was taken before it was sent.
                intake.receive(command, Stamp(monotonic_now_ns()), due);
            });
        }
    }

    fn guided(&mut self, due: u64) {
        let Some(guide) = &mut self.arm.options.guide else { return };
        let rest = self.arm.intake.rest(Stamp(due));
        if let Some(q) = guide.look(rest, due, self.tell) {
            self.arm.intake.put(q);
        }
    }

    /// Reports the joints as they are at `due`, then moves through one cycle.
    fn cycle(&mut self, due: u64) {
        self.cycles += 1;
        let refused = self.refused();
        self.reporter.look(&refused, due, self.tell);
        let Simulation { intake, model, extent, log, cycle_ns, .. } = &mut self.arm;
        let joints = model.joints();
        let mut state = JointState {
            robot_stamp_ns: self.cycles * *cycle_ns,
            commands_received: intake.accepted(),
            commands_refused: refused.total(),
            q: joints.q,
            qd: joints.qd,
            safety_mode: SafetyMode::Normal.into(),
            robot_mode: RobotMode::Running.into(),
            line: ArmLine { flags: arm_flags::SIMULATED, ..ArmLine::default() },
            ..JointState::default()
        };
        if let Some((command, taken)) = intake.newest() {
            state.echo(command, taken.0);
            // On its way home the tool may be anywhere.
            if command.mode != u32::from(Mode::Homing) {
                extent.see(&joints.q);
            }
        }
        if let Some(ports) = self.daemon.ports() {
            // Without a daemon there is no receiver; the lookout handles that.
            let _ = ports.states.publish(due, state);
        }
        if let Some(log) = log {
            log.add(due, &joints.q);
        }
        let target = intake.target(Stamp(due));
        model.cycle(target);
        self.delay.add(model.delay_s());
    }

    /// The client library refuses first; those commands never reach the intake.
    fn refused(&self) -> RefusedCommands {
        let (count, newest) =
            self.daemon.commands().map_or((0, None), |c| (c.rejections().total(), c.newest_refused()));
        self.arm.intake.refused().with(count, newest)
    }

    fn report(&self, not_real_time: Option<String>) -> SimReport {
        let Simulation { intake, model, extent, cycle_ns, options, .. } = &self.arm;
        let lag_ms_at = |t_s| Some(1e3 * model.settings().group_delay_at(t_s)).filter(|ms| ms.is_finite());
        SimReport {
            commands: CommandReport::of(
                intake.statistics(),
                intake.accepted(),
                intake.lost(),
                self.refused(),
            ),
            arm: ArmReport {
                rate_hz: f64::from(options.rate_hz),
                cycles: self.cycles,
                late_cycles: self.late_cycles,
                starved_ms: self.starved_ns as f64 * 1e-6,
                not_real_time,
                daemons: self.daemon.count,
                lag_ms: lag_ms_at(0.0),
                lag_at_end_ms: lag_ms_at(self.cycles as f64 * *cycle_ns as f64 * 1e-9),
                delay_ms: self.delay.report(),
            },
            envelope: extent.extent().map(ExtentFigures::from),
        }
    }
}

const _: () = assert!(JOINTS == foretrace_client::JOINTS);
