//! The unconstrained optimum of all three axes at once, one axis per lane.
//!
//! The usual tick: no limit is active, and everything is two backward sweeps, one product with H⁻¹ and two
//! forward sweeps over four-wide numbers that the compiler vectorises on any x86-64. Each lane says whether
//! it keeps its limits and carries its certificate; a lane that does not is left to [`super::axis`]. Same
//! equations and units as there.

use crate::state::{self, Reader, StateError, Writer, state};
use std::array::from_fn;

use super::behind::Behind;
use super::cost::{Cost, Weights};
use super::lanes::{Coefficient, Lanes};
use super::model::{AxisVector, Scale};
use super::sweeps::{Begin, Sweep, errors, from_weights, roll, rolled};
use crate::qp::dual::Bounds;
use crate::units::AxisState;

/// Weights and H⁻¹ of the three axes at one trust, side by side, with their limits.
#[derive(Debug, Clone)]
pub(super) enum Free<const N: usize> {
    /// All axes have the same gains.
    Shared(Box<Blended<f64, N>>),
    /// The axes have different gains.
    Own(Box<Blended<Lanes, N>>),
}

impl<const N: usize> state::State for Free<N> {
    fn save(&self, to: &mut Writer<'_>) {
        match self {
            Self::Shared(blended) => state::State::save(blended, to),
            Self::Own(blended) => state::State::save(blended, to),
        }
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        match self {
            Self::Shared(blended) => state::State::load(blended, from),
            Self::Own(blended) => state::State::load(blended, from),
        }
    }
}

impl<const N: usize> Free<N> {
    /// Limits of the axes; the weights come with [`Free::set_costs`].
    pub(super) fn new(bounds: [&Bounds<4, N>; 3], same_gains: bool) -> Self {
        if same_gains {
            Self::Shared(Box::new(Blended::new(bounds)))
        } else {
            Self::Own(Box::new(Blended::new(bounds)))
        }
    }

    /// Take over weights and H⁻¹ after the trust has changed.
    pub(super) fn set_costs(&mut self, costs: [&Cost<N>; 3], scale: &Scale) {
        match self {
            Self::Shared(blended) => blended.set_costs(costs, scale),
            Self::Own(blended) => blended.set_costs(costs, scale),
        }
    }

    /// Solve the three axes without limits, then test the limits and the gradient.
    #[inline]
    pub(super) fn solve(
        &self,
        scale: &Scale,
        start: (&[AxisState; 3], &[AxisState; 3]),
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
    ) -> FreeOptimum<N> {
        match self {
            Self::Shared(blended) => blended.solve(scale, start, conservative, preview),
            Self::Own(blended) => blended.solve(scale, start, conservative, preview),
        }
    }
}

/// The numbers of [`Free`], with coefficients of kind `C`.
#[derive(Debug, Clone)]
pub(super) struct Blended<C, const N: usize> {
    /// (1−α)G_c² and αG_f² including the factors from SI units, and their normalised sum; per step
    /// acceleration, velocity, position.
    feedback: [[C; 3]; N],
    feedforward: [[C; 3]; N],
    weights: [[C; 3]; N],
    inverse: [[C; N]; N],
    effort: C,
    /// Largest jerk, acceleration and velocity; lowest and highest position \[mm\].
    largest: [Lanes; 3],
    workspace: [Lanes; 2],
    reads_preview: bool,
    /// The servo behind which errors are counted; the same for all axes.
    behind: Option<Behind>,
}

state! {
    [C: crate::state::State, const N: usize] Blended<C, N> {
        feedback, feedforward, weights, inverse, effort, reads_preview,
    }
    fixed { largest, workspace, behind }
}

/// Results of the three lanes.
#[derive(Debug, Clone)]
pub(super) struct FreeOptimum<const N: usize> {
    jerks: [Lanes; N],
    start: [Lanes; 3],
    /// 1 + max |q|
    scale: Lanes,
    /// Sum of the absolute gradient at the optimum over `scale`: bounds its largest entry, and propagates
    /// NaN.
    residual: Lanes,
    inside: [bool; 3],
}

impl<C: Coefficient, const N: usize> Blended<C, N> {
    fn new(bounds: [&Bounds<4, N>; 3]) -> Self {
        // Limits are the same at every step.
        let first = |rows: [f64; N]| rows.first().copied().unwrap_or(0.0);
        let upper = bounds.map(|bounds| bounds.upper.map(first));
        let lower = bounds.map(|bounds| bounds.lower.map(first));
        let block = |rows: &[[f64; 4]; 3], pick: fn(&[f64; 4]) -> f64| {
            let [x, y, z] = rows.each_ref().map(pick);
            Lanes::of([x, y, z])
        };
        Self {
            feedback: [[C::ZERO; 3]; N],
            feedforward: [[C::ZERO; 3]; N],
            weights: [[C::ZERO; 3]; N],
            inverse: [[C::ZERO; N]; N],
            effort: C::ZERO,
            largest: [
                block(&upper, |[jerk, ..]| *jerk),
                block(&upper, |[_, acceleration, ..]| *acceleration),
                block(&upper, |[_, _, velocity, _]| *velocity),
            ],
            workspace: [block(&lower, |[.., position]| *position), block(&upper, |[.., position]| *position)],
            reads_preview: false,
            behind: None,
        }
    }

    #[expect(clippy::indexing_slicing, reason = "indices run over the array lengths of the types")]
    fn set_costs(&mut self, costs: [&Cost<N>; 3], scale: &Scale) {
        let units = [scale.acceleration, scale.velocity, scale.position];
        for i in 0..N {
            for k in 0..3 {
                let of = |weights: fn(&Cost<N>) -> &Weights<N>| costs.map(|cost| weights(cost)[k][i]);
                let (feedback, feedforward) = (of(|cost| cost.blended().0), of(|cost| cost.blended().1));
                self.feedback[i][k] = C::of(feedback.map(|weight| weight * units[k]));
                self.feedforward[i][k] = C::of(feedforward.map(|weight| weight * units[k]));
                self.weights[i][k] = C::of(from_fn(|axis| feedback[axis] + feedforward[axis]));
            }
            for j in 0..N {
                self.inverse[i][j] = C::of(costs.map(|cost| cost.inverse()[i][j]));
            }
        }
        self.effort = C::of(costs.map(Cost::effort));
        self.behind = costs.first().and_then(|cost| cost.behind()).copied();
        self.reads_preview = costs.iter().any(|cost| cost.alpha() > 0.0);
    }

    #[inline(always)]
    fn solve(
        &self,
        scale: &Scale,
        (start, arm): (&[AxisState; 3], &[AxisState; 3]),
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
    ) -> FreeOptimum<N> {
        let origin = Lanes::of(start.map(|state| state.position));
        let velocity = Lanes::of(start.map(|state| state.velocity)) * scale.velocity;
        let acceleration = Lanes::of(start.map(|state| state.acceleration)) * scale.acceleration;

        let mut pull = [[Lanes::ZERO; 3]; N];
        self.pull(origin, conservative, preview, &mut pull);

        let begin = Begin {
            velocity,
            acceleration,
            arm: [
                (Lanes::of(arm.map(|state| state.position)) - origin) * scale.position,
                Lanes::of(arm.map(|state| state.velocity)) * scale.velocity,
            ],
        };
        let mut jerks = [Lanes::ZERO; N];
        let mut motion = [[Lanes::ZERO; 4]; N];
        let mut gradient = [Lanes::ZERO; N];
        roll(&jerks, &begin, &mut motion);
        self.gradient(&begin, &motion, &pull, &mut gradient);
        let size = gradient.iter().fold(Lanes::ZERO, |most, q| q.abs().max(most)) + Lanes::of([1.0; 3]);
        for (jerk, row) in jerks.iter_mut().zip(&self.inverse).take(rolled(N)) {
            let mut sum = Lanes::ZERO;
            for (entry, q) in row.iter().zip(&gradient) {
                sum = sum - entry.times(*q);
            }
            *jerk = sum;
        }
        roll(&jerks, &begin, &mut motion);
        let [lowest, highest] = self.workspace;
        let origin = origin * scale.position;
        let inside = self.inside(&motion, [lowest - origin, highest - origin]);
        self.gradient(&begin, &motion, &pull, &mut gradient);
        let left = gradient.iter().fold(Lanes::ZERO, |sum, entry| sum + entry.abs());
        let residual = left.zip(size, |gradient, size| gradient / size);
        FreeOptimum { jerks, start: [Lanes::ZERO, velocity, acceleration], scale: size, residual, inside }
    }

    /// (1−α)G_c² x_c + αG_f² g, positions counted from `origin` \[m\].
    #[inline(always)]
    fn pull(
        &self,
        origin: Lanes,
        conservative: &[AxisState; 3],
        preview: &[[AxisState; N]; 3],
        pull: &mut [[Lanes; 3]; N],
    ) {
        let held = [
            Lanes::of(conservative.map(|state| state.acceleration)),
            Lanes::of(conservative.map(|state| state.velocity)),
            Lanes::of(conservative.map(|state| state.position)) - origin,
        ];
        for (pull, weights) in pull.iter_mut().zip(&self.feedback).take(rolled(N)) {
            *pull = from_weights(weights, &held);
        }
        // A predictor at zero trust must have no effect on Hold.
        if self.reads_preview {
            let [px, py, pz] = preview;
            let references = px.iter().zip(py).zip(pz);
            for ((pull, weights), ((x, y), z)) in
                pull.iter_mut().zip(&self.feedforward).zip(references).take(rolled(N))
            {
                let reference = [
                    Lanes::of([x.acceleration, y.acceleration, z.acceleration]),
                    Lanes::of([x.velocity, y.velocity, z.velocity]),
                    Lanes::of([x.position, y.position, z.position]) - origin,
                ];
                let [a, v, p] = from_weights(weights, &reference);
                let [on_acceleration, on_velocity, on_position] = pull;
                *on_acceleration += a;
                *on_velocity += v;
                *on_position += p;
            }
        }
    }

    /// Whether each axis keeps its limits along `motion`.
    #[inline(always)]
    fn inside(&self, motion: &[[Lanes; 4]; N], [lowest, highest]: [Lanes; 2]) -> [bool; 3] {
        let mut extremes = [Lanes::ZERO; 3];
        let (mut least, mut most) = (Lanes::of([f64::INFINITY; 3]), Lanes::of([f64::NEG_INFINITY; 3]));
        for [u, acceleration, velocity, position] in motion.iter().take(rolled(N)) {
            let [jerk, accelerated, fast] = &mut extremes;
            *jerk = u.abs().max(*jerk);
            *accelerated = acceleration.abs().max(*accelerated);
            *fast = velocity.abs().max(*fast);
            least = position.min(least);
            most = position.max(most);
        }
        let mut inside = [true; 3];
        let within = |value: Lanes, limit: Lanes, inside: &mut [bool; 3]| {
            for (axis, inside) in inside.iter_mut().enumerate() {
                *inside &= value.axis(axis) <= limit.axis(axis);
            }
        };
        for (extreme, limit) in extremes.into_iter().zip(self.largest) {
            within(extreme, limit, &mut inside);
        }
        within(lowest, least, &mut inside);
        within(most, highest, &mut inside);
        inside
    }

    /// ∇½J at `motion`.
    #[inline(always)]
    fn gradient(
        &self,
        begin: &Begin,
        motion: &[[Lanes; 4]; N],
        pull: &[[Lanes; 3]; N],
        gradient: &mut [Lanes; N],
    ) {
        match &self.behind {
            None => self.of_command(motion, pull, gradient),
            Some(behind) => self.of_arm(behind, begin, motion, pull, gradient),
        }
    }

    #[inline(always)]
    fn of_command(&self, motion: &[[Lanes; 4]; N], pull: &[[Lanes; 3]; N], gradient: &mut [Lanes; N]) {
        let mut sweep = Sweep::default();
        let steps = motion.iter().zip(&self.weights).zip(pull).zip(gradient);
        for (((motion, weights), pull), to) in steps.rev().take(rolled(N)) {
            let [u, a, v, p] = motion;
            *to = sweep.back(errors(&[*a, *v, *p], weights, pull)) + self.effort.times(*u);
        }
    }

    /// The errors are the arm's: forward through the servo, backward through its transpose.
    #[inline(always)]
    fn of_arm(
        &self,
        behind: &Behind,
        begin: &Begin,
        motion: &[[Lanes; 4]; N],
        pull: &[[Lanes; 3]; N],
        gradient: &mut [Lanes; N],
    ) {
        let mut forces = [[Lanes::ZERO; 3]; N];
        let (mut command, mut arm) = ([Lanes::ZERO, begin.velocity, begin.acceleration], begin.arm);
        let steps = motion.iter().zip(&self.weights).zip(pull).zip(&mut forces);
        for ((([u, a, v, p], weights), pull), force) in steps.take(rolled(N)) {
            arm = behind.ahead(arm, command, *u);
            command = [*p, *v, *a];
            *force = errors(&behind.seen(arm, *p), weights, pull);
        }
        let mut sweep = Sweep::default();
        let (mut on_arm, mut on_command) = ([Lanes::ZERO; 2], [Lanes::ZERO; 3]);
        for ((force, [u, ..]), to) in forces.iter().zip(motion).zip(gradient).rev().take(rolled(N)) {
            let ([on_y, on_w], on_position) = behind.seen_transposed(*force);
            let ([y, w], [p, v, a]) = (on_arm, on_command);
            let (before, command, jerk) = behind.ahead_transposed([y + on_y, w + on_w]);
            *to = sweep.back([a, v, p + on_position]) + jerk + self.effort.times(*u);
            (on_arm, on_command) = (before, command);
        }
    }
}

impl<const N: usize> FreeOptimum<N> {
    /// The axis keeps every limit.
    #[inline(always)]
    pub(super) fn inside(&self, axis: usize) -> bool {
        self.inside.get(axis).is_some_and(|inside| *inside)
    }

    /// Upper bound of the axis' stationarity residual; NaN for non-finite input.
    #[inline(always)]
    pub(super) fn residual(&self, axis: usize) -> f64 {
        self.residual.axis(axis)
    }

    /// What residuals are relative to.
    pub(super) fn scale(&self, axis: usize) -> f64 {
        self.scale.axis(axis)
    }

    /// Normalised state at the start.
    pub(super) fn start(&self, axis: usize) -> AxisVector {
        self.start.map(|lanes| lanes.axis(axis))
    }

    /// Jerks of the axis.
    #[inline(always)]
    pub(super) fn jerks(&self, axis: usize) -> [f64; N] {
        let mut jerks = [0.0; N];
        for (jerk, u) in jerks.iter_mut().zip(&self.jerks) {
            *jerk = u.axis(axis);
        }
        jerks
    }
}
