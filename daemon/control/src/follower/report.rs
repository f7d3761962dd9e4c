//! The last stage of a tick: what was decided, as plain data.

use super::Follower;
use super::io::{Health, JointCommand, Mode, Refusal, Request, StepOutput};
use super::motion::{Gap, MotionReport};
use super::pen::PenTick;
use super::predict::ClosedSteps;
use super::settings::Lookahead;
use crate::predict::ExternalReport;
use crate::trust::TrustReport;

/// What the stages handed on.
pub(super) struct TickReport<const J: usize> {
    pub(super) request: Option<Request>,
    pub(super) answer: Option<Result<(), Refusal>>,
    pub(super) gap: Gap<J>,
    pub(super) health: Health,
    pub(super) pen: PenTick,
    pub(super) closed: ClosedSteps,
    pub(super) ahead: Lookahead,
    pub(super) trust: TrustReport,
    pub(super) external: Option<ExternalReport>,
    pub(super) governor: f64,
    /// What the way home came to.
    pub(super) way: Option<Result<(), Refusal>>,
    pub(super) moved: MotionReport<J>,
}

impl<const N: usize, const J: usize> Follower<N, J> {
    /// The answer of the tick: what the stages handed on, and how they stand. Changes nothing.
    pub(super) fn report(&self, tick: TickReport<J>) -> StepOutput<J> {
        let TickReport {
            request,
            answer,
            gap,
            health,
            pen,
            closed,
            ahead,
            trust,
            external,
            governor,
            way,
            moved,
        } = tick;
        let (mode, tracker, previewer) = (self.watch.mode(), self.pen.tracker(), self.prediction.previewer());
        let taken = matches!((request, answer), (Some(Request::Arm | Request::MoveHome), Some(Ok(()))));
        let newest = pen.newest.unwrap_or_default();
        let enabled = !(self.watch.stopped() && moved.at_rest);
        StepOutput {
            command: moved.command.map(|command| JointCommand { enabled, ..command }),
            begins: taken || gap.begins,
            mode,
            stop_reason: self.watch.reason,
            stop_detail: self.watch.detail,
            arm_speed_share: self.monitor.speed_share(),
            answer,
            home: (mode == Mode::Homing).then(|| self.mover.home_progress()),
            way,
            rung: moved.rung,
            health,
            trust,
            governor,
            predictor: previewer.active(),
            external,
            preview_steps: ahead.steps,
            weights_version: previewer.version(),
            pen_stamp: pen.newest.map(|pen| pen.stamp),
            pen_origin: newest.origin,
            pen_position: newest.position,
            pen_contact: newest.contact,
            pen_counters: tracker.counters(),
            pen_refused: tracker.refused(),
            predictor_error: closed.error,
            predictor_band: self
                .preview
                .lead(gap.now, ahead.ahead_ns)
                .and_then(|lead| self.preview.band(lead + 1.0)),
            dead_time_ns: ahead.dead_time_ns,
            lag: self.monitor.lag(),
            reference: moved.reference,
            path: moved.path,
            setpoint: moved.setpoint,
            tool: moved.tool,
            axes: moved.axes,
            ik: moved.ik,
            guard_altered: moved.guard_altered,
            learn: closed.learn,
            learn_count: closed.count,
        }
    }
}
