//! The way home: straight in joint space, slow, jerk-limited, checked before anything moves and monitored
//! during the motion.
//!
//! Phases: *checking* (the arm is held while its way is checked, a few points per tick), *moving*, *halting*
//! (lost time left the way: come to rest, then check again from there), *settling* (at home, until the
//! slowest arm allowed is there too). Near obstacles the motion stays on its way and slows down: gaps close
//! at a quarter of the rate that clearance allows. An arm held up for longer than a second is stopped.
//!
//! Contract: no allocation after construction, bounded work per tick. Absent: ways around obstacles; the
//! tool's envelope, which is not in force until the arm is armed, because the pen does not lead here.

#![expect(clippy::indexing_slicing, reason = "indices run over the joints, the length of every array")]

mod glide;
mod paper;

use crate::state::{choices, state};
use glide::{Glide, GlideLimits};
use paper::Paper;

use super::{CommandedArm, Mover};
use crate::arm::{Chain, JointLimits, velocity_box};
use crate::clearance::{Clearance, Inside, Obstructed, Way, WayCheck};
use crate::follower::FollowerSettings;
use crate::follower::io::{Health, HomeProgress, Refusal};
use crate::guard::{Commanded, StopProfile};
use crate::units::Stamp;

/// Limits of every joint: these, or this share of its own limits if that is less.
const GENTLE: GlideLimits = GlideLimits { velocity: 0.25, acceleration: 0.5, jerk: 2.0 };
const SHARE: f64 = 0.25;
/// Gaps close by this share of the rate that clearance allows.
const DAMPED: f64 = 0.25;
/// Speed comes back over this time \[s\].
const RECOVERY_S: f64 = 0.5;
/// Slower than this share of the pace for this long \[s\] counts as held up.
const HELD_SHARE: f64 = 0.02;
const HELD_S: f64 = 1.0;
/// Points of the way that are checked per second.
const LOOKS_HZ: f64 = 2000.0;
/// Joints farther than this from the way \[rad\] have left it.
const OFF_RAD: f64 = 1e-3;
/// Slower than this \[rad/s\] is at rest, up to rounding.
const AT_REST_RADPS: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum HomePhase {
    #[default]
    Over,
    Checking,
    Moving,
    Halting,
    Settling,
}

choices! { HomePhase { Over, Checking, Moving, Halting, Settling } }

/// Event of one tick of the way home.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(in crate::follower) enum HomeNews {
    #[default]
    None,
    /// The whole way is clear: it begins.
    Clear,
    /// Something stands in the way, and nothing has moved yet.
    Blocked(Obstructed),
    /// Something holds the arm up on its way.
    HeldUp(Obstructed),
    /// The arm is at home, even with the longest lag allowed.
    Arrived,
}

/// The way home of one arm.
#[derive(Debug, Clone)]
pub(super) struct Homing<const J: usize> {
    home: [f64; J],
    paces: [GlideLimits; J],
    clearance: Option<Clearance<J>>,
    paper: Paper,
    way: Way<J>,
    glide: Glide,
    phase: HomePhase,
    looks: u32,
    settle_ns: u64,
    /// Time along the way at its own pace \[s\]; current share of that pace; how long it has been held up
    /// \[s\].
    elapsed_s: f64,
    pace: f64,
    held_s: f64,
    /// The arm has moved since the request.
    underway: bool,
    arrived: Stamp,
}

state! {
    [const J: usize] Homing<J> {
        paper, way, glide, phase, looks, settle_ns, elapsed_s, pace, held_s, underway, arrived,
    }
    present { clearance }
    fixed { home, paces }
}

/// Limits of the joints on the way home.
fn paces<const J: usize>(limits: &JointLimits<J>) -> [GlideLimits; J] {
    let jerk = limits.jerk().copied().unwrap_or([f64::INFINITY; J]);
    std::array::from_fn(|j| GlideLimits {
        velocity: GENTLE.velocity.min(SHARE * limits.velocity()[j]),
        acceleration: GENTLE.acceleration.min(SHARE * limits.acceleration()[j].min(limits.deceleration()[j])),
        jerk: GENTLE.jerk.min(SHARE * jerk[j]),
    })
}

/// The way from `from` to `to` \[rad\] in time.
fn glide<const J: usize>(paces: &[GlideLimits; J], from: &[f64; J], to: &[f64; J]) -> Glide {
    let most = GlideLimits { velocity: f64::INFINITY, acceleration: f64::INFINITY, jerk: f64::INFINITY };
    let turns = from.iter().zip(to).map(|(from, to)| (to - from).abs());
    let limits = paces.iter().zip(turns).filter(|(_, turn)| *turn > 0.0).fold(most, |most, (pace, turn)| {
        GlideLimits {
            velocity: most.velocity.min(pace.velocity / turn),
            acceleration: most.acceleration.min(pace.acceleration / turn),
            jerk: most.jerk.min(pace.jerk / turn),
        }
    });
    Glide::within(&limits)
}

impl<const J: usize> FollowerSettings<J> {
    /// The way home from joints at `q` \[rad\]: the joint that turns farthest, by how much \[rad\], and how
    /// long it takes with nothing near \[s\]. `None` if a joint is non-finite.
    #[must_use]
    pub fn way_home(&self, q: &[f64; J]) -> Option<(usize, f64, f64)> {
        if !q.iter().all(|q| q.is_finite()) {
            return None;
        }
        let turns = q.iter().zip(&self.ik.home).map(|(q, home)| (home - q).abs());
        let (joint, turn) = turns.enumerate().max_by(|(_, a), (_, b)| a.total_cmp(b))?;
        Some((joint, turn, glide(&paces(&self.limits), q, &self.ik.home).seconds()))
    }
}

impl<const J: usize> Homing<J> {
    pub(super) fn new(settings: &FollowerSettings<J>, clearance: Option<Clearance<J>>) -> Self {
        let clearance = clearance.map(|clearance| clearance.damped(DAMPED));
        let period_s = settings.period_ns as f64 * 1e-9;
        Self {
            home: settings.ik.home,
            paces: paces(&settings.limits),
            way: Way::new(clearance.as_ref()),
            paper: Paper::new(settings),
            clearance,
            glide: Glide::OVER,
            phase: HomePhase::Over,
            looks: ((LOOKS_HZ * period_s).ceil() as u32).clamp(1, 64),
            settle_ns: settings.longest_lag_ns(),
            elapsed_s: 0.0,
            pace: 1.0,
            held_s: 0.0,
            underway: false,
            arrived: Stamp(0),
        }
    }

    /// Begins to check the way from `q`.
    fn check(&mut self, q: [f64; J]) {
        self.way.begin(q, self.home);
        self.paper.begin();
        self.glide = glide(&self.paces, &q, &self.home);
        (self.phase, self.elapsed_s, self.pace, self.held_s) = (HomePhase::Checking, 0.0, 1.0, 0.0);
    }

    /// Checks the next points of the way.
    fn look(&mut self, chain: &Chain<J>) -> HomeNews {
        for _ in 0..self.looks {
            let near =
                self.clearance.as_ref().map_or(WayCheck::Clear, |c| c.look_along(chain, &mut self.way));
            let low = self.paper.look(chain, &self.way);
            match if matches!(near, WayCheck::Blocked(_)) || low == WayCheck::Clear { near } else { low } {
                WayCheck::SoFar => {}
                WayCheck::Clear => {
                    self.phase = HomePhase::Moving;
                    self.underway = true;
                    return HomeNews::Clear;
                }
                WayCheck::Blocked(by) if self.underway => return HomeNews::HeldUp(by),
                WayCheck::Blocked(by) => return HomeNews::Blocked(by),
            }
        }
        HomeNews::None
    }
}

impl<const N: usize, const J: usize> Mover<N, J> {
    /// Takes charge of an arm that stands at `q` to move it home.
    ///
    /// # Errors
    ///
    /// A joint stands outside its limits.
    pub(in crate::follower) fn seed_home(&mut self, now: Stamp, q: &[f64; J]) -> Result<(), Refusal> {
        let position = self.guard.limits().position();
        let outside = |(q, [low, high]): (&f64, &[f64; 2])| !(q >= low && q <= high);
        if q.iter().zip(position).any(outside) || self.homing.home.iter().zip(position).any(outside) {
            return Err(Refusal::OutsideJointLimits);
        }
        let start = now.max(self.issued);
        let command = Commanded::at_rest(start, *q).ok_or(Refusal::OutsideJointLimits)?;
        self.ik.bind(false);
        self.plan_start = None;
        self.held = Some(CommandedArm::new(command, start + self.valid_ns, self.chain.forward(q)));
        self.kept = None;
        self.resynchronise();
        self.arm = self.tool;
        self.homing.underway = false;
        self.homing.check(*q);
        Ok(())
    }

    /// How far the way home is.
    pub(in crate::follower) fn home_progress(&self) -> HomeProgress {
        let Homing { phase, glide, elapsed_s, .. } = &*self.homing;
        HomeProgress {
            moving: !matches!(phase, HomePhase::Checking | HomePhase::Over),
            share: if *phase == HomePhase::Checking { 0.0 } else { glide.share(*elapsed_s) },
            left_s: (glide.seconds() - elapsed_s).max(0.0),
        }
    }

    /// One tick of the way home: the joint velocities to it \[rad/s\], `None` to stand or come to rest, and
    /// what came of it.
    pub(super) fn homeward(&mut self, start: Stamp, health: &mut Health) -> (Option<[f64; J]>, HomeNews) {
        let Some(held) = &self.held else { return (None, HomeNews::None) };
        let homing = &mut self.homing;
        match homing.phase {
            HomePhase::Over => (None, HomeNews::None),
            HomePhase::Checking => (None, homing.look(&self.chain)),
            HomePhase::Halting => {
                if StopProfile::is_done(&held.command) {
                    homing.check(*held.command.q());
                }
                (None, HomeNews::None)
            }
            HomePhase::Settling => {
                let there =
                    start.since(homing.arrived) >= i64::try_from(homing.settle_ns).unwrap_or(i64::MAX);
                (None, if there { HomeNews::Arrived } else { HomeNews::None })
            }
            HomePhase::Moving => self.move_on(start, health),
        }
    }

    fn move_on(&mut self, start: Stamp, health: &mut Health) -> (Option<[f64; J]>, HomeNews) {
        let (Some(held), homing) = (&self.held, &mut self.homing) else { return (None, HomeNews::None) };
        let (q, h) = (held.command.q(), self.period_s);
        let here = homing.way.at(homing.glide.share(homing.elapsed_s));
        if q.iter().zip(&here).any(|(q, here)| !((q - here).abs() <= OFF_RAD)) {
            homing.phase = HomePhase::Halting;
            return (None, HomeNews::None);
        }
        let rests = held.command.qd().iter().all(|qd| qd.abs() <= AT_REST_RADPS);
        if homing.elapsed_s >= homing.glide.seconds() && rests {
            (homing.phase, homing.arrived) = (HomePhase::Settling, start);
            return (None, HomeNews::None);
        }
        let towards = |homing: &Homing<J>, pace: f64| {
            let mut qd = homing.way.at(homing.glide.share(homing.elapsed_s + pace * h));
            qd.iter_mut().zip(q).for_each(|(qd, q)| *qd = (*qd - q) / h);
            qd
        };
        let motion = held.command.motion();
        let wanted = towards(homing, 1.0);
        let mut kept: f64 = 1.0;
        if let Some(clearance) = &mut homing.clearance {
            let allowed = velocity_box(motion, self.guard.limits(), h);
            clearance.rows(&held.kinematics, motion, &allowed, h, Inside::Stay);
            kept = clearance.share_kept(&wanted);
        }
        homing.pace = kept.min(homing.pace + h / RECOVERY_S).clamp(0.0, 1.0);
        if homing.pace < 1.0 {
            health.set(Health::CLEARANCE);
        }
        homing.held_s = if homing.pace < HELD_SHARE { homing.held_s + h } else { 0.0 };
        if homing.held_s > HELD_S {
            let nearest = homing.clearance.as_ref().and_then(|c| c.nearest_pair(&held.kinematics));
            let (pair, distance_m) = nearest.unwrap_or((u16::MAX, 0.0));
            let share = homing.glide.share(homing.elapsed_s);
            return (None, HomeNews::HeldUp(Obstructed { pair, share, distance_m }));
        }
        let qd = towards(homing, homing.pace);
        homing.elapsed_s += homing.pace * h;
        (Some(qd), HomeNews::None)
    }

    /// Accounts for `lost_ns` of lost time: the consumer went on along the way as the last command said, or
    /// left it.
    pub(super) fn miss_home(&mut self, lost_ns: u64) {
        if self.homing.phase != HomePhase::Moving {
            return;
        }
        if lost_ns <= self.valid_ns {
            self.homing.elapsed_s += self.homing.pace * (lost_ns as f64 * 1e-9);
        } else {
            self.homing.phase = HomePhase::Halting;
        }
    }

    /// Ends the way home, wherever the arm is.
    pub(in crate::follower) fn leave_home(&mut self) {
        self.homing.phase = HomePhase::Over;
    }
}
