//! Touches as they happen: the pen by its samples, the tool by the measured joints and a word on the
//! terminal.

use std::io::BufRead;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::{Duration, Instant};

use foretrace_client::{Foretrace, JointWatch, Mode, PenWatch, StatusReader};
use nalgebra::Vector2;

use crate::attach::unattached;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::note;
use foretrace_calibrate::plane::{Mark, Still};

/// The pen rests within this for so long.
const PEN_M: f64 = 0.5e-3;
const PEN_REST_NS: u64 = 500_000_000;
/// The arm rests within this for so long.
const ARM_RAD: f64 = 0.5e-3;
const ARM_REST_NS: u64 = 300_000_000;
/// Longest wait for an arm that does not come to rest.
const PATIENCE: Duration = Duration::from_secs(10);
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// Bytes that are read at a time of what is typed.
const LINE_BYTES: u64 = 256;

/// Everything that is listened to.
pub(super) struct Listener<'a> {
    interrupt: &'a Interrupt,
    pen: PenWatch,
    joints: JointWatch,
    status: StatusReader,
    enters: Receiver<()>,
}

impl<'a> Listener<'a> {
    pub(super) fn open(foretrace: &Foretrace, interrupt: &'a Interrupt) -> Result<Self, Failure> {
        let (sender, enters) = sync_channel(4);
        let reads = move || {
            let mut input = std::io::stdin().lock();
            loop {
                // What is typed means nothing, and a line without an end is taken in pieces.
                let mut line = Vec::new();
                match std::io::Read::take(&mut input, LINE_BYTES).read_until(b'\n', &mut line) {
                    Ok(0) | Err(_) => return,
                    Ok(_) if line.last() != Some(&b'\n') => {}
                    Ok(_) if sender.send(()).is_err() => return,
                    Ok(_) => {}
                }
            }
        };
        std::thread::Builder::new()
            .name("calibrate-enter".to_owned())
            .spawn(reads)
            .map_err(|error| Failure::failed(format_args!("no thread can be started: {error}"), ""))?;
        Ok(Self {
            interrupt,
            pen: foretrace.pen_watch().map_err(unattached)?,
            joints: foretrace.joint_watch().map_err(unattached)?,
            status: foretrace.status().map_err(unattached)?,
            enters,
        })
    }

    /// One mark, touched by the pen and then by the tool.
    pub(super) fn mark(&mut self, number: usize, last: bool) -> Result<Mark, Failure> {
        let proof = if last { ", the proof: it is no part of the fit" } else { "" };
        note!("mark {number}{proof}: touch it with the pen and hold still");
        let [x, y] = self.pen_rests()?;
        note!("mark {number}: pen at {:.2}, {:.2} mm; lift it", x * 1e3, y * 1e3);
        note!("mark {number}: bring the tip of the tool onto the same mark, then press Enter");
        self.enter()?;
        Ok(Mark { pen: Vector2::new(x, y), q: self.arm_rests()? })
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
                Err(std::sync::mpsc::TryRecvError::Empty) => {}
                Err(std::sync::mpsc::TryRecvError::Disconnected) => {
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
        self.interrupt.check()?;
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
