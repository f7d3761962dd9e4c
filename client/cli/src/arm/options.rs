//! The properties of the simulated arm: delay, jitter and speed.

use foretrace_sim::arm::{ArmSettings, DelayChange, DelaySettings, Fault};

/// Properties of the simulated arm, for `foretrace arm sim`.
#[derive(Debug, Clone, PartialEq, clap::Args)]
pub(crate) struct LagArgs {
    /// Pure delay before the servo [ms], 0 to 500; the controller's cycle, the look-ahead and 2 ms of joint
    /// loop are added to it
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = delay)]
    pub(crate) lag_ms: f64,

    /// Look-ahead of the servo [ms], 0 to 200 (a UR's servoj: 30 to 200); 0 is an arm without a servo filter
    #[arg(long, value_name = "MS", alias = "look-ahead", default_value_t = 30.0, value_parser = look_ahead)]
    pub(crate) look_ahead_ms: f64,

    /// Vary the delay from cycle to cycle by up to this much [ms], 0 to 100; commands stay in order
    #[arg(long, value_name = "MS", default_value_t = 0.0, value_parser = jitter)]
    pub(crate) jitter_ms: f64,

    /// Seed of the jitter: the same seed gives the same jitter
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub(crate) jitter_seed: u64,

    /// Change the delay to MS milliseconds when S seconds have passed since the arm began to cycle
    #[arg(long, value_name = "S:MS", value_parser = change)]
    pub(crate) lag_change: Option<(f64, f64)>,

    /// Speed scaling from 0 to 1, like the speed slider of a UR: only this share of the way to each target is
    /// gone before the next one comes, and no joint is faster than this share of its limit; 0 is a paused arm
    #[arg(long, value_name = "F", default_value_t = 1.0, value_parser = scaling)]
    pub(crate) speed_scaling: f64,

    /// Inject a fault this many seconds after the arm's first cycle: stuck, paused; locked, frozen (in its
    /// report), flipped or wrapped (by a turn) with a joint as VALUE; offset, runaway, slow, oscillation with
    /// a size
    #[arg(long, value_name = "KIND@S[:VALUE]")]
    pub(crate) fault: Option<Fault>,
}

impl LagArgs {
    /// A UR5 with these properties behind a controller that cycles every `cycle_s`.
    pub(crate) fn settings(&self, cycle_s: f64) -> ArmSettings {
        let change = self.lag_change.map(|(at_s, ms)| DelayChange { at_s, delay_s: ms * 1e-3 });
        let delay = DelaySettings {
            delay_s: self.lag_ms * 1e-3,
            jitter_s: self.jitter_ms * 1e-3,
            seed: self.jitter_seed,
            change,
        };
        ArmSettings {
            delay,
            speed_scaling: self.speed_scaling,
            fault: self.fault,
            ..ArmSettings::ur5(cycle_s, self.look_ahead_ms * 1e-3)
        }
    }
}

/// The same for programs that start an arm; options not given keep the defaults of `foretrace arm sim`.
#[derive(Debug, Clone, Default, clap::Args)]
pub(crate) struct StartedArmArgs {
    /// Pure delay of the simulated arm before its servo [ms], 0 to 500 [default: 0]
    #[arg(long, value_name = "MS", value_parser = delay)]
    arm_lag_ms: Option<f64>,

    /// Look-ahead of the arm's servo [ms], 0 to 200 [default: 30]
    #[arg(long, value_name = "MS", value_parser = look_ahead)]
    arm_look_ahead_ms: Option<f64>,

    /// Jitter of the arm's delay [ms], 0 to 100 [default: 0]
    #[arg(long, value_name = "MS", value_parser = jitter)]
    arm_jitter_ms: Option<f64>,

    /// Change the arm's delay to MS milliseconds when S seconds have passed since the arm began to cycle
    #[arg(long, value_name = "S:MS", value_parser = change)]
    arm_lag_change: Option<(f64, f64)>,

    /// Speed scaling of the arm, 0 to 1 [default: 1]
    #[arg(long, value_name = "F", value_parser = scaling)]
    arm_speed_scaling: Option<f64>,

    /// Inject a fault into the arm: KIND@SECONDS[:VALUE], as `foretrace arm sim --fault`
    #[arg(long, value_name = "KIND@S[:VALUE]", value_parser = fault)]
    arm_fault: Option<String>,
}

impl StartedArmArgs {
    /// As options of `foretrace arm sim`.
    pub(crate) fn arguments(&self) -> Vec<String> {
        let change = self.arm_lag_change.map(|(s, ms)| format!("{s}:{ms}"));
        let number = |value: Option<f64>| value.map(|value| value.to_string());
        let all = [
            ("--lag-ms", number(self.arm_lag_ms)),
            ("--look-ahead-ms", number(self.arm_look_ahead_ms)),
            ("--jitter-ms", number(self.arm_jitter_ms)),
            ("--lag-change", change),
            ("--speed-scaling", number(self.arm_speed_scaling)),
            ("--fault", self.arm_fault.clone()),
        ];
        all.into_iter().filter_map(|(name, value)| value.map(|value| format!("{name}={value}"))).collect()
    }
}

fn delay(text: &str) -> Result<f64, String> {
    within(text, 500.0).ok_or_else(|| "a number of milliseconds from 0 to 500".to_owned())
}

fn look_ahead(text: &str) -> Result<f64, String> {
    within(text, 200.0)
        .ok_or_else(|| "a number of milliseconds from 0 to 200; servoj takes 30 to 200".to_owned())
}

fn jitter(text: &str) -> Result<f64, String> {
    within(text, 100.0).ok_or_else(|| "a number of milliseconds from 0 to 100".to_owned())
}

fn scaling(text: &str) -> Result<f64, String> {
    within(text, 1.0).ok_or_else(|| "a number from 0 to 1".to_owned())
}

/// Checked here as well, so that a demo does not start with options that its arm would refuse.
fn fault(text: &str) -> Result<String, String> {
    text.parse::<Fault>().map(|_| text.to_owned()).map_err(|error| error.to_string())
}

fn change(text: &str) -> Result<(f64, f64), String> {
    let parts = text.split_once(':').and_then(|(s, ms)| within(s, 1e6).zip(within(ms, 500.0)));
    parts.ok_or_else(|| "S:MS, seconds from 0 and milliseconds from 0 to 500, for example 10:80".to_owned())
}

/// A number from 0 to `most`.
fn within(text: &str, most: f64) -> Option<f64> {
    text.parse().ok().filter(|value| (0.0..=most).contains(value))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use foretrace_sim::arm::FaultKind;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        lag: LagArgs,
    }

    #[derive(Debug, Parser)]
    struct Starter {
        #[command(flatten)]
        arm: StartedArmArgs,
    }

    fn parsed(words: &[&str]) -> Result<LagArgs, String> {
        Line::try_parse_from([&["sim"], words].concat())
            .map(|line| line.lag)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn without_options_it_is_the_plain_ur5() {
        assert_eq!(
            parsed(&[]).unwrap().settings(0.002),
            ArmSettings {
                delay: DelaySettings { seed: 1, ..DelaySettings::default() },
                ..ArmSettings::ur5(0.002, 0.030)
            }
        );
    }

    #[test]
    fn what_a_demo_is_told_its_arm_hears() {
        let words = [
            "demo",
            "--arm-lag-ms=12.5",
            "--arm-look-ahead-ms=0",
            "--arm-jitter-ms=3",
            "--arm-lag-change=2.5:90",
            "--arm-fault=offset@3:-0.1",
        ];
        let starter = Starter::try_parse_from(words).unwrap();
        let arguments = starter.arm.arguments();
        let heard = parsed(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
        assert_eq!((heard.lag_ms, heard.look_ahead_ms, heard.jitter_ms), (12.5, 0.0, 3.0));
        assert_eq!((heard.lag_change, heard.speed_scaling), (Some((2.5, 90.0)), 1.0));
        assert_eq!(heard.fault, Some(Fault { kind: FaultKind::Offset(-0.1), at_s: 3.0 }));
        assert!(Starter::try_parse_from(["demo"]).unwrap().arm.arguments().is_empty());
    }

    #[test]
    fn values_out_of_range_are_refused_with_the_range() {
        for (words, range) in [
            (["--lag-ms=-1"], "0 to 500"),
            (["--lag-ms=501"], "0 to 500"),
            (["--look-ahead-ms=nan"], "0 to 200"),
            (["--jitter-ms=inf"], "0 to 100"),
            (["--lag-change=5"], "S:MS"),
            (["--lag-change=-1:20"], "S:MS"),
            (["--lag-change=1:900"], "S:MS"),
            (["--speed-scaling=1.5"], "0 to 1"),
            (["--fault=bent@3"], "KIND@SECONDS"),
        ] {
            let refused = parsed(&words).unwrap_err();
            assert!(refused.contains(range), "{words:?}: {refused}");
        }
    }
}
