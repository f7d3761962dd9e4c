//! An arm with masses that reports efforts, and things that it may touch.
//!
//! Its joints are filters of second order with a damping ζ of their own. Its efforts are the torques of that
//! motion (true payload, rotors, friction), of what presses on the tip (Jᵀ F of a spring), and noise. What
//! presses also bends the servo, of 20 Hz, until its integral has taken that away.

use foretrace_control::arm::{Chain, Dynamics, Payload};
use foretrace_control::contact::{EffortReading, EffortUnit};
use foretrace_control::follower::{Budget, Request, StepInput, StepOutput};
use foretrace_control::pen::PenReading;
use foretrace_control::predict::PredictorKind;
use foretrace_control::units::Stamp;
use nalgebra::{Vector3, Vector6};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{Bench, HOME, PERIOD_NS, settings};

/// What this arm and its world are like.
#[derive(Clone, Copy)]
pub(crate) struct World {
    pub(crate) zeta: f64,
    /// Group delay of the servo \[s\].
    pub(crate) lag_s: f64,
    /// Carried in truth; the law is told of nothing \[kg\].
    pub(crate) payload_kg: f64,
    /// Factor on the friction of a UR5.
    pub(crate) friction: f64,
    /// Standard deviation of the reported efforts, as a share of the limits.
    pub(crate) noise: f64,
    pub(crate) unit: EffortUnit,
    /// Reported per Nm, beside what the unit says.
    pub(crate) gain: f64,
    /// When the thing below begins to be there \[s\].
    pub(crate) from_s: f64,
    pub(crate) thing: Thing,
    /// Factor on the time that an excess may last.
    pub(crate) patience: f64,
}

/// What presses on the tip; heights and places in the plane's frame.
#[derive(Clone, Copy)]
pub(crate) enum Thing {
    Nothing,
    /// A surface at this height \[m\], with this stiffness \[N/m\].
    Surface(f64, f64),
    /// A wall that the tip runs into beyond this x \[m\], with this stiffness \[N/m\].
    Wall(f64, f64),
    /// A force \[N\] for a time \[s\].
    Push(Vector3<f64>, f64),
}

impl World {
    pub(crate) const PLAIN: Self = Self {
        zeta: 1.0,
        lag_s: 0.03,
        payload_kg: 0.3,
        friction: 1.0,
        noise: 0.0,
        unit: EffortUnit::NewtonMetres,
        gain: 1.0,
        from_s: 15.0,
        thing: Thing::Nothing,
        patience: 1.0,
    };
}

const COULOMB: [f64; 6] = [8.0, 8.0, 6.0, 2.0, 2.0, 1.5];
const VISCOUS: [f64; 6] = [10.0, 10.0, 8.0, 1.5, 1.5, 1.0];
const ROTOR: f64 = 0.1;
const SERVO_RADPS: f64 = 2.0 * std::f64::consts::PI * 20.0;
/// Time constant of the servo's integral \[s\].
const INTEGRAL_S: f64 = 0.15;
const SUBSTEPS: usize = 4;

pub(crate) struct Touching {
    pub(crate) bench: Bench,
    world: World,
    begun: Stamp,
    chain: Chain<6>,
    truth: Dynamics<6>,
    limits: [f64; 6],
    q: Vector6<f64>,
    qd: Vector6<f64>,
    qdd: Vector6<f64>,
    /// What the servo's integral has taken away \[rad\].
    absorbed: Vector6<f64>,
    /// On the tip, base frame \[N\].
    force: Vector3<f64>,
    /// First touch \[s\], and the largest force so far \[N\].
    pub(crate) touched_s: Option<f64>,
    pub(crate) worst_n: f64,
    random: Pcg64,
}

impl Touching {
    pub(crate) fn armed(world: World, seed: u64) -> Self {
        let mut settings = settings(PredictorKind::CONSTANT_VELOCITY);
        // Only contact is judged here: a soft servo, and one that is pressed on, is the tracking monitor's.
        settings.safety.tracking.joint_rad = 0.5;
        settings.safety.tracking.tool_m = 0.2;
        settings.safety.tracking.runaway_radps = 3.0;
        settings.safety.tracking.still_rad = 0.5;
        let hold_ns = &mut settings.safety.contact.hold_ns;
        *hold_ns = (*hold_ns as f64 * world.patience) as u64;
        let chain = settings.chain.clone();
        let truth = Payload { mass: world.payload_kg, centre: [0.01, -0.01, 0.09] };
        let truth = chain.dynamics(&truth).unwrap();
        let limits = chain.limits().effort;
        let mut bench = Bench::new(settings);
        bench.tick_with(&[], Some(Request::Arm), Budget::default());
        let begun = bench.now;
        let (q, still) = (Vector6::from(HOME), Vector6::zeros());
        let random = Pcg64::seed_from_u64(seed);
        let force = Vector3::zeros();
        Self {
            bench,
            world,
            begun,
            chain,
            truth,
            limits,
            q,
            qd: still,
            qdd: still,
            absorbed: still,
            force,
            touched_s: None,
            worst_n: 0.0,
            random,
        }
    }

    pub(crate) fn time_s(&self) -> f64 {
        self.bench.now.since(self.begun) as f64 * 1e-9
    }

    /// One period of a hand that writes rows of loops and lifts the pen between words.
    pub(crate) fn tick(&mut self) -> StepOutput<6> {
        let t = self.time_s();
        let (place, down) = hand(t);
        self.tick_with(&[PenReading::new(self.bench.now, place, down)])
    }

    pub(crate) fn tick_with(&mut self, pen: &[PenReading]) -> StepOutput<6> {
        let command = self.bench.last.map_or(HOME, |command| command.q);
        for _ in 0..SUBSTEPS {
            self.advance(&Vector6::from(command), PERIOD_NS as f64 * 1e-9 / SUBSTEPS as f64);
        }
        let effort = self.effort();
        let (q, qd) = (self.bent(), self.qd);
        let now = self.bench.now;
        let mut joints = self.bench.joints;
        (joints.stamp, joints.q, joints.qd) = (now, q.into(), qd.into());
        let reading = EffortReading { stamp: now, effort, unit: self.world.unit };
        let input =
            StepInput { pen, joints: Some(&joints), effort: Some(&reading), ..StepInput::nothing(now) };
        self.bench.step(&input, Budget::default())
    }

    fn advance(&mut self, command: &Vector6<f64>, dt: f64) {
        let omega = 2.0 * self.world.zeta / self.world.lag_s;
        self.qdd = (command - self.q) * (omega * omega) - self.qd * (2.0 * self.world.zeta * omega);
        self.qd += self.qdd * dt;
        self.q += self.qd * dt;
        self.absorbed += (self.give() - self.absorbed) * (dt / INTEGRAL_S);
        let wanted = self.pressed();
        self.force += (wanted - self.force) * 0.2;
        let size = self.force.norm();
        if size > 1.0 && self.touched_s.is_none() {
            self.touched_s = Some(self.time_s());
        }
        self.worst_n = self.worst_n.max(size);
    }

    /// Joints as they are, bent by what presses.
    fn bent(&self) -> Vector6<f64> {
        self.q + self.give() - self.absorbed
    }

    /// How far the force bends a servo without integral \[rad\].
    fn give(&self) -> Vector6<f64> {
        let mass = self.truth.mass_matrix(&self.q.into());
        let torque = self.pressing();
        Vector6::from_fn(|i, _| torque[i] / ((mass[(i, i)] + ROTOR) * SERVO_RADPS * SERVO_RADPS))
    }

    /// Jᵀ F \[Nm\].
    fn pressing(&self) -> Vector6<f64> {
        self.chain.forward(&self.q.into()).jacobian.fixed_rows::<3>(0).tr_mul(&self.force)
    }

    /// The force that things exert on the tip where it is, base frame \[N\].
    fn pressed(&self) -> Vector3<f64> {
        let t = self.time_s();
        if t < self.world.from_s {
            return Vector3::zeros();
        }
        let plane = self.bench.follower.settings().plane;
        let tip = plane.point_from_base(&self.chain.forward(&self.bent().into()).position);
        let in_plane = match self.world.thing {
            Thing::Nothing => Vector3::zeros(),
            Thing::Surface(height, stiffness) => Vector3::z() * ((height - tip.z).max(0.0) * stiffness),
            Thing::Wall(x, stiffness) => Vector3::x() * (-(tip.x - x).max(0.0) * stiffness),
            Thing::Push(force, lasts) if t < self.world.from_s + lasts => force,
            Thing::Push(..) => Vector3::zeros(),
        };
        plane.rotation * in_plane
    }

    /// As reported.
    fn effort(&mut self) -> [f64; 6] {
        let motion = self.truth.torque(&self.q.into(), &self.qd.into(), &self.qdd.into());
        let pressing = self.pressing();
        let World { friction, noise, unit, gain, .. } = self.world;
        std::array::from_fn(|i| {
            let dry = friction * (COULOMB[i] * (self.qd[i] / 0.005).tanh() + VISCOUS[i] * self.qd[i]);
            let gaussian: f64 = (0..12).map(|_| self.random.random_range(-0.5..0.5)).sum();
            let torque = motion[i] + ROTOR * self.qdd[i] + dry - pressing[i];
            let unit = match unit {
                EffortUnit::NewtonMetres => 1.0,
                EffortUnit::Amperes => 0.1,
                EffortUnit::Share => 1.0 / self.limits[i],
            };
            (torque + noise * self.limits[i] * gaussian) * unit * gain
        })
    }
}

/// Loops of 24 mm at up to 0.35 m/s in words of 1.6 s, and 0.5 s with the pen lifted on the way to the next.
fn hand(t: f64) -> ([f64; 2], bool) {
    let (word, within) = ((t / 2.1).floor(), t % 2.1);
    let start = |word: f64| [(word % 3.0 - 1.0) * 0.05, ((word / 3.0).floor() % 3.0 - 1.0) * 0.05];
    let written = |within: f64| {
        let [x0, y0] = start(word);
        let phase = within * 2.0 * std::f64::consts::PI * (1.6 + 0.3 * (word % 4.0));
        let along = 0.05 * within / 1.6 - 0.025;
        [x0 + along + 0.012 * phase.cos(), y0 + 0.012 * phase.sin()]
    };
    if within < 1.6 {
        return (written(within), true);
    }
    let ([x, y], [x0, y0]) = (written(1.6), start(word + 1.0));
    // From rest to rest.
    let share = (within - 1.6) / 0.5;
    let share = share * share * (3.0 - 2.0 * share);
    ([x + (x0 - 0.013 - x) * share, y + (y0 - y) * share], false)
}
