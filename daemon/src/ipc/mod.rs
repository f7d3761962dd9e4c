//! The ipc thread: telemetry, status, log and requests, kept away from the loop.
//!
//! Contract: drains the loop's ring into telemetry, status and the log; serves requests; cleans up after dead
//! peers. May block and allocate; the loop never waits for it. Everything dropped is counted.

pub mod allocation;
pub mod bearing;
pub mod chain;
pub mod ghost;
pub mod homeward;
pub mod inputs;
pub mod latency;
pub mod narrator;
pub mod record;
pub mod refused;
pub mod requests;
pub mod statistics;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender};
use tracing::{debug, error};

use foretrace_control::extent::ExtentWatch;
use foretrace_control::follower::{Mode, Request};
use foretrace_control::stop::StopReason;
use foretrace_control::units::{Stamp, Trust};
use foretrace_shm::{
    ExternalState, FaultReason, Refused, ServiceError, Status, StopDetail, ToolExtent, WayHome,
};

use crate::alloc_count;
use crate::learner::{LearnerBoard, LearnerEvent};
use crate::ports::shm::IpcPorts;
use crate::rt::facts::TickFacts;
use crate::rt::os;
use crate::rt::tick::IpcRings;
use crate::wire::{self, JOINTS};
use allocation::AllocationJudge;
use bearing::Bearing;
use chain::ChainWatch;
use ghost::GhostShell;
use homeward::Homeward;
use inputs::Inputs;
use latency::Latencies;
use narrator::Narrator;
use record::IpcTally;
use requests::{OpenRequests, RefusalContext, ReloadRequest};
use statistics::{RateMeter, RunningRms, Spreads};

/// Sleep between two rounds; the loop's ring holds a hundred times as much.
const PAUSE: Duration = Duration::from_millis(4);
/// Records taken in one round at most.
const ROUND: usize = 1024;
/// Time between two clean-ups of dead peers \[ns\].
const CLEAN_NS: i64 = 1_000_000_000;

/// A loop silent for this long has a fault \[ns\].
const SILENCE_NS: i64 = 1_000_000_000;

/// Settings of the thread.
#[derive(Debug, Clone, Copy)]
pub struct IpcSettings {
    /// Ticks per second, as set.
    pub rate_hz: f64,
    /// Warm-up ticks, which count neither in distributions nor in allocations.
    pub warm_after_ticks: u64,
    /// Every n-th tick is published.
    pub telemetry_every: u64,
    /// Time between two status messages \[ns\].
    pub status_period_ns: u64,
    /// Identifies this start of the daemon.
    pub daemon_id: u64,
    /// Hash of the settings.
    pub settings_hash: u64,
}

/// Orders of the supervisor to the thread.
#[derive(Debug, Clone, PartialEq)]
pub enum IpcOrder {
    /// These rights are missing, as bits of the status.
    Missing(u32),
    /// A live setting for the loop.
    Loop(Request),
    Settings {
        hash: u64,
        /// All of them, as TOML.
        text: String,
    },
    /// End by a fault, for tests.
    #[cfg(test)]
    Panic,
}

/// What the thread needs besides its ports.
#[derive(Debug)]
pub struct IpcLinks {
    /// Rings to and from the loop.
    pub rings: IpcRings,
    /// What feedback alone would have done.
    pub ghost: GhostShell,
    /// Where the measured tool has been since arming.
    pub extent: ExtentWatch<JOINTS>,
    pub homeward: Homeward,
    /// Where the arm is, and the newest note about it.
    pub bearing: Bearing,
    pub inputs: Inputs,
    pub board: Arc<LearnerBoard>,
    pub learner: Receiver<LearnerEvent>,
    pub orders: Receiver<IpcOrder>,
    /// Reloads, to the supervisor.
    pub reload: Sender<ReloadRequest>,
    /// Set when the thread should end.
    pub quit: Arc<AtomicBool>,
}

/// The result of the thread.
#[derive(Debug, Clone, Copy, Default)]
pub struct IpcSummary {
    pub status: Status,
}

/// Starts the thread; `opened` receives whether its ports could be opened.
///
/// # Errors
/// The system refuses another thread.
pub fn spawn(
    open: impl FnOnce() -> Result<IpcPorts, ServiceError> + Send + 'static,
    settings: IpcSettings,
    links: IpcLinks,
    opened: Sender<Result<(), ServiceError>>,
) -> std::io::Result<JoinHandle<IpcSummary>> {
    std::thread::Builder::new().name("foretrace-ipc".to_owned()).spawn(move || match open() {
        Ok(ports) => {
            // A supervisor that is gone does not need the news.
            let _ = opened.send(Ok(()));
            Ipc::new(ports, settings, links).run()
        }
        Err(error) => {
            let _ = opened.send(Err(error));
            IpcSummary::default()
        }
    })
}

struct Ipc {
    ports: IpcPorts,
    settings: IpcSettings,
    links: IpcLinks,
    requests: OpenRequests,
    narrator: Narrator,
    judge: AllocationJudge,
    spreads: Spreads,
    chain: ChainWatch,
    latencies: Latencies,
    rate: RateMeter,
    rate_hz: f64,
    predictor: RunningRms,
    newest: Option<TickFacts>,
    telemetry_failed: u64,
    settings_revision: u64,
    missing: u32,
    counted: bool,
    started: Stamp,
    next_status: Stamp,
    last_clean: Stamp,
}

impl Ipc {
    fn new(ports: IpcPorts, settings: IpcSettings, links: IpcLinks) -> Self {
        let now = Stamp(os::monotonic_ns());
        Self {
            requests: OpenRequests::new(links.reload.clone()),
            ports,
            settings,
            links,
            narrator: Narrator::default(),
            judge: AllocationJudge::new(settings.warm_after_ticks),
            spreads: Spreads::new(),
            chain: ChainWatch::new(),
            latencies: Latencies::new(),
            rate: RateMeter::default(),
            rate_hz: 0.0,
            // About the last ten seconds at a grid step of 10 ms.
            predictor: RunningRms::new(1000.0),
            newest: None,
            telemetry_failed: 0,
            settings_revision: 0,
            missing: 0,
            counted: alloc_count::is_installed(),
            started: now,
            next_status: now,
            last_clean: now,
        }
    }

    fn run(mut self) -> IpcSummary {
        while !self.links.quit.load(Ordering::Acquire) {
            self.round();
            std::thread::sleep(PAUSE);
        }
        self.round();
        let status = self.status(Stamp(os::monotonic_ns()));
        self.publish(status);
        IpcSummary { status }
    }

    fn round(&mut self) {
        let now = Stamp(os::monotonic_ns());
        while let Ok(order) = self.links.orders.try_recv() {
            self.obey(order);
        }
        let mut changed = false;
        for _ in 0..ROUND {
            let Ok(facts) = self.links.rings.facts.pop() else { break };
            changed |= self.learn_of(&facts);
        }
        self.links.bearing.take_notes(&mut self.ports.notes);
        self.links.inputs.round(now.0, &mut self.links.rings, &mut self.ports.pieces);
        self.judge.look(now, self.ports.watch.fingerprint());
        while let Ok(event) = self.links.learner.try_recv() {
            self.narrator.learner(&event);
        }
        let (mode, trust) = self.mode_and_trust();
        self.requests.explain_by(self.newest.as_ref().map_or_else(RefusalContext::default, |newest| {
            RefusalContext {
                joints_refused: newest.ports.joints_refused,
                note: self.links.bearing.in_force(newest).map(|note| note.words),
                stop: (newest.output.stop_reason != StopReason::None).then(|| {
                    (wire::fault(newest.output.stop_reason), wire::stop_detail(&newest.output.stop_detail))
                }),
            }
        }));
        self.requests.serve(&mut self.ports.control, &mut self.links, mode, trust);
        if changed || now >= self.next_status {
            self.next_status = now.plus_ns(self.settings.status_period_ns);
            let status = self.status(now);
            self.publish(status);
        }
        if now.since(self.last_clean) >= CLEAN_NS {
            self.last_clean = now;
            let cleaned = self.ports.clean_up_dead_peers();
            if cleaned > 0 {
                debug!("cleaned up after {cleaned} dead peers");
            }
        }
    }

    fn obey(&mut self, order: IpcOrder) {
        match order {
            IpcOrder::Missing(mask) => self.missing |= mask,
            IpcOrder::Loop(request) => self.requests.change_setting(request, &mut self.links.rings),
            IpcOrder::Settings { hash, text } => {
                self.settings_revision += 1;
                self.links.inputs.settings(text);
                self.settings.settings_hash = hash;
            }
            #[cfg(test)]
            IpcOrder::Panic => panic!("as the test wants it"),
        }
    }

    /// Takes in one tick; returns whether it changed the mode.
    fn learn_of(&mut self, facts: &TickFacts) -> bool {
        self.judge.tick(facts);
        self.rate_hz = self.rate.measure(facts);
        if facts.tick > self.settings.warm_after_ticks {
            self.spreads.add(&facts.times);
            self.latencies.tick(facts);
        }
        if let Some(error) = facts.output.predictor_error {
            self.predictor.add(error);
        }
        let parts = self.chain.tick(facts);
        if facts.output.begins {
            self.links.extent.restart();
        }
        // On its way home the tool may be anywhere.
        let led = facts.output.command.filter(|_| facts.output.mode != Mode::Homing);
        if let (Some(_), Some((_, q))) = (led, &facts.measured) {
            self.links.extent.see(q);
        }
        self.links.inputs.tick(facts, &mut self.links.rings, &mut self.ports.inputs);
        let ghost = self.links.ghost.follow(facts, self.links.rings.facts.slots());
        if facts.tick.is_multiple_of(self.settings.telemetry_every.max(1)) {
            let record = record::tick_record((self.newest.as_ref(), facts), &parts, &ghost, &self.tally());
            if self.ports.telemetry.publish(facts.finished.0, record).is_err() {
                self.telemetry_failed += 1;
            }
        }
        self.newest = Some(*facts);
        self.narrator.tick(facts)
    }

    fn mode_and_trust(&self) -> (Mode, Trust) {
        self.newest
            .map_or((Mode::Idle, Trust::NONE), |newest| (newest.output.mode, newest.output.trust.alpha))
    }

    fn tally(&self) -> IpcTally {
        let judged = self.judge.totals();
        let learner = self.links.board.view();
        let (requests, requests_refused) = self.requests.counts();
        IpcTally {
            telemetry_failed: self.telemetry_failed + self.links.inputs.failed(),
            requests: requests + self.ports.control.rejections().total(),
            requests_refused: requests_refused + self.ports.control.rejections().total(),
            allocations: judged.unexplained,
            connection_allocations: judged.connection,
            connection_ticks: judged.connection_ticks,
            weights_overtaken: learner.overtaken,
            learner_events_lost: learner.events_lost,
        }
    }

    fn status(&self, now: Stamp) -> Status {
        let learner = self.links.board.view();
        let mut status = Status {
            daemon_id: self.settings.daemon_id,
            pid: std::process::id(),
            missing_rights: self.missing,
            rate_hz: self.settings.rate_hz,
            measured_rate_hz: self.rate_hz,
            uptime_ns: now.0.saturating_sub(self.started.0),
            settings_revision: self.settings_revision,
            settings_hash: self.settings.settings_hash,
            stages: self.spreads.percentiles(),
            pen_age_ns: u64::MAX,
            joint_state_age_ns: u64::MAX,
            chain: record::chain(&self.chain.recent()),
            pen_to_command: self.latencies.pen_to_command(),
            command_to_motion: self.latencies.command_to_motion(),
            external: ExternalState { latency: self.latencies.preview(), ..ExternalState::NONE },
            learner_updates: learner.updates,
            learner_promotions: learner.promotions,
            learner_rollbacks: learner.rollbacks,
            learner_refused: learner.refused,
            predictor_rms_m: self.predictor.value(),
            predictor_band_m: -1.0,
            stop: StopDetail::NONE,
            pen_refused: Refused::NONE,
            joints_refused: Refused::NONE,
            enable_refused: Refused::NONE,
            echo_refused: wire::refused(self.chain.refused()),
            extent: self.links.extent.extent().map_or(ToolExtent::UNKNOWN, |extent| wire::extent(&extent)),
            arm_speed_share: -1.0,
            way_home: self.newest.map_or(WayHome::UNKNOWN, |newest| self.links.homeward.way_home(&newest)),
            // NaN without a counting allocator: zero would be a claim.
            allocations_per_tick: f64::NAN,
            ..Status::default()
        };
        wire::ghost_figures(&mut status, &self.links.ghost.figures(), self.links.ghost.cost_ns());
        if let Some(newest) = &self.newest {
            let tally = self.tally();
            record::newest_tick(&mut status, newest, &tally, now);
            self.links.bearing.fill(&mut status, newest);
            let warm = newest.tally.ticks.saturating_sub(self.settings.warm_after_ticks);
            if self.counted {
                status.allocations_per_tick = tally.allocations as f64 / warm.max(1) as f64;
            }
        }
        if (learner.failed || self.loop_is_silent(now)) && status.fault == u32::from(FaultReason::None) {
            status.fault = FaultReason::Internal.into();
        }
        status
    }

    /// Whether no tick has come from the loop for a second: its thread is held up, or has ended.
    fn loop_is_silent(&self, now: Stamp) -> bool {
        self.newest.is_some_and(|newest| now.since(newest.finished) > SILENCE_NS)
    }

    fn publish(&mut self, status: Status) {
        if let Err(error) = self.ports.status.publish(os::monotonic_ns(), status) {
            error!("status not published: {error}");
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
