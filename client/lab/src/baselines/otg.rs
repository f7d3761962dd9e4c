//! Online trajectory generation towards a moving target: the usual choice for arms with jerk limits.
//!
//! Every period the pen's state is estimated from its last samples, extrapolated with constant acceleration
//! by its age, the period and the dead time, and a jerk-limited time-optimal trajectory from the tool's
//! commanded state to that state is planned again (crate `rsruckig`, a port of Ruckig: Berscheid and Kröger,
//! RSS 2021; its tracking interface clamps targets that the limits cannot reach). Axes are independent. A
//! period without a plan follows the last plan, and where that has ended, brakes; both are counted.
//!
//! A trajectory to the pen's present position arrives when the pen has moved on. With `intercept` the target
//! is the pen at the time of arrival: the shortest such time is searched.

use foretrace_sim::path::PathSample;
use rsruckig::prelude::{
    ControlInterface, IgnoreErrorHandler, InputParameter, OutputParameter, Ruckig, RuckigResult, TargetState,
    Trackig,
};

use super::intake::{Intake, SampleRole};
use super::trend::{AxisTrend, Trend};
use super::{Baseline, BaselineSettings, Limits, OtgKnobs};

/// A trajectory generator behind the pen.
pub struct OtgWay {
    intake: Intake,
    trend: Trend,
    knobs: OtgKnobs,
    lead_s: f64,
    axes: [Generator; 2],
    started: bool,
    failures: u64,
}

impl OtgWay {
    pub(super) fn new(settings: &BaselineSettings) -> Self {
        let knobs = settings.otg;
        let limits = Limits {
            velocity_mps: knobs.limits.velocity_mps.min(settings.limits.velocity_mps),
            acceleration_mps2: knobs.limits.acceleration_mps2.min(settings.limits.acceleration_mps2),
            jerk_mps3: knobs.limits.jerk_mps3.min(settings.limits.jerk_mps3),
        };
        Self {
            intake: Intake::default(),
            trend: Trend::new(knobs.window_s),
            knobs,
            lead_s: settings.period_s + settings.dead_time_s,
            axes: [0, 1].map(|_| Generator::new(settings.period_s, &limits)),
            started: false,
            failures: 0,
        }
    }

    /// Commanded state of the tool, per axis.
    #[cfg(test)]
    pub(super) fn state(&self) -> [AxisTrend; 2] {
        self.axes.each_ref().map(Generator::state)
    }
}

impl Baseline for OtgWay {
    fn target(&mut self, now_s: f64, pen: &[PathSample]) -> Option<[f64; 2]> {
        for sample in pen {
            match self.intake.take(now_s, sample) {
                SampleRole::Dropped => continue,
                SampleRole::First => self.trend.clear(),
                SampleRole::Next(_) => {}
            }
            self.trend.push(sample.t_s, [sample.x_m, sample.y_m]);
        }
        let pen = self.trend.fit()?;
        if !self.started {
            let position = self.intake.position()?;
            for (axis, position) in self.axes.iter_mut().zip(position) {
                axis.input.current_position[0] = position;
            }
            self.started = true;
        }
        let lead_s = (self.intake.age_s(now_s) + self.lead_s).min(self.knobs.horizon_max_s);
        let mut planned = true;
        for (axis, pen) in self.axes.iter_mut().zip(pen) {
            let believed =
                AxisTrend { acceleration: self.knobs.acceleration_share * pen.acceleration, ..pen };
            planned &= axis.follow(&believed.after(lead_s), &self.knobs);
        }
        self.failures += u64::from(!planned);
        Some(self.axes.each_ref().map(|axis| axis.input.current_position[0]))
    }

    fn failures(&self) -> u64 {
        self.failures
    }

    fn limited(&self) -> bool {
        self.axes.iter().any(Generator::limited)
    }
}

type Tracker = Trackig<1, IgnoreErrorHandler>;

/// One axis: its commanded state and the planner that continues from it.
struct Generator {
    period_s: f64,
    tracker: Tracker,
    /// Computes the duration of a motion without disturbing the tracker's last plan.
    probe: Tracker,
    brake: Ruckig<1, IgnoreErrorHandler>,
    input: InputParameter<1>,
    output: OutputParameter<1>,
    probed: OutputParameter<1>,
}

impl Generator {
    fn new(period_s: f64, limits: &Limits) -> Self {
        let mut input = InputParameter::new(None);
        input.max_velocity[0] = limits.velocity_mps;
        input.max_acceleration[0] = limits.acceleration_mps2;
        input.max_jerk[0] = limits.jerk_mps3;
        Self {
            period_s,
            tracker: Trackig::new(None, period_s),
            probe: Trackig::new(None, period_s),
            brake: Ruckig::new(None, period_s),
            input,
            output: OutputParameter::new(None),
            probed: OutputParameter::new(None),
        }
    }

    /// Saturated in speed or acceleration. Jerk does not count: a time-optimal motion always uses all of it.
    fn limited(&self) -> bool {
        let at = |value: f64, most: f64| value.abs() >= 0.999 * most;
        at(self.input.current_velocity[0], self.input.max_velocity[0])
            || at(self.input.current_acceleration[0], self.input.max_acceleration[0])
    }

    #[cfg(test)]
    fn state(&self) -> AxisTrend {
        AxisTrend {
            position: self.input.current_position[0],
            velocity: self.input.current_velocity[0],
            acceleration: self.input.current_acceleration[0],
        }
    }

    /// Moves through one period towards `pen`, the pen at the end of the period; false where there was no
    /// plan.
    fn follow(&mut self, pen: &AxisTrend, knobs: &OtgKnobs) -> bool {
        let met_s = if knobs.intercept { self.meeting_s(pen, knobs) } else { self.period_s };
        // A tool ahead of the pen must not arrive early.
        self.input.minimum_duration = knobs.intercept.then_some(met_s);
        let target = aim(pen, met_s - self.period_s, knobs);
        let result = self.tracker.update(&target, &self.input, &mut self.output);
        self.input.minimum_duration = None;
        let followed = matches!(result, Ok(RuckigResult::Working | RuckigResult::Finished));
        if !(followed && is_finite(&self.output)) {
            self.stop();
        }
        let planned = self.output.new_calculation && followed;
        self.output.pass_to_input(&mut self.input);
        planned
    }

    /// The shortest time \[s\], counted from the beginning of the period, in which the pen can be met:
    /// doubling, then bisection. Where it cannot be met in time, the period: the tool then follows as without
    /// interception.
    fn meeting_s(&mut self, pen: &AxisTrend, knobs: &OtgKnobs) -> f64 {
        let (mut early, mut met) = (0.0, self.period_s);
        while !self.arrives_within(pen, met, knobs) {
            (early, met) = (met, 2.0 * met);
            if met > MEETING_MAX_S {
                return self.period_s;
            }
        }
        while early > 0.0 && met - early > 0.1 * met {
            let middle = 0.5 * (early + met);
            if self.arrives_within(pen, middle, knobs) { met = middle } else { early = middle }
        }
        met
    }

    fn arrives_within(&mut self, pen: &AxisTrend, time_s: f64, knobs: &OtgKnobs) -> bool {
        let target = aim(pen, time_s - self.period_s, knobs);
        let result = self.probe.update(&target, &self.input, &mut self.probed);
        result.is_ok() && self.probed.new_calculation && self.probed.trajectory.get_duration() <= time_s
    }

    /// Moves the commanded state through one period of a jerk-limited stop; where even that has no plan,
    /// stands still.
    fn stop(&mut self) {
        let mut input = self.input.clone();
        input.control_interface = ControlInterface::Velocity;
        input.target_velocity[0] = 0.0;
        input.target_acceleration[0] = 0.0;
        let planned = self.brake.calculate(&input, &mut self.output.trajectory);
        if matches!(planned, Ok(RuckigResult::Working | RuckigResult::Finished)) {
            let at_s = self.period_s.min(self.output.trajectory.get_duration());
            self.output.trajectory.at_time(
                at_s,
                &mut Some(&mut self.output.new_position),
                &mut Some(&mut self.output.new_velocity),
                &mut Some(&mut self.output.new_acceleration),
                &mut None,
                &mut None,
            );
        }
        if !is_finite(&self.output) {
            self.output.new_position[0] = self.input.current_position[0];
            self.output.new_velocity[0] = 0.0;
            self.output.new_acceleration[0] = 0.0;
        }
    }
}

/// Longest extrapolation of the pen \[s\].
const MEETING_MAX_S: f64 = 0.1;

/// The pen `later_s` on, as the generator's target.
fn aim(pen: &AxisTrend, later_s: f64, knobs: &OtgKnobs) -> TargetState<1> {
    let then = pen.after(later_s);
    let mut target = TargetState::new(None);
    target.position[0] = then.position;
    target.velocity[0] = then.velocity;
    target.acceleration[0] = if knobs.target_acceleration { then.acceleration } else { 0.0 };
    target
}

fn is_finite(output: &OutputParameter<1>) -> bool {
    let state = [output.new_position[0], output.new_velocity[0], output.new_acceleration[0]];
    state.iter().all(|value| value.is_finite())
}
