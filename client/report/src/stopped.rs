//! A latched stop in words: the reason, its evidence, the setting that bounds it, and the remedy.

use foretrace_client::Status;
use foretrace_client::wire::{FaultReason, StopDetail};

/// From this share of time in which some program waited for a CPU the machine is called busy \[%\].
const BUSY_PERCENT: f64 = 20.0;

/// Reason and evidence, one line without a full stop: `tracking error: joint 3 is 0.213 rad from ...`.
pub fn reason(fault: FaultReason, detail: &StopDetail) -> String {
    let name = match fault {
        FaultReason::None => FaultReason::Requested.label(),
        other => other.label(),
    };
    let evidence = detail.to_string();
    if evidence.is_empty() { name.to_owned() } else { format!("{name}: {evidence}") }
}

/// What to do about it, and the settings that bound it; of what comes from a lack of CPU, how busy this
/// machine is.
pub fn remedy(fault: FaultReason) -> String {
    let waited = match fault {
        FaultReason::JointStateStale | FaultReason::TimeLost | FaultReason::Overruns => waited_percent(),
        _ => None,
    };
    match waited.filter(|waited| *waited >= BUSY_PERCENT) {
        Some(waited) => format!(
            "{}. This machine is busy: programs waited for a CPU {waited:.0} % of the last 10 s",
            what_to_do(fault)
        ),
        None => what_to_do(fault).to_owned(),
    }
}

/// Share of the last 10 s in which some program waited for a CPU \[%\], where the kernel tells it.
fn waited_percent() -> Option<f64> {
    some_waited(&std::fs::read_to_string("/proc/pressure/cpu").ok()?)
}

/// Of a file of pressure stall information (`Documentation/accounting/psi.rst` of Linux).
fn some_waited(text: &str) -> Option<f64> {
    let words = text.lines().find_map(|line| line.strip_prefix("some "))?;
    words.split_whitespace().find_map(|word| word.strip_prefix("avg10=")?.parse().ok())
}

/// Why an arm is stopped, and what to do about it: in the words of the arm's process, where it says why.
pub fn explained(status: &Status) -> (String, String) {
    let fault = FaultReason::try_from(status.fault).unwrap_or(FaultReason::Internal);
    let of_the_arm = matches!(fault, FaultReason::RobotStopped | FaultReason::JointStateStale);
    let note = of_the_arm.then(|| status.note.text()).flatten();
    match note {
        Some(text) => {
            let to_do = status.note.to_do().map_or(String::new(), |to_do| format!("{to_do}; "));
            (format!("{}: {text}", fault.label()), format!("{to_do}then `foretrace request arm`"))
        }
        None => (reason(fault, &status.stop), remedy(fault)),
    }
}

/// How long an arm's process got no CPU, in words.
pub fn starved(ns: u64) -> String {
    format!("{STARVED} {:.0} ms", ns as f64 * 1e-6)
}

/// How these words begin.
pub const STARVED: &str = "this machine was too busy for the simulated arm for";

const fn what_to_do(fault: FaultReason) -> &'static str {
    match fault {
        FaultReason::None | FaultReason::Requested => {
            "an operator requested it: `foretrace request arm` goes on"
        }
        FaultReason::TimeLost => {
            "the machine stood still for longer than safety.latch_after_ms: find what held it up with \
             `foretrace doctor`, then arm again"
        }
        FaultReason::JointStateStale => {
            "no joint state came for longer than safety.joint_state_timeout_ms: look at the arm's process, \
             then arm again"
        }
        FaultReason::RobotStopped => {
            "the arm's own safety system stopped it: clear that at the arm, then arm again"
        }
        FaultReason::TrackingError => {
            "the arm did not follow its commands (bounds: safety.tracking): find what holds, slows or \
             drives it (brake, speed slider, another program), then disarm and arm again"
        }
        FaultReason::DeadMan => {
            "the dead-man switch was released or silent for longer than safety.enable_timeout_ms: hold it, \
             then arm again"
        }
        FaultReason::Overruns => {
            "the loop cannot keep its rate on this machine (bounds: safety.late_ticks_max, \
             safety.late_ticks_window_ms): lower loop.rate_hz, set mpc.backend and ik.backend to \"exact\", \
             or see `foretrace doctor`; then arm again"
        }
        FaultReason::Envelope => {
            "the tool would have left its height, workspace, tilt or speed (bounds: safety.envelope): look \
             at plane.workspace_m and mpc.limits, then arm again; `foretrace move home` brings it back"
        }
        FaultReason::WayBlocked => {
            "the arm came too near something on its way home (bounds: clearance): move it by hand, or take \
             that away"
        }
        FaultReason::Contact => {
            "the arm's joints bear more than their motion needs (bounds: safety.contact): look at what it \
             touches, at plane.origin_m and at its load; then arm again"
        }
        FaultReason::Internal => {
            "see the daemon's messages (its terminal, or `journalctl -u foretraced`), and report them"
        }
    }
}

#[cfg(test)]
mod tests {
    use foretrace_client::wire::{NoteWords, StopCause};

    use super::*;

    /// A key that a remedy names is a key of the settings, or a section of them.
    #[test]
    fn every_key_of_a_remedy_exists() {
        let settings = foretrace_config::Config::preset("ur5").unwrap().render();
        let mut named = 0;
        for fault in FaultReason::ALL {
            for word in what_to_do(*fault).split(|c: char| !(c.is_alphanumeric() || "._".contains(c))) {
                let Some((section, key)) = word.rsplit_once('.').filter(|(_, key)| !key.is_empty()) else {
                    continue;
                };
                named += 1;
                let whole =
                    settings.contains(&format!("\n[{word}]")) || settings.contains(&format!("\n[{word}."));
                let of_section = settings
                    .split(&format!("\n[{section}]\n"))
                    .nth(1)
                    .map_or("", |rest| rest.split("\n[").next().unwrap_or(rest));
                let there = of_section
                    .lines()
                    .any(|line| line.trim_start_matches("# ").starts_with(&format!("{key} =")));
                assert!(whole || there, "{word}");
            }
        }
        assert!(named >= 8, "only {named} keys were found");
    }

    #[test]
    fn the_kernel_says_how_busy_a_machine_is() {
        let text = "some avg10=50.22 avg60=66.58 avg300=81.49 total=18626363271\nfull avg10=0.00 avg60=0.00 \
                    avg300=0.00 total=0\n";
        assert_eq!(some_waited(text), Some(50.22));
        for other in ["", "some", "full avg10=3.00", "some avg10=x avg60=1"] {
            assert_eq!(some_waited(other), None, "{other}");
        }
    }

    #[test]
    fn what_the_arm_s_process_says_takes_the_place_of_the_general_words() {
        let note = NoteWords::new("speed scaling is at 50 %", "set the speed slider to 100 %");
        let status = Status { fault: FaultReason::RobotStopped.into(), note, ..Status::default() };
        let (why, to_do) = explained(&status);
        assert!(why.ends_with(": speed scaling is at 50 %"), "{why}");
        assert_eq!(to_do, "set the speed slider to 100 %; then `foretrace request arm`");
        let silent = Status { note: NoteWords::default(), ..status };
        assert_eq!(explained(&silent).1, remedy(FaultReason::RobotStopped));
        // Of another stop it is not the reason.
        let other = Status { fault: FaultReason::DeadMan.into(), ..status };
        assert_eq!(explained(&other).1, remedy(FaultReason::DeadMan));
    }

    #[test]
    fn every_reason_has_words_and_a_remedy() {
        let detail = StopDetail {
            cause: StopCause::JointDeviation.into(),
            joint: 3,
            amount: 0.213,
            limit: 0.05,
            at_ns: 1,
        };
        for fault in FaultReason::ALL {
            assert!(!remedy(*fault).is_empty());
            let (bare, told) = (reason(*fault, &StopDetail::NONE), reason(*fault, &detail));
            assert!(!bare.contains(':') && told.starts_with(&bare), "{bare} / {told}");
            assert!(told.contains("joint 3 is 0.213 rad") && told.contains("limit 0.050 rad"), "{told}");
        }
    }
}
