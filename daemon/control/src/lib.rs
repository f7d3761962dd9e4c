//! The control law of foretrace as pure mathematics: pen samples in, a legal joint command out.
//!
//! Contract: no clock, thread, file, socket, shared memory or log is reachable from here. Time is an
//! argument. The same build and inputs give the same outputs, bit for bit. Modules stand in order of
//! dependence: each names only those before it. A tick runs in the order below.
//!
//! # One tick
//!
//! [`follower::Follower::step`] reads as the list of its stages: *watch* and *monitor* (is the arm where it
//! was commanded to be?), *pen* (samples onto the grid), *predict*, *estimate* (how good past previews were,
//! and what samples newer than the grid change), *trust* (how much of the preview to use), *reference*,
//! *plan* ([`mpc`]), *solve* ([`ik`] with the rows of [`clearance`] and [`envelope`]), *guard* (and the
//! envelope's judge), *record* (what the tick came to, for the next one), *report*.
//!
//! ```
//! # include!(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/ur5/settings.in"));
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use foretrace_control::follower::{Budget, Follower, JointReading, NoClock, Request, StepInput};
//! use foretrace_control::pen::PenReading;
//! use foretrace_control::predict::{ModelSettings, Networks};
//! use foretrace_control::units::Stamp;
//!
//! // A UR5 above a table, at 500 Hz: `daemon/control/examples/ur5/settings.in`. Its horizon is 10 steps.
//! let models = Models::new(ModelSettings::preset(STEP_NS), Networks::default())?;
//! let mut follower = Follower::<10, 6>::new(settings(PredictorKind::MIXTURE, models))?;
//! let mut arm = JointReading { stamp: Stamp(0), q: HOME, qd: [0.0; 6], motion_allowed: true };
//! for tick in 1..500 {
//!     let now = Stamp(tick * PERIOD_NS);
//!     // The hand draws a line at 40 mm/s; the arm is where it was commanded to be.
//!     let pen = [PenReading::new(now, [8e-5 * tick as f64, 0.0], true)];
//!     let joints = JointReading { stamp: now, ..arm };
//!     let request = (tick == 1).then_some(Request::Arm);
//!     let input = StepInput { pen: &pen, joints: Some(&joints), request, ..StepInput::nothing(now) };
//!     let output = follower.step(&input, Budget::default(), &mut NoClock);
//!     let Some(command) = output.command else { continue };
//!     (arm.q, arm.qd) = (command.q, command.qd);
//!     println!("{:?} -> tool at {:?} m, trust {}", command.q, output.tool, output.trust.alpha.alpha());
//! }
//! # assert!(arm.q.iter().zip(&HOME).any(|(q, home)| (q - home).abs() > 0.01), "it has moved");
//! # Ok(())
//! # }
//! ```
//!
//! # The two problems
//!
//! The plan, per axis of the writing plane, over the jerks ũ of N steps ([`mpc::cost`]; Agravante et al.
//! 2018, section 2):
//!
//! ```text
//!   min over ũ:  ½ (1 − α) ‖G_c (x_c − x̃)‖²  +  ½ α ‖G_f (g − x̃)‖²  +  ½ β ‖ũ‖²
//!   where        x̃ = Ã x₀ + B̃ ũ     position, velocity, acceleration of the next N steps
//!   within       |ũ| ≤ jerk;  |acceleration|, |velocity| ≤ limits and position inside the workspace,
//!                each by an exact penalty
//! ```
//!
//! The joints, for the first step of that plan (cost in [`ik::task`], box and rows gathered in [`ik`],
//! solvers in [`qp`]):
//!
//! ```text
//!   min over q̇:  ½ ‖J(q) q̇ − v*‖²_W  +  ½ λ ‖q̇‖²  +  posture
//!   within       the velocity box of every joint (arm::limits), rows of clearance and of the tool's envelope
//! ```
//!
//! # Glossary
//!
//! - α, *trust*: how much of the preview the plan follows, in \[0, 1\]; it moves by a ramp only ([`trust`]).
//! - *share* s: how far of its way a preview is followed, per lead, from past ones ([`estimate`]).
//! - *grid*, Δ: the uniform steps (10 ms) onto which pen samples are interpolated; *tick*, dt: the period of
//!   the loop (2 ms).
//! - *lead*: grid steps from the newest closed one to a prediction. *Preview*: predictions at all leads.
//!   *Band*: the radius around a prediction in which the pen is expected in nine of ten cases.
//! - *Hold*: the predictor of a pen at rest; what remains of the plan at α = 0, that is *feedback alone*.
//! - *dead time* τ: how far ahead references look because the arm lags; it follows the measured lag
//!   ([`arm::lag`]).
//! - *record*: errors of past previews per lead, with forgetting. *Pending*: not judged yet, as the outcome
//!   is unknown. *Onset*: the first steps of motion after rest. *Governor* κ: shortens the way of an arm that
//!   is *saturated* (joints, acceleration or speed at a limit) without gain.
//! - *candidate*, *live* weights: those that learn, and those that the loop uses; *promotion* copies the
//!   first to the second, *rollback* undoes it ([`learn`]).
//! - *ladder*: fresh plan, previous plan, stop, hold ([`follower::Rung`]); each *rung* makes a command when
//!   the one above it cannot.
//! - *envelope*: where the tool must stay (height, workspace, tilt, speed). *Clearance*: distance of the arm
//!   from planes, boxes and itself. *Row*: one linear inequality of the QP; it is *held* if active, and
//!   *yields* if it cannot be satisfied.
//! - *guard*: the last stage; its output is legal whatever its input. *Monitor*: judges the arm, not the
//!   plan.
//! - *stale*: older than allowed. *Silent*: a pen without new samples. *Latched*: a stop that only an
//!   operator's arm request ends. *Ghost*: the same law at α = 0 beside the loop, for comparison.

#![warn(missing_docs)]
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::indexing_slicing,
        clippy::unreachable
    )
)]

pub mod state;
mod history;
pub mod units;
pub mod plane;
pub mod geometry;
pub mod stop;
pub mod pen;
pub mod predict;
pub mod learn;
pub mod estimate;
pub mod trust;
mod reference;
pub mod arm;
pub mod qp;
pub mod mpc;
pub mod envelope;
pub mod clearance;
pub mod ik;
pub mod guard;
pub mod monitor;
pub mod contact;
pub mod follower;
pub mod ghost;
pub mod extent;
