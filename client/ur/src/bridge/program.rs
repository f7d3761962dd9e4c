//! The URScript that the bridge runs on the controller, with its numbers filled in.

use foretrace_config::settings::UrSection;
use foretrace_control::arm::JointLimits;

use super::registers::RegisterMap;
use foretrace_client::JOINTS;

/// With `{{NAME}}` where a number belongs.
const TEXT: &str = include_str!("program.script");
/// What stands for a position limit that a joint does not have \[rad\]: no controller counts so many turns.
const UNBOUNDED_RAD: f64 = 1000.0;
/// How many times the acceleration of a joint a punctual target may ask for in a cycle. It lies ahead of its
/// command by the trip and a tick, 4 ms of an e-Series whose cycle is 2 ms: where the command's acceleration
/// changes its sign at once, it asks for 1 + 2 · 4 / 2 times.
const PUNCTUAL: f64 = 5.0;

/// The numbers of the program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BridgeProgram {
    pub registers: RegisterMap,
    /// Of the controller: 1/125 or 1/500 \[s\].
    pub cycle_s: f64,
    /// Look-ahead of `servoj` \[s\], 0.03 to 0.2 (script manual).
    pub look_ahead_s: f64,
    /// Gain of `servoj`, 100 to 2000 (script manual).
    pub gain: f64,
    /// Cycles without a fresh target before it stops, 0 to 5.
    pub extrapolate_cycles: u32,
    /// Of the joints: range and speed always, acceleration on the way back to the targets after late cycles.
    pub limits: JointLimits<JOINTS>,
    /// Deceleration of the leading joint at a stop \[rad/s²\].
    pub stop_radps2: f64,
    /// Farthest that a target may be from where the joints are led \[rad\].
    pub reach_rad: f64,
    /// Fastest joint that a target may ask for \[rad/s\].
    pub speed_radps: f64,
    /// Rate of targets below which the controller ends the program \[Hz\].
    pub watchdog_hz: f64,
}

impl BridgeProgram {
    /// The program for an arm with these limits behind a controller that cycles every `cycle_s`.
    #[must_use]
    pub fn new(
        section: &UrSection,
        limits: &JointLimits<JOINTS>,
        registers: RegisterMap,
        cycle_s: f64,
    ) -> Self {
        let stop = smallest(limits.deceleration());
        Self {
            registers,
            cycle_s,
            look_ahead_s: section.look_ahead_ms * 1e-3,
            gain: section.gain,
            extrapolate_cycles: section.extrapolate_cycles,
            limits: *limits,
            // Inside the limits of every joint: stopj lets the leading one brake with this, the others with
            // less.
            stop_radps2: section.stop_radps2.map_or(stop, |asked| asked.min(stop)),
            reach_rad: reach(limits, cycle_s),
            speed_radps: 1.05 * largest(limits.velocity()),
            watchdog_hz: section.watchdog_hz,
        }
    }

    /// As URScript, ready to be sent. `token` is written back by the program, so that the bridge knows it is
    /// this one and not an earlier one.
    #[must_use]
    pub fn text(&self, token: i32) -> String {
        let r = &self.registers;
        let mut text = TEXT.to_owned();
        let whole = [
            ("COUNTER", r.counter()),
            ("LEAVE", r.permit()),
            ("ECHO", r.output(0)),
            ("STATE", r.output(1)),
            ("SESSION", r.output(2)),
            ("LATE", r.output(3)),
            ("USED", r.output(4)),
            ("WHY", r.output(5)),
            ("LOST", r.output(6)),
            ("EXTRAPOLATE", self.extrapolate_cycles),
        ];
        let mut fill = |name: &str, value: String| text = text.replace(&format!("{{{{{name}}}}}"), &value);
        whole.into_iter().for_each(|(name, value)| fill(name, value.to_string()));
        (0..12).for_each(|i| fill(&format!("D{i}"), r.double(i).to_string()));
        fill("TOKEN", token.to_string());
        fill("WATCHED", format!("input_int_register_{}", r.counter()));
        let real = [
            ("STEP_S", self.cycle_s),
            ("LOOK_AHEAD_S", self.look_ahead_s),
            ("GAIN", self.gain),
            ("STOP_RADPS2", self.stop_radps2),
            ("REACH_RAD", self.reach_rad),
            ("SPEED_RADPS", self.speed_radps),
            ("WATCHDOG_HZ", self.watchdog_hz),
        ];
        // Six decimals: URScript knows no exponents that every version reads.
        real.into_iter().for_each(|(name, value)| fill(name, format!("{value:.6}")));
        // Rounded to the inside.
        let inside = |value: f64| (value * 1e6).floor() * 1e-6;
        let lists = [
            ("LOWER_RAD", self.limits.position().map(|[lower, _]| -inside(-lower.max(-UNBOUNDED_RAD)))),
            ("UPPER_RAD", self.limits.position().map(|[_, upper]| inside(upper.min(UNBOUNDED_RAD)))),
            ("VELOCITY_RADPS", self.limits.velocity().map(inside)),
            ("ACCELERATION_RADPS2", self.limits.acceleration().map(inside)),
            ("PUNCTUAL_RADPS2", self.limits.acceleration().map(|most| PUNCTUAL * most)),
            // A stop that begins anywhere has to end inside the range as well.
            (
                "DECELERATION_RADPS2",
                self.limits.deceleration().map(|most| inside(most.min(self.stop_radps2))),
            ),
        ];
        let list = |values: [f64; JOINTS]| values.map(|value| format!("{value:.6}")).join(", ");
        lists.into_iter().for_each(|(name, values)| fill(name, format!("[{}]", list(values))));
        text
    }
}

/// Farthest that a target may be from where the one before leads \[rad\].
///
/// Two cycles of the fastest joint, and what the hardest acceleration makes of five cycles of extrapolation.
/// At 125 Hz and the preset's limits 0.082 rad, at 500 Hz 0.014; a pose from elsewhere is farther away.
#[must_use]
pub fn reach(limits: &JointLimits<JOINTS>, cycle_s: f64) -> f64 {
    let extrapolated = 5.0 * cycle_s;
    2.0 * largest(limits.velocity()) * cycle_s
        + 0.5 * largest(limits.acceleration()) * extrapolated * extrapolated
}

fn smallest(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;

    fn program(preset: &str, base: u32) -> BridgeProgram {
        let config = Config::preset(preset).unwrap();
        let cycle_s = 1.0 / f64::from(config.settings().robot.controller_rate_hz);
        let registers = RegisterMap::at(base).unwrap();
        BridgeProgram::new(&config.settings().robot.ur, &config.robot().limits, registers, cycle_s)
    }

    #[test]
    fn every_number_is_filled_in_and_every_register_is_ours() {
        for (preset, base) in [("ur5", 24), ("ur5e", 30), ("ur5-first-run", 27)] {
            let text = program(preset, base).text(77);
            assert!(!text.contains("{{") && !text.contains("}}"), "{text}");
            for call in text.split("_register(").skip(1) {
                let number: u32 =
                    call.split([')', ',']).next().unwrap().parse().unwrap_or_else(|_| panic!("{call}"));
                assert!((24..=41).contains(&number), "{preset}: {number}");
            }
            assert!(!text.contains("speed_slider") && !text.contains("set_target_payload"));
        }
    }

    #[test]
    fn servo_has_the_numbers_of_the_settings() {
        let text = program("ur5", 24).text(77);
        assert!(
            text.contains("servoj(ft_q, t=0.008000, lookahead_time=0.030000, gain=1200.000000)"),
            "{text}"
        );
        assert!(text.contains("rtde_set_watchdog(\"input_int_register_24\", 10.000000, \"stop\")"));
        assert!(text.contains("stopj(20.000000)") && text.contains("ft_missed > 5"));
    }

    #[test]
    fn stop_is_never_harder_than_what_any_joint_may_brake_with() {
        let config = Config::preset("ur5-first-run").unwrap();
        let mut section = config.settings().robot.ur.clone();
        let registers = RegisterMap::at(24).unwrap();
        let with = |section: &UrSection| {
            BridgeProgram::new(section, &config.robot().limits, registers, 0.008).stop_radps2
        };
        assert_eq!(with(&section), 5.0);
        section.stop_radps2 = Some(40.0);
        assert_eq!(with(&section), 5.0);
        section.stop_radps2 = Some(2.0);
        assert_eq!(with(&section), 2.0);
    }

    #[test]
    fn reach_allows_the_arms_own_motion_and_refuses_another_pose() {
        // Hand-worked: 2 · 3.1 · 0.008 + 0.5 · 40 · 0.04² = 0.0496 + 0.032.
        let config = Config::preset("ur5").unwrap();
        assert!((reach(&config.robot().limits, 0.008) - 0.0816).abs() < 1e-12);
    }

    #[test]
    fn lines_of_the_program_are_plain_text_that_every_version_reads() {
        let text = program("ur5", 24).text(77);
        assert!(text.is_ascii() && text.starts_with("def foretrace():\n") && text.ends_with("\nend\n"));
        assert!(text.lines().all(|line| !line.contains('\t')));
        let opens = ["def ", "while ", "if "];
        let count = |wanted: &dyn Fn(&str) -> bool| text.lines().filter(|line| wanted(line.trim())).count();
        let opened = count(&|line| opens.iter().any(|open| line.starts_with(open)) && line.ends_with(':'));
        assert_eq!(opened, count(&|line| line == "end"));
    }
}
