//! The last stage of a tick: what was decided, as plain data.

use super::Follower;
use super::intake::{PenNews, Seen};
use super::io::{Health, JointCommand, Mode, Refusal, StepOutput};
use super::motion::Moved;
use crate::pen::PenOrigin;
use crate::trust::TrustReport;
use crate::units::Stamp;

/// What the stages handed on.
pub(super) struct Outcomes<const J: usize> {
    pub(super) health: Health,
    pub(super) seen: Seen,
    pub(super) pen: PenNews,
    pub(super) trust: TrustReport,
    pub(super) moved: Moved<J>,
    /// What the way home came to.
    pub(super) way: Option<Result<(), Refusal>>,
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// The answer of the tick.
    pub(super) fn report(&self, now: Stamp, outcomes: Outcomes<J>) -> StepOutput<J> {
        let Outcomes { health, seen, pen, trust, moved, way } = outcomes;
        let newest = self.pen.newest();
        StepOutput {
            command: moved
                .command
                .map(|command| JointCommand { enabled: !(self.watch.stopped() && moved.at_rest), ..command }),
            begins: seen.begins,
            mode: self.watch.mode(),
            stop_reason: self.watch.reason(),
            stop_detail: self.watch.detail(),
            arm_speed_share: self.monitor.speed_share(),
            answer: seen.answer,
            home: (self.watch.mode() == Mode::Homing).then(|| self.mover.home_progress()),
            way,
            rung: moved.rung,
            health,
            trust,
            predictor: self.previewer.active(),
            weights_version: self.previewer.version(),
            pen_stamp: newest.map(|pen| pen.stamp),
            pen_origin: newest.map_or_else(PenOrigin::default, |pen| pen.origin),
            pen_position: newest.map_or([0.0; 2], |pen| pen.position),
            pen_contact: newest.is_some_and(|pen| pen.contact),
            pen_counters: self.pen.counters(),
            pen_refused: self.pen.refused(),
            predictor_error: pen.error,
            predictor_band: self
                .preview
                .lead(now, self.ahead_ns())
                .and_then(|lead| self.preview.band(lead + 1.0)),
            dead_time_ns: self.dead_time.ns(),
            lag: self.lag.estimate(),
            reference: moved.reference,
            path: moved.path,
            setpoint: moved.setpoint,
            tool: moved.tool,
            axes: moved.axes,
            ik: moved.ik,
            guard_altered: moved.guard_altered,
            learn: pen.learn,
            learn_count: pen.count,
        }
    }
}
