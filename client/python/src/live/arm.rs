//! `ArmHandle`: an arm whose program is in Python. Measurements in, targets out; the loop between is ours.

use std::sync::mpsc::{self, SyncSender, TrySendError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use foretrace_client::wire::{HeaderBounds, RejectReason, Rejection, Validate, arm_flags};
use foretrace_client::{Foretrace, Instance, JOINTS, JointState, Lasting, monotonic_now_ns};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arm_loop::{ArmDesk, ArmLoop, ArmNews, ArmPace, ArmTarget, SharedDesk, open_ports};
use super::failure::{FailureKind, LiveFailure};
use super::pen::{PATIENCE, other_clock};
use super::worker::{Closing, locked, remember, same_process};

/// Measurements that wait for the loop at most.
const QUEUE: usize = 64;
/// A measurement that is older is of another clock \[ns\].
const OLDEST_NS: u64 = 1_000_000_000;

/// Joints as Python gives them.
type GivenJoints = [f64; JOINTS];
/// State, whether to move, q \[rad\], qd \[rad/s\], instant \[ns\], tick, mode and flags of the command.
type TargetParts = (&'static str, bool, Option<GivenJoints>, Option<GivenJoints>, u64, u64, u32, u32);

struct ArmEnd {
    news: Mutex<Option<SyncSender<ArmNews>>>,
    desk: SharedDesk,
    pid: u32,
}

impl Closing for ArmEnd {
    fn close(&self) {
        if locked(&self.news).take().is_some() && self.pid == std::process::id() {
            let (desk, turn) = &*self.desk;
            let over = turn.wait_timeout_while(locked(desk), Duration::from_secs(2), |desk| !desk.over);
            drop(over.unwrap_or_else(PoisonError::into_inner));
        }
    }
}

/// An arm's loop, from any Python thread.
#[pyclass(frozen, module = "foretrace._native")]
pub struct ArmHandle {
    end: Arc<ArmEnd>,
    /// Stamp of the newest measurement \[ns\].
    measured_ns: Mutex<u64>,
    simulated: bool,
    rate_hz: f64,
}

impl ArmHandle {
    pub fn open(
        py: Python<'_>,
        instance: Instance,
        rate_hz: f64,
        deceleration: GivenJoints,
        pause_after_s: f64,
        simulated: bool,
    ) -> PyResult<Self> {
        let bounded = |name: &str, value: f64, from: f64, to: f64, unit: &str| {
            if (from..=to).contains(&value) {
                return Ok(());
            }
            Err(LiveFailure::invalid(format!("{name} = {value} {unit}: from {from} to {to}")))
        };
        bounded("rate_hz", rate_hz, 1.0, 8000.0, "Hz")?;
        for (joint, deceleration) in (1..).zip(deceleration) {
            bounded(&format!("deceleration of joint {joint}"), deceleration, 0.1, 500.0, "rad/s²")?;
        }
        bounded("pause_after", pause_after_s, 0.01, 10.0, "s")?;
        // A target is one cycle old when the next one comes: less would be a pause without one.
        bounded("pause_after", pause_after_s, 2.0 / rate_hz, 10.0, "s, two cycles at least")?;
        let pace = ArmPace {
            period: Duration::from_secs_f64(1.0 / rate_hz),
            deceleration,
            pause_ns: (pause_after_s * 1e9) as u64,
        };
        let desk = SharedDesk::default();
        let (news, heard) = mpsc::sync_channel(QUEUE);
        let (opened, opening) = mpsc::sync_channel::<Result<(), LiveFailure>>(1);
        let shared = desk.clone();
        let run = move || {
            // Also where the loop panics: nobody waits for a loop that is over.
            let _over = LoopOver(shared.clone());
            let ports = Foretrace::attach_within(&instance, Duration::ZERO)
                .and_then(|foretrace| open_ports(&foretrace).map(|ports| Lasting::new(foretrace, ports)));
            match ports {
                Err(error) => {
                    // The caller may have given up.
                    let _ = opened.send(Err(error.into()));
                }
                Ok(ports) => {
                    if opened.send(Ok(())).is_ok() {
                        ArmLoop::new(ports, pace, shared).run(&heard);
                    }
                }
            }
        };
        std::thread::Builder::new().name("foretrace-arm".to_owned()).spawn(run).map_err(|error| {
            LiveFailure::new(
                FailureKind::Other,
                format!("the arm: starting a thread: {error}: free some memory"),
            )
        })?;
        super::worker::receive(py, opening, PATIENCE, "the arm")??;
        let end = Arc::new(ArmEnd { news: Mutex::new(Some(news)), desk, pid: std::process::id() });
        let closing: Arc<dyn Closing> = end.clone();
        remember(Arc::downgrade(&closing));
        Ok(Self { end, measured_ns: Mutex::new(0), simulated, rate_hz })
    }

    fn tell(&self, news: ArmNews) -> Result<(), LiveFailure> {
        same_process(self.end.pid, "the arm")?;
        let over =
            || LiveFailure::new(FailureKind::Other, "the arm's loop is over: open the interface again");
        match locked(&self.end.news).as_ref().ok_or_else(over)?.try_send(news) {
            Ok(()) => Ok(()),
            Err(TrySendError::Disconnected(_)) => Err(over()),
            Err(TrySendError::Full(_)) => {
                let text = format!(
                    "{QUEUE} measurements wait for the arm's loop, which hangs: stop the arm by itself"
                );
                Err(LiveFailure::new(FailureKind::Other, text))
            }
        }
    }

    /// Whether it is the stamp of a new measurement, after that of `newest_ns`.
    fn check_stamp(stamp_ns: u64, newest_ns: u64) -> Result<bool, LiveFailure> {
        let now_ns = monotonic_now_ns();
        let ahead_ns = stamp_ns.saturating_sub(now_ns);
        let bound_ns = HeaderBounds::DEFAULT.future_ns;
        if ahead_ns > bound_ns {
            let [ahead_s, bound_s] = [ahead_ns, bound_ns].map(|ns| ns as f64 * 1e-9);
            return Err(Rejection::new(RejectReason::FromTheFuture, "stamp_ns")
                .because(ahead_s, bound_s)
                .into());
        }
        if now_ns.saturating_sub(stamp_ns) > OLDEST_NS {
            return Err(other_clock(stamp_ns, now_ns));
        }
        if stamp_ns < newest_ns {
            let text = format!(
                "stamp = {stamp_ns} ns is {:.6} s before the measurement before it: stamps must grow",
                (newest_ns - stamp_ns) as f64 * 1e-9
            );
            return Err(LiveFailure::invalid(text));
        }
        Ok(stamp_ns > newest_ns)
    }
}

/// Says that the loop is over.
struct LoopOver(SharedDesk);

impl Drop for LoopOver {
    fn drop(&mut self) {
        locked(&self.0.0).over = true;
        self.0.1.notify_all();
    }
}

fn parts(target: &ArmTarget) -> TargetParts {
    let ArmTarget { state, motion, at_ns, command } = target;
    let (q, qd) = motion.unzip();
    let command = command.unwrap_or_default();
    (state.label(), state.moves(), q, qd, *at_ns, command.tick, command.mode, command.flags)
}

#[pymethods]
impl ArmHandle {
    /// A measurement; false if its stamp is that of the one before, which then was no new one.
    #[pyo3(signature = (stamp_ns, q, qd, effort, effort_unit, safety_mode, robot_mode, robot_stamp_ns))]
    #[expect(clippy::too_many_arguments, reason = "the fields of a joint state")]
    fn measured(
        &self,
        stamp_ns: Option<u64>,
        q: GivenJoints,
        qd: GivenJoints,
        effort: Option<GivenJoints>,
        effort_unit: u32,
        safety_mode: u32,
        robot_mode: u32,
        robot_stamp_ns: u64,
    ) -> PyResult<bool> {
        let mut state = JointState {
            q,
            qd,
            effort: effort.unwrap_or_default(),
            effort_unit,
            safety_mode,
            robot_mode,
            robot_stamp_ns,
            ..JointState::default()
        };
        if self.simulated {
            state.line.flags |= arm_flags::SIMULATED;
        }
        state.validate().map_err(LiveFailure::from)?;
        // Held until it is told: of two threads, stamps and measurements come in the same order.
        let mut newest_ns = locked(&self.measured_ns);
        let stamp_ns = stamp_ns.unwrap_or_else(monotonic_now_ns);
        if !Self::check_stamp(stamp_ns, *newest_ns)? {
            return Ok(false);
        }
        self.tell(ArmNews::Measured(Box::new(state), stamp_ns))?;
        *newest_ns = stamp_ns;
        Ok(true)
    }

    /// The target of the next cycle if `wait`, else the newest one.
    fn target(&self, py: Python<'_>, wait: bool) -> PyResult<TargetParts> {
        same_process(self.end.pid, "the arm")?;
        let deadline = Instant::now() + PATIENCE;
        loop {
            let found = py.detach(|| {
                let (mutex, turn) = &*self.end.desk;
                let look = Duration::from_millis(100);
                let old = |desk: &mut ArmDesk| desk.cycle == 0 || (wait && desk.cycle == desk.read_cycle);
                let unread = |desk: &mut ArmDesk| old(desk) && !desk.over;
                let waited = turn.wait_timeout_while(locked(mutex), look, unread);
                let mut desk = waited.unwrap_or_else(PoisonError::into_inner).0;
                if desk.over {
                    let text = "the arm's loop is over: open the interface again";
                    return Some(Err(LiveFailure::new(FailureKind::Other, text)));
                }
                (!old(&mut desk)).then(|| Ok(desk.read()))
            });
            if let Some(target) = found {
                return Ok(parts(&target?));
            }
            py.check_signals()?;
            if Instant::now() >= deadline {
                let text = "the arm's loop gave no target: it hangs while it attaches to a new daemon; see \
                            `foretrace doctor`";
                return Err(LiveFailure::new(FailureKind::NoAnswer, text).into());
            }
        }
    }

    /// Why the arm does not follow, and what to do about it; none: nothing keeps it any more.
    fn note(&self, note: Option<(String, String)>) -> PyResult<()> {
        Ok(self.tell(ArmNews::Note(note))?)
    }

    /// Totals since the start.
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let desk = locked(&self.end.desk.0);
        let (counts, trouble) = (desk.counts, desk.trouble.clone());
        drop(desk);
        let dict = PyDict::new(py);
        dict.set_item("cycles", counts.cycles)?;
        dict.set_item("cycles_skipped", counts.cycles_skipped)?;
        dict.set_item("states_sent", counts.states_sent)?;
        dict.set_item("states_unheard", counts.states_unheard)?;
        dict.set_item("states_not_sent", counts.states_not_sent)?;
        dict.set_item("commands_received", counts.commands_received)?;
        dict.set_item("commands_lost", counts.commands_lost)?;
        dict.set_item("commands_refused", counts.commands_refused)?;
        dict.set_item("pauses", counts.pauses)?;
        dict.set_item("trouble", trouble)?;
        Ok(dict)
    }

    #[getter]
    const fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.end.close());
    }
}
