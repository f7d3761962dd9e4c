//! `HistoryHandle`: the joint states of the last seconds, and what they were at an instant in between.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use foretrace_client::{Foretrace, Instance, JOINTS, JointState, JointWatch, Lasting, monotonic_now_ns};
use pyo3::prelude::*;

use super::failure::LiveFailure;
use super::pen::PATIENCE;
use super::worker::{Closing, HandleWorker};

const COLLECT: Duration = Duration::from_millis(5);
/// States that are kept: 16 s at 500 Hz.
const KEPT: usize = 8192;
/// Nothing is said of an instant in a longer silence of the arm \[ns\].
const LONGEST_GAP_NS: u64 = 100_000_000;

struct StateHistory {
    watch: Lasting<JointWatch>,
    states: VecDeque<JointState>,
}

/// Joints at an instant: positions \[rad\], velocities \[rad/s\], and the time between the two states around
/// it \[ns\].
type JointsAt = (Vec<f64>, Vec<f64>, u64);

impl StateHistory {
    fn collect(&mut self) {
        let states = &mut self.states;
        if let Some(watch) = &mut self.watch.handle {
            watch.drain(|state| {
                if states.back().is_none_or(|last| state.header.stamp_ns > last.header.stamp_ns) {
                    if states.len() == KEPT {
                        states.pop_front();
                    }
                    states.push_back(*state);
                }
            });
        }
        // An error is no end: the next look tries again.
        let _ = self.watch.look(Foretrace::joint_watch);
    }

    fn at(&self, t_ns: u64) -> Result<JointsAt, LiveFailure> {
        let far = |ns: u64| ns as f64 * 1e-9;
        let after = self.states.partition_point(|state| state.header.stamp_ns < t_ns);
        let (Some(next), first) = (self.states.get(after), self.states.front()) else {
            let newest = self.states.back().map(|state| state.header.stamp_ns);
            let text = match newest {
                None => "no joint state has come since the history was begun: is there an arm?".to_owned(),
                Some(newest_ns) => format!(
                    "t_ns = {t_ns} is {:.4} s after the newest joint state, which is {:.4} s old: ask for a time \
                     that has passed, on the clock of time.monotonic_ns()",
                    far(t_ns.saturating_sub(newest_ns)),
                    far(monotonic_now_ns().saturating_sub(newest_ns))
                ),
            };
            return Err(LiveFailure::invalid(text));
        };
        if next.header.stamp_ns == t_ns {
            return Ok((next.q.to_vec(), next.qd.to_vec(), 0));
        }
        let Some(last) = after.checked_sub(1).and_then(|before| self.states.get(before)) else {
            let first_ns = first.map_or(0, |state| state.header.stamp_ns);
            let text = format!(
                "t_ns = {t_ns} is {:.3} s before the oldest state that is kept: {KEPT} are, from the first call of \
                 state_at on",
                far(first_ns.saturating_sub(t_ns))
            );
            return Err(LiveFailure::invalid(text));
        };
        let gap_ns = next.header.stamp_ns - last.header.stamp_ns;
        if gap_ns > LONGEST_GAP_NS {
            let text = format!(
                "t_ns = {t_ns} lies in a silence of the arm of {:.3} s, allowed {:.1} s: where it was is not known",
                far(gap_ns),
                far(LONGEST_GAP_NS)
            );
            return Err(LiveFailure::invalid(text));
        }
        let share = (t_ns - last.header.stamp_ns) as f64 / gap_ns as f64;
        let between = |a: &[f64; JOINTS], b: &[f64; JOINTS]| {
            a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect::<Vec<_>>()
        };
        Ok((between(&last.q, &next.q), between(&last.qd, &next.qd), gap_ns))
    }
}

/// The measured joints of the last seconds.
#[pyclass(frozen, module = "foretrace._native")]
pub struct HistoryHandle {
    worker: Arc<HandleWorker<StateHistory>>,
}

impl HistoryHandle {
    pub fn open(py: Python<'_>, instance: Instance) -> PyResult<Self> {
        let open = move || -> Result<StateHistory, LiveFailure> {
            let foretrace = Foretrace::attach_within(&instance, Duration::ZERO)?;
            let watch = foretrace.joint_watch()?;
            Ok(StateHistory { watch: Lasting::new(foretrace, watch), states: VecDeque::with_capacity(KEPT) })
        };
        let worker = HandleWorker::start(py, "the history", COLLECT, PATIENCE, open, StateHistory::collect)?;
        Ok(Self { worker })
    }
}

#[pymethods]
impl HistoryHandle {
    fn at(&self, py: Python<'_>, t_ns: u64) -> PyResult<JointsAt> {
        let job = move |history: &mut StateHistory| {
            history.collect();
            history.at(t_ns)
        };
        Ok(self.worker.call(py, PATIENCE, job)??)
    }

    /// Stamp of the newest state \[ns\]; none: none has come.
    fn newest_ns(&self, py: Python<'_>) -> PyResult<Option<u64>> {
        self.worker.call(py, PATIENCE, |history| {
            history.collect();
            history.states.back().map(|state| state.header.stamp_ns)
        })
    }

    fn close(&self, py: Python<'_>) {
        py.detach(|| self.worker.close());
    }
}
