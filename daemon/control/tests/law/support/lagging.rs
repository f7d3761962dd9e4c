//! Handwriting-like joint commands, and arms with different kinds of lag.

use std::collections::VecDeque;
use std::f64::consts::TAU;

use rand::{Rng, RngExt};

/// Kind of lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// By a dead time \[s\].
    Delay(f64),
    /// By a dead time, then a second-order filter of a group delay and damping.
    Servo { delay: f64, filter: f64, damping: f64 },
    /// By a first-order filter of this time constant \[s\].
    First(f64),
}

/// A critically damped servo of this group delay behind a cycle of 2 ms, as a UR's.
pub(crate) const fn servo(filter: f64) -> Kind {
    Kind::Servo { delay: 0.002, filter, damping: 1.0 }
}

impl Kind {
    /// Group delay at low frequency \[s\].
    pub(crate) fn group_delay_s(self) -> f64 {
        match self {
            Self::Delay(delay) => delay,
            Self::Servo { delay, filter, .. } => delay + filter,
            Self::First(tau) => tau,
        }
    }
}

/// Commands are made this often \[s\].
pub(crate) const TICK_S: f64 = 0.002;
/// Steps of integration per tick.
const FINE: usize = 20;
/// Commands remembered.
const KEPT: usize = 400;

/// An arm of `J` joints; commands and joints are linear between ticks.
#[derive(Debug, Clone)]
pub(crate) struct Arm<const J: usize> {
    pub(crate) kind: Kind,
    /// Newest first.
    commands: VecDeque<[f64; J]>,
    position: [f64; J],
    velocity: [f64; J],
}

impl<const J: usize> Arm<J> {
    pub(crate) fn at_rest(kind: Kind, q: [f64; J]) -> Self {
        Self { kind, commands: vec![q; KEPT].into(), position: q, velocity: [0.0; J] }
    }

    /// One tick: `command` holds now; where the joints are now.
    pub(crate) fn obey(&mut self, command: [f64; J]) -> [f64; J] {
        self.commands.push_front(command);
        self.commands.truncate(KEPT);
        let dt = TICK_S / FINE as f64;
        for fine in 0..FINE {
            // Middle of the fine step, back from now.
            let back = TICK_S - (fine as f64 + 0.5) * dt;
            for j in 0..J {
                let (q, qd) = (self.position[j], self.velocity[j]);
                (self.position[j], self.velocity[j]) = match self.kind {
                    Kind::Delay(delay) => (self.commanded(delay, j), 0.0),
                    Kind::Servo { delay, filter, damping } => {
                        let w = 2.0 * damping / filter;
                        let target = self.commanded(delay + back, j);
                        let qd = qd + dt * (w * w * (target - q) - 2.0 * damping * w * qd);
                        (q + dt * qd, qd)
                    }
                    Kind::First(tau) => (q + dt * (self.commanded(back, j) - q) / tau, 0.0),
                };
            }
        }
        self.position
    }

    /// The command that held `ago` seconds before now.
    fn commanded(&self, ago: f64, j: usize) -> f64 {
        let ticks = ago / TICK_S;
        let part = ticks.fract();
        let at = |i: usize| self.commands[i.min(KEPT - 1)][j];
        at(ticks as usize) * (1.0 - part) + at(ticks as usize + 1) * part
    }
}

/// Six joints that write: sums of sines of 0.3 to 6 Hz whose speed falls with frequency, with pauses between
/// words.
#[derive(Debug, Clone)]
pub(crate) struct Writing {
    waves: Vec<[[f64; 3]; 12]>,
    /// Time of the hand's own motion, which stops between words, and of the day \[s\].
    phase: f64,
    t: f64,
    word: f64,
}

impl Writing {
    pub(crate) fn new(rng: &mut impl Rng) -> Self {
        let mut wave = || {
            let hz: f64 = 0.3 * 20f64.powf(rng.random_range(0.0..1.0));
            [TAU * hz, rng.random_range(0.0..TAU), rng.random_range(0.3..1.0) * 0.012 / (1.0 + hz)]
        };
        let waves = (0..6).map(|_| std::array::from_fn(|_| wave())).collect();
        Self { waves, phase: 0.0, t: 0.0, word: rng.random_range(1.5..4.0) }
    }

    /// Joints after `dt` more seconds; the hand rests for 0.3 s after every word.
    pub(crate) fn after(&mut self, dt: f64) -> [f64; 6] {
        self.t += dt;
        let resting = (self.t % (self.word + 0.6) - self.word - 0.3).abs();
        self.phase += dt * ((resting - 0.15) / 0.15).clamp(0.0, 1.0);
        std::array::from_fn(|j| {
            let sum = |[w, phase, amplitude]: &[f64; 3]| amplitude * ((w * self.phase + phase).sin());
            -0.2 * j as f64 + self.waves[j].iter().map(sum).sum::<f64>()
        })
    }
}
