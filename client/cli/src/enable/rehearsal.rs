//! A dead-man switch from a key of the terminal, to rehearse with a simulated arm.
//!
//! Contract: refused, and ended, where the arm's process does not say that it is simulated: a terminal tells
//! no release of a key, so that the arm stops 0.7 s late. Otherwise as with a button.

use std::time::{Duration, Instant};

use foretrace_client::wire::arm_flags;
use foretrace_client::{Claimant, DeadMan, HolderKind, Place, Status};
use foretrace_tablet::{HoldSwitch, SwitchSignal};

use super::EnableArgs;
use crate::attach::{attach_within, unattached};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::note;
use crate::take_over::handed_over;
use crate::terminal::TypedKeys;

/// Longer than terminals wait before they repeat a key that is held.
const HELD: Duration = Duration::from_millis(700);
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// The daemon publishes its status ten times per second.
const PATIENCE: Duration = Duration::from_secs(2);

pub(super) fn run(args: &EnableArgs) -> Result<(), Failure> {
    let interrupt = Interrupt::listen()?;
    let foretrace = attach_within(&args.instance.instance()?, Duration::from_secs_f64(args.wait))?;
    let mut reader = foretrace.status().map_err(unattached)?;
    let status = reader
        .next_within(PATIENCE)
        .ok_or_else(|| Failure::failed("the daemon reports no status", "see `foretrace doctor`"))?;
    simulated(&status)?;
    let mut keys = TypedKeys::listen()
        .ok_or_else(|| Failure::usage("stdin is no terminal, which has the key", "start it in a terminal"))?;
    let who = Claimant::new(HolderKind::Button, "a key of a terminal, to rehearse");
    let mut dead_man = args.take_over.dead_man(&foretrace, &who).map_err(unattached)?;
    note!(
        "enable: hold any key, the space bar for example, to let the simulated arm move; it stops {:.1} s after \
         the release",
        HELD.as_secs_f64()
    );
    let (mut switch, mut shown, mut pressed) = (HoldSwitch::new(DeadMan::INTERVAL), None, None);
    let begin = Instant::now();
    // What was typed before is no wish to move.
    let _ = keys.pressed();
    switch.look(begin.elapsed(), Some(false));
    while !interrupt.is_set() {
        if keys.pressed().is_some() {
            pressed = Some(Instant::now());
        }
        let held = pressed.is_some_and(|since: Instant| since.elapsed() < HELD);
        let sent = match switch.look(begin.elapsed(), Some(held)) {
            SwitchSignal::Beat => dead_man.beat(),
            SwitchSignal::Stop => dead_man.stop(),
            _ => Ok(()),
        };
        if let Some(to) = dead_man.handed_to() {
            return Err(handed_over(Place::DeadMan, Some(to)));
        }
        sent.map_err(|error| Failure::failed(error, "start it again once the daemon runs"))?;
        reader.latest().map_or(Ok(()), simulated)?;
        let words = if switch.is_held() { "held" } else { "released" };
        if shown.replace(words) != Some(words) {
            note!("enable: {words}");
        }
        std::thread::sleep(LOOK_EVERY);
    }
    let _ = dead_man.stop();
    Ok(())
}

/// Only an arm whose process says so may be moved by a key of a terminal.
fn simulated(status: &Status) -> Result<(), Failure> {
    if status.arm_line.flags & arm_flags::SIMULATED != 0 {
        return Ok(());
    }
    let what = if status.joint_state_age_ns == u64::MAX {
        "no arm is there, and a key of a terminal moves a simulated one only"
    } else {
        "the arm's process does not say that it is simulated, and a key of a terminal is no dead-man for an arm \
         that moves"
    };
    Err(Failure::bad_input(what, "start `foretrace arm sim`, or use --device FILE --button NAME"))
}

#[cfg(test)]
mod tests {
    use foretrace_client::wire::ArmLine;

    use super::*;

    #[test]
    fn only_an_arm_that_is_said_to_be_simulated_is_moved_by_a_key() {
        let of = |flags| Status { arm_line: ArmLine { flags, ..ArmLine::default() }, ..Status::default() };
        assert!(simulated(&of(arm_flags::SIMULATED)).is_ok());
        assert!(simulated(&of(arm_flags::SIMULATED | arm_flags::WITHOUT_DEAD_MAN)).is_ok());
        for flags in [0, arm_flags::WITHOUT_DEAD_MAN] {
            let refused = simulated(&of(flags)).unwrap_err().to_string();
            assert!(refused.contains("simulated") && refused.contains("--device"), "{refused}");
        }
    }
}
