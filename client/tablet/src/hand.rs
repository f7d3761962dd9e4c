//! The hand's own mapping: mirror, rotation, axis lock, scale, and the clutch.
//!
//! Contract: pure. While the clutch is held the hand moves and the pen that is sent stays, contact and
//! pressure included; when it is let go the pen goes on from where it stayed, whatever the hand and the scale
//! did meanwhile. Limits, envelope and monitor of the daemon know nothing of it.

use foretrace_client::PenReading;
use foretrace_client::wire::pen_flags;

/// An axis of the pen's plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlaneAxis {
    X,
    /// Away from the writer.
    Y,
}

/// How the hand's plane lies in the pen's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mapping {
    /// Pen metres per hand metre.
    pub scale: f64,
    /// Turned by this, counter-clockwise \[rad\]; after the mirror.
    pub rotation_rad: f64,
    /// Axes that are reversed, x and y.
    pub mirror: [bool; 2],
}

impl Default for Mapping {
    fn default() -> Self {
        Self { scale: 1.0, rotation_rad: 0.0, mirror: [false; 2] }
    }
}

impl Mapping {
    fn turned(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [mirror_x, mirror_y] = self.mirror;
        let (x, y) = (if mirror_x { -x } else { x }, if mirror_y { -y } else { y });
        let (sin, cos) = self.rotation_rad.sin_cos();
        [cos * x - sin * y, sin * x + cos * y]
    }

    fn of(&self, point_m: [f64; 2]) -> [f64; 2] {
        self.turned(point_m).map(|value| self.scale * value)
    }
}

/// The scale was to change while the hand leads: the pen would jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotClutched;

/// A hand with its mapping, clutch and lock.
#[derive(Debug, Clone, Default)]
pub struct MappedHand {
    mapping: Mapping,
    /// Added to what is mapped \[m\].
    offset_m: [f64; 2],
    /// What is sent while the clutch is held.
    stays: Option<PenReading>,
    /// Where the pen stayed \[m\], until the first reading after the clutch says where the hand is by then.
    anchor_m: Option<[f64; 2]>,
    clutched: bool,
    lock: Option<PlaneAxis>,
    /// The coordinate that the lock keeps \[m\].
    locked_m: Option<f64>,
    /// Hand \[m\] and reading of the last sample.
    last: Option<([f64; 2], PenReading)>,
}

impl MappedHand {
    /// A hand whose clutch is let go.
    #[must_use]
    pub fn new(mapping: Mapping) -> Self {
        Self { mapping, ..Self::default() }
    }

    /// What the daemon gets of a reading of the device.
    pub fn map(&mut self, device: PenReading) -> PenReading {
        let hand = [device.x_m, device.y_m];
        let reading = match self.stays {
            Some(stays) => PenReading { device_stamp_ns: device.device_stamp_ns, ..stays },
            None => self.led(device, hand),
        };
        // Held since before the first reading: this one is where the pen stays.
        if self.clutched {
            self.stays.get_or_insert(reading);
        }
        self.last = Some((hand, reading));
        reading
    }

    fn led(&mut self, device: PenReading, hand: [f64; 2]) -> PenReading {
        let mapped = self.mapping.of(hand);
        if let Some(anchor) = self.anchor_m.take() {
            self.offset_m = std::array::from_fn(|axis| anchor[axis] - mapped[axis]);
        }
        let mut at: [f64; 2] = std::array::from_fn(|axis| mapped[axis] + self.offset_m[axis]);
        if let Some(axis) = self.lock {
            at[axis as usize] = *self.locked_m.get_or_insert(at[axis as usize]);
        }
        let [x_m, y_m] = at;
        let tilt_rad = device.tilt_rad.map(|tilt| self.mapping.turned(tilt.map(f64::from)).map(|t| t as f32));
        PenReading { x_m, y_m, tilt_rad, ..device }
    }

    /// Holds the clutch, or lets it go.
    pub fn clutch(&mut self, held: bool) {
        match (self.clutched, held) {
            (false, true) => self.stays = self.last.map(|(_, reading)| reading),
            // The next reading continues where the pen stayed, wherever the hand has gone out of range.
            (true, false) => {
                self.anchor_m = self.stays.take().map(|stays| [stays.x_m, stays.y_m]).or(self.anchor_m);
            }
            _ => {}
        }
        self.clutched = held;
    }

    /// Whether the clutch is held.
    #[must_use]
    pub const fn is_clutched(&self) -> bool {
        self.clutched
    }

    /// Moves the pen further or less far for the same hand; takes effect when the clutch is let go.
    ///
    /// # Errors
    ///
    /// The clutch is not held.
    pub fn set_scale(&mut self, scale: f64) -> Result<(), NotClutched> {
        if !self.clutched {
            return Err(NotClutched);
        }
        self.mapping.scale = scale;
        Ok(())
    }

    /// The scale in force.
    #[must_use]
    pub const fn scale(&self) -> f64 {
        self.mapping.scale
    }

    /// Keeps one coordinate of the pen as it is, or none. When it is let go the pen goes on without a jump.
    pub fn lock(&mut self, axis: Option<PlaneAxis>) {
        if let (Some(old), Some(kept), Some((hand, _))) = (self.lock, self.locked_m, self.last) {
            self.offset_m[old as usize] = kept - self.mapping.of(hand)[old as usize];
        }
        self.lock = axis;
        self.locked_m = axis.and_then(|axis| {
            let (_, reading) = self.last?;
            Some([reading.x_m, reading.y_m][axis as usize])
        });
    }

    /// The pen left the range of its device: reported once, without a position.
    #[must_use]
    pub fn gone(&self, stamp_ns: u64) -> Option<PenReading> {
        let (_, reading) = self.last?;
        let more_flags = reading.more_flags & !(pen_flags::CONTACT | pen_flags::IN_RANGE);
        Some(PenReading { device_stamp_ns: stamp_ns, contact: false, more_flags, ..reading })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64, y_m: f64) -> PenReading {
        PenReading { x_m, y_m, contact: true, ..PenReading::default() }
    }

    fn position(reading: PenReading) -> [f64; 2] {
        [reading.x_m, reading.y_m]
    }

    fn near(a: [f64; 2], b: [f64; 2]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12)
    }

    #[test]
    fn mirror_rotation_and_scale_are_the_ones_worked_by_hand() {
        let mut hand = MappedHand::new(Mapping {
            scale: 2.0,
            rotation_rad: std::f64::consts::FRAC_PI_2,
            mirror: [true, false],
        });
        // (1, 2) mirrored is (-1, 2), turned left is (-2, -1), twice as large (-4, -2).
        let tilted = PenReading { tilt_rad: Some([0.1, 0.2]), ..at(1.0, 2.0) };
        let reading = hand.map(tilted);
        assert!(near(position(reading), [-4.0, -2.0]), "{reading:?}");
        let [tilt_x, tilt_y] = reading.tilt_rad.unwrap();
        assert!((tilt_x + 0.2).abs() < 1e-6 && (tilt_y + 0.1).abs() < 1e-6);
    }

    #[test]
    fn the_pen_stays_while_the_hand_moves_and_goes_on_without_a_jump() {
        let mut hand = MappedHand::new(Mapping::default());
        hand.map(at(0.01, 0.02));
        hand.clutch(true);
        for step in 0..100 {
            let lifted = PenReading { device_stamp_ns: step, contact: false, ..at(0.01 * step as f64, 0.3) };
            let reading = hand.map(lifted);
            assert_eq!((position(reading), reading.contact), ([0.01, 0.02], true));
            assert_eq!(reading.device_stamp_ns, step);
        }
        hand.clutch(false);
        assert!(near(position(hand.map(at(0.99, 0.3))), [0.01, 0.02]));
        // From there the hand leads again, as far as it moves.
        assert!(near(position(hand.map(at(1.0, 0.29))), [0.02, 0.01]));
    }

    #[test]
    fn a_hand_that_left_the_range_while_clutched_goes_on_without_a_jump_wherever_it_returns() {
        let mut hand = MappedHand::new(Mapping::default());
        hand.map(at(0.0, 0.0));
        hand.clutch(true);
        hand.map(at(0.0, 0.0));
        assert!(hand.gone(1).is_some());
        hand.clutch(false);
        assert!(near(position(hand.map(at(0.3, 0.0))), [0.0, 0.0]));
        assert!(near(position(hand.map(at(0.4, 0.1))), [0.1, 0.1]));
        // Clutched and let go again before any reading: the pen is still where it stayed.
        hand.clutch(true);
        hand.clutch(false);
        hand.clutch(true);
        hand.clutch(false);
        assert!(near(position(hand.map(at(-0.2, 0.5))), [0.1, 0.1]));
    }

    #[test]
    fn scale_changes_only_while_clutched_and_without_a_jump() {
        let mut hand = MappedHand::new(Mapping::default());
        hand.map(at(0.1, 0.1));
        assert_eq!(hand.set_scale(0.5), Err(NotClutched));
        assert!(near(position(hand.map(at(0.1, 0.1))), [0.1, 0.1]));
        hand.clutch(true);
        hand.set_scale(0.5).unwrap();
        assert!(near(position(hand.map(at(0.5, 0.5))), [0.1, 0.1]));
        hand.clutch(false);
        assert!(near(position(hand.map(at(0.5, 0.5))), [0.1, 0.1]));
        assert!(near(position(hand.map(at(0.6, 0.5))), [0.15, 0.1]));
    }

    #[test]
    fn a_lock_keeps_one_coordinate_and_lets_go_without_a_jump() {
        let mut hand = MappedHand::new(Mapping::default());
        hand.map(at(0.1, 0.1));
        hand.lock(Some(PlaneAxis::Y));
        assert!(near(position(hand.map(at(0.3, 0.4))), [0.3, 0.1]));
        hand.lock(None);
        assert!(near(position(hand.map(at(0.3, 0.4))), [0.3, 0.1]));
        assert!(near(position(hand.map(at(0.3, 0.5))), [0.3, 0.2]));
    }

    #[test]
    fn a_clutch_before_the_first_sample_invents_no_position() {
        let mut hand = MappedHand::new(Mapping::default());
        assert_eq!(hand.gone(5), None);
        hand.clutch(true);
        assert!(near(position(hand.map(at(0.2, 0.2))), [0.2, 0.2]));
        assert!(near(position(hand.map(at(0.5, 0.5))), [0.2, 0.2]));
        hand.clutch(false);
        assert!(near(position(hand.map(at(0.5, 0.5))), [0.2, 0.2]));
        let gone = hand.gone(7).unwrap();
        assert_eq!((gone.contact, gone.device_stamp_ns, gone.x_m), (false, 7, 0.2));
    }
}
