//! Touches as they happen: the pen by its samples, the tool by the measured joints and a word on the
//! terminal.

use std::sync::mpsc::{Receiver, TryRecvError};
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, JointWatch, Mode, PenWatch, StatusReader};
use foretrace_failure::Failure;
use foretrace_report::failures::unattached;
use nalgebra::Vector2;

use super::{Still, TouchMark};
use foretrace_report::Tell;

/// The pen rests within this for so long.
const PEN_M: f64 = 0.5e-3;
const PEN_REST_NS: u64 = 500_000_000;
/// The arm rests within this for so long.
const ARM_RAD: f64 = 0.5e-3;
const ARM_REST_NS: u64 = 300_000_000;
/// Longest wait for an arm that does not come to rest.
const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Everything that is listened to.
pub struct TouchListener<'a> {
    interrupted: &'a dyn Fn() -> bool,
    tell: Tell<'a>,
    pen: PenWatch,
    joints: JointWatch,
    status: StatusReader,
    enters: Receiver<()>,
}

impl<'a> TouchListener<'a> {
    /// `enters` brings every Enter of the terminal.
    ///
    /// # Errors
    ///
    /// The daemon has no slot for one of the readers.
    pub fn open(
        foretrace: &Foretrace,
        enters: Receiver<()>,
        interrupted: &'a dyn Fn() -> bool,
        tell: Tell<'a>,
    ) -> Result<Self, Failure> {
        Ok(Self {
            pen: foretrace.pen_watch().map_err(unattached)?,
            joints: foretrace.joint_watch().map_err(unattached)?,
            status: foretrace.status().map_err(unattached)?,
            interrupted,
            tell,
            enters,
        })
    }

    /// One mark, touched by the pen and then by the tool.
    ///
    /// # Errors
    ///
    /// Somebody asked to end, the terminal has ended, the arm does not rest, or the loop has it.
    pub fn mark(&mut self, number: usize, last: bool) -> Result<TouchMark, Failure> {
        let proof = if last { ", the proof: it is no part of the fit" } else { "" };
        (self.tell)(&format!("mark {number}{proof}: touch it with the pen and hold still"));
        let [x, y] = self.pen_rests()?;
        (self.tell)(&format!("mark {number}: pen at {:.2}, {:.2} mm; lift it", x * 1e3, y * 1e3));
        (self.tell)(&format!(
            "mark {number}: bring the tip of the tool onto the same mark, then press Enter"
        ));
        self.enter()?;
        Ok(TouchMark { pen: Vector2::new(x, y), q: self.arm_rests()? })
    }

    fn pen_rests(&mut self) -> Result<[f64; 2], Failure> {
        let mut still = Still::new(PEN_M, PEN_REST_NS);
        // Lifted before, so that one touch is not taken for two.
        let (mut lifted, mut rest) = (false, None);
        self.pen.drain(|_| {});
        while rest.is_none() {
            self.look()?;
            self.pen.drain(|sample| {
                if !sample.contact() {
                    lifted = true;
                    still.moved();
                } else if lifted && rest.is_none() {
                    rest = still.take(sample.device_stamp_ns, [sample.x_m, sample.y_m]);
                }
            });
        }
        rest.ok_or_else(|| Failure::failed("the pen was lost", "touch the mark again"))
    }

    fn enter(&mut self) -> Result<(), Failure> {
        while self.enters.try_recv().is_ok() {}
        loop {
            self.look()?;
            match self.enters.try_recv() {
                Ok(()) => return Ok(()),
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => {
                    return Err(Failure::usage(
                        "standard input has ended, so no Enter can come",
                        "run it on a terminal, or give the marks with --touches FILE",
                    ));
                }
            }
        }
    }

    fn arm_rests(&mut self) -> Result<[f64; 6], Failure> {
        let mut still = Still::new(ARM_RAD, ARM_REST_NS);
        let (begin, mut rest) = (Instant::now(), None);
        self.joints.drain(|_| {});
        while rest.is_none() && begin.elapsed() < PATIENCE {
            self.look()?;
            self.joints.drain(|state| {
                if rest.is_none() {
                    rest = still.take(state.header.stamp_ns, state.q);
                }
            });
        }
        rest.ok_or_else(|| {
            Failure::failed(
                format_args!("the arm did not rest within {} s, or reports nothing", PATIENCE.as_secs()),
                "see `foretrace status`; hold the arm still and begin again",
            )
        })
    }

    /// A pause, in which the arm must stay the person's.
    fn look(&mut self) -> Result<(), Failure> {
        if (self.interrupted)() {
            return Err(Failure::interrupted("interrupted", ""));
        }
        std::thread::sleep(LOOK_EVERY);
        let mode = self.status.latest().and_then(|status| Mode::try_from(status.mode).ok());
        match mode {
            None | Some(Mode::Idle | Mode::Stopped | Mode::Fault) => Ok(()),
            Some(mode) => Err(Failure::failed(
                format_args!("the loop has the arm ({mode}): the pen would move it"),
                "give it back with `foretrace request disarm`, and move it by hand",
            )),
        }
    }
}
