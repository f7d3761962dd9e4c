//! What each fact means, and what to do about it.

use foretrace_client::JOINTS;
use foretrace_config::{Config, Settings};

use super::super::check::{self, Series};
use super::{Facts, Finding, Grade, Modes, Port, RegisterFact, Timing};

const SERVICES: &str = "on the pendant: Settings, Security, Services";
const INBOUND: &str = "Settings, Security, General: inbound access";

pub(super) fn all(facts: &Facts, config: &Config) -> Vec<Finding> {
    let (settings, position) = (config.settings(), config.robot().limits.position());
    let mut found = vec![
        port("rtde (30004)", &facts.rtde, "RTDE", Grade::Bad),
        port("primary (30001)", &facts.primary, "Primary Client Interface", Grade::Bad),
        port("dashboard (29999)", &facts.dashboard, "Dashboard Server", Grade::Fair),
        version(facts, settings),
        remote(facts),
    ];
    match &facts.modes {
        Some(modes) => found.extend([robot(modes), safety(modes), program(modes), speed(modes)]),
        None => found.push(unseen("robot", "nothing came over RTDE")),
    }
    found.extend(installation(facts, settings, position));
    found.extend([
        registers(facts, settings),
        line(facts.timing.as_ref()),
        round_trip(facts.timing.as_ref()),
        calibration(facts, config),
        dead_man(facts, settings),
    ]);
    found
}

fn good(name: &'static str, value: impl Into<String>) -> Finding {
    Finding { name, grade: Grade::Good, value: value.into(), fix: String::new() }
}

fn poor(name: &'static str, grade: Grade, value: impl Into<String>, fix: impl Into<String>) -> Finding {
    Finding { name, grade, value: value.into(), fix: fix.into() }
}

fn fair(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Finding {
    poor(name, Grade::Fair, value, fix)
}

fn bad(name: &'static str, value: impl Into<String>, fix: impl Into<String>) -> Finding {
    poor(name, Grade::Bad, value, fix)
}

fn unseen(name: &'static str, why: &str) -> Finding {
    fair(name, format!("not known: {why}"), "put right what stands above, then run again")
}

fn port(name: &'static str, port: &Port, service: &str, grade: Grade) -> Finding {
    match port {
        Port::Open(words) => good(name, words.clone()),
        Port::Untried => unseen(name, "not tried"),
        Port::Refused => poor(
            name,
            grade,
            "refuses the connection",
            format!("{SERVICES}: enable {service}; then {INBOUND} must not list this port (CB3: restart it)"),
        ),
        Port::Silent(why) => poor(
            name,
            grade,
            format!("no answer: {why}"),
            format!("check cable, address and power; a firewall, or {INBOUND}, may drop what is sent there"),
        ),
        Port::Strange(what) => poor(
            name,
            grade,
            format!("answers strangely: {what}"),
            "is this host a Universal Robots controller? Restart it if it is",
        ),
    }
}

fn version(facts: &Facts, settings: &Settings) -> Finding {
    const NAME: &str = "version";
    let Some(version) = facts.version else { return unseen(NAME, "no version came over RTDE") };
    let series = match Series::of(version) {
        Ok(series) => series,
        Err(refusal) => {
            return bad(NAME, version.to_string(), refusal.to_string());
        }
    };
    let arm = facts.arm.as_deref().unwrap_or("arm not named");
    let value = format!("{series} {version}, {arm}, {} Hz", series.rate_hz());
    match check::rate(series, settings.robot.controller_rate_hz) {
        Ok(()) => good(NAME, value),
        Err(refusal) => bad(NAME, value, refusal.to_string()),
    }
}

fn remote(facts: &Facts) -> Finding {
    const NAME: &str = "remote control";
    match (facts.remote, facts.version) {
        (Some(true), _) => good(NAME, "on"),
        (Some(false), _) => {
            let fix = "switch to Remote Control at the top right of the pendant; enable it first under \
                       Settings, System, Remote Control";
            bad(NAME, "off: the controller takes no programs from here", fix)
        }
        (None, Some(version)) if version.major == 3 => good(NAME, "CB3 has none and needs none"),
        (None, _) => fair(
            NAME,
            "not known: the dashboard does not say",
            "look at the top right of the pendant: Remote, not Local (before 5.6 nothing tells it)",
        ),
    }
}

fn robot(modes: &Modes) -> Finding {
    const NAME: &str = "robot";
    let (words, fix) = match modes.robot {
        7 => return good(NAME, "running"),
        -1..=2 => ("starting up", "wait; confirm the safety settings if the pendant asks"),
        3 => ("switched off", "switch it on and release the brakes on the pendant"),
        4 | 5 => ("on, brakes closed", "release the brakes on the pendant"),
        6 => ("being moved by hand", "let go of the freedrive button"),
        8 => ("updating its firmware", "wait"),
        _ => ("in a mode nobody knows", "look at the pendant"),
    };
    bad(NAME, words, fix)
}

fn safety(modes: &Modes) -> Finding {
    const NAME: &str = "safety";
    let (words, fix) = match modes.safety {
        1 => return good(NAME, "normal"),
        2 => {
            let fix =
                "leave the area or release the input that causes it: the controller may slow the arm down";
            return fair(NAME, "reduced mode", fix);
        }
        3 => ("protective stop", "find out why, then release it on the pendant"),
        4 => ("recovery", "move the joint back within its limits on the pendant"),
        5 => ("safeguard stop", "clear the safeguard and reset it"),
        6 | 7 => ("emergency stop", "release the button, switch on, release the brakes"),
        8 | 9 => ("violation or fault", "read the log of the pendant, restart the safety system there"),
        _ => ("not in order", "look at the pendant"),
    };
    bad(NAME, words, fix)
}

fn program(modes: &Modes) -> Finding {
    const NAME: &str = "program";
    match modes.runtime {
        0 | 1 => good(NAME, "none runs"),
        2 => bad(
            NAME,
            "one runs",
            "stop it on the pendant, unless it is the bridge's own: foretrace does not stop programs of \
             others",
        ),
        3..=5 => bad(NAME, "one is paused", "stop it on the pendant"),
        _ => fair(NAME, "in a state nobody knows", "look at the pendant"),
    }
}

fn speed(modes: &Modes) -> Finding {
    const NAME: &str = "speed";
    let (slider, scaling) = (100.0 * modes.slider, 100.0 * modes.speed_scaling);
    // Without a program some versions scale by 0: only the slider tells then.
    let scaled = modes.runtime == 2 && !(scaling >= 99.0);
    if slider >= 99.0 && !scaled {
        return good(NAME, format!("slider at {slider:.0} %"));
    }
    bad(
        NAME,
        format!("slider at {slider:.0} %, scaled to {scaling:.0} %"),
        "set the slider to 100 %: below it the arm would be late everywhere, so the bridge stops",
    )
}

fn installation(facts: &Facts, settings: &Settings, position: &[[f64; 2]; JOINTS]) -> Vec<Finding> {
    let Some(found) = &facts.installation else {
        return vec![unseen("installation", "nothing came over RTDE")];
    };
    let refused = check::installation(found, settings, position, facts.loopback);
    let of = |wanted: fn(&check::CheckRefusal) -> bool| refused.iter().find(|refusal| wanted(refusal));
    let joints = match of(|refusal| matches!(refusal, check::CheckRefusal::Joint { .. })) {
        None => good("joints", "within the settings' limits"),
        Some(refusal) => bad("joints", "beyond the settings' limits", refusal.to_string()),
    };
    let payload = match (found.payload_kg, settings.robot.ur.payload_kg) {
        (None, _) => fair(
            "payload",
            "not known: this version does not tell it",
            "look under Installation, Payload: the weight of pen and holder",
        ),
        (Some(kg), content) => {
            let value = format!("{kg:.2} kg");
            let refused = of(|refusal| {
                matches!(
                    refusal,
                    check::CheckRefusal::Payload { .. } | check::CheckRefusal::PayloadUnsaid { .. }
                )
            });
            match (refused, content) {
                (Some(refusal), _) => bad("payload", value, refusal.to_string()),
                (None, Some(_)) => good("payload", value),
                (None, None) => fair(
                    "payload",
                    value,
                    "nobody compares it on this machine; for a real arm set robot.ur.payload_kg",
                ),
            }
        }
    };
    let tcp = match found.tcp_m {
        None => fair(
            "tool centre point",
            "not known: this version does not tell it",
            "look under Installation, TCP: the tip of the pen",
        ),
        Some([x, y, z]) => {
            let value = format!("[{x:.4}, {y:.4}, {z:.4}] m from the flange");
            match of(|refusal| matches!(refusal, check::CheckRefusal::Tcp { .. })) {
                None => good("tool centre point", value),
                Some(refusal) => bad("tool centre point", value, refusal.to_string()),
            }
        }
    };
    vec![joints, payload, tcp]
}

fn registers(facts: &Facts, settings: &Settings) -> Finding {
    const NAME: &str = "registers";
    let base = settings.robot.ur.register_base;
    match &facts.registers {
        None => unseen(NAME, "RTDE could not be asked"),
        Some(RegisterFact::Free) => good(NAME, format!("from {base}: free")),
        Some(RegisterFact::InUse(names)) => bad(
            NAME,
            format!("IN_USE: {}", names.join(", ")),
            "a fieldbus (Installation, Fieldbus: EtherNet/IP, PROFINET, MODBUS) or another RTDE client \
             holds them: switch it off, or set another robot.ur.register_base (24 to 30)",
        ),
        Some(RegisterFact::Unknown(names)) => bad(
            NAME,
            format!("not known to this version: {}", names.join(", ")),
            "update the controller: registers from 24 came with 3.9 and 5.3",
        ),
    }
}

fn line(timing: Option<&Timing>) -> Finding {
    const NAME: &str = "states";
    let Some(timing) = timing else { return unseen(NAME, "nothing was measured") };
    let [median, most, latest] = timing.late_ms;
    let value = format!(
        "{} in {:.0} s at {:.0} Hz, {} skipped; late by {median:.2} ms usually, {most:.2} in 99 of 100, \
         {latest:.2} at worst",
        timing.states, timing.seconds, timing.rate_hz, timing.skipped
    );
    let cycle_ms = 1e3 / timing.rate_hz;
    let share = timing.skipped as f64 / (timing.states + timing.skipped).max(1) as f64;
    if share > 0.01 || !(most <= 2.0 * cycle_ms) {
        let fix = "use a direct cable, no Wi-Fi and no switch that others use; run `foretrace doctor` for \
                   this machine";
        return bad(NAME, value, fix);
    }
    if timing.skipped > 0 || !(latest <= 2.0 * cycle_ms) {
        let fix = "rare, but each one uses up a cycle of extrapolation: look for what else runs here or on \
                   the line";
        return fair(NAME, value, fix);
    }
    good(NAME, value)
}

fn round_trip(timing: Option<&Timing>) -> Finding {
    const NAME: &str = "round trip";
    let Some(timing) = timing else { return unseen(NAME, "nothing was measured") };
    let total: u64 = timing.round_trips.iter().sum();
    if total == 0 {
        return unseen(NAME, "no register came back");
    }
    let share = |cycles: &u64| *cycles as f64 / total as f64;
    let longest = timing.round_trips.iter().rposition(|count| *count > 0).unwrap_or(0);
    let told: Vec<String> = timing
        .round_trips
        .iter()
        .enumerate()
        .filter(|(_, count)| **count > 0)
        .map(|(cycles, count)| format!("{cycles} cycles {:.1} %", 100.0 * share(count)))
        .collect();
    let value = told.join(", ");
    let slow: f64 = timing.round_trips.iter().skip(6).map(share).sum();
    if slow > 0.001 {
        let fix =
            "more than five cycles stop the arm: a direct cable, and `foretrace doctor` for this machine";
        return bad(NAME, value, fix);
    }
    if longest > 5 {
        return fair(NAME, value, "each one beyond five cycles would have stopped the arm");
    }
    good(NAME, value)
}

fn calibration(facts: &Facts, config: &Config) -> Finding {
    const NAME: &str = "calibration";
    let fix = "foretrace calibrate kinematics --robot HOST writes the arm's own measures";
    let deviation = facts.deviation.as_ref();
    if let Err(refusal) = check::model(facts.dh.as_ref(), deviation, facts.arm.as_deref(), config) {
        let value = match refusal {
            check::CheckRefusal::Model { .. } => "the model is of another arm",
            _ => "the model's base frame is not the one that the settings say",
        };
        return bad(NAME, value, refusal.to_string());
    }
    match deviation {
        None => fair(NAME, "not known: the controller did not tell its kinematics", fix),
        Some(off) if off.most_mm <= check::CALIBRATED_MM => {
            good(NAME, format!("the model is the arm's own, to {:.2} mm at the paper", off.most_mm))
        }
        Some(off) => fair(
            NAME,
            format!(
                "the tip is up to {:.1} mm from where the model believes it, uneven over the paper by \
                 {:.1} mm",
                off.most_mm, off.uneven_mm
            ),
            fix,
        ),
    }
}

fn dead_man(facts: &Facts, settings: &Settings) -> Finding {
    const NAME: &str = "dead-man";
    if settings.safety.enable_required {
        good(NAME, "required")
    } else if facts.loopback {
        good(NAME, "not required, on this machine")
    } else {
        let fix = "set safety.enable_required = true (preset ur5-first-run has it), or start with \
                   --without-dead-man";
        bad(NAME, "not required", fix)
    }
}

#[cfg(test)]
mod tests;
