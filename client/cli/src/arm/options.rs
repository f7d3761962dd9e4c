//! The properties of the simulated arm: delay, jitter and speed; joints that are not ideal.

use foretrace_sim::arm::{ArmSettings, DelayChange, DelaySettings, Fault, JOINTS, Mechanics};

use crate::values::number;

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
    /// a size; ceiling (of its speed), gain, stiction with JOINT:SIZE
    #[arg(long, value_name = "KIND@S[:VALUE]")]
    pub(crate) fault: Option<Fault>,

    /// Largest speed of the joints [rad/s], 0 to 3.342, for all or as JOINT:RADPS,... [default: 3.342]
    #[arg(long, value_name = "RADPS", value_parser = speed)]
    pub(crate) joint_speed_radps: Option<PerJoint>,

    #[command(flatten)]
    pub(crate) joints: JointArgs,
}

/// Joints that are not ideal; all off by default.
#[derive(Debug, Clone, Default, PartialEq, clap::Args)]
pub(crate) struct JointArgs {
    /// Damping ratio of the servo at the same group delay, 0.1 to 10: below 1 it overshoots; a literal servoj
    /// has look-ahead [s] · √gain / 2 [default: 1]
    #[arg(long, value_name = "ZETA", value_parser = damping)]
    pub(crate) damping: Option<f64>,

    /// Stiction: a joint at rest does not move until it is led by more than this [mrad], 0 to 500; for all
    /// joints, or as JOINT:MRAD,... with joints from 0 at the base [default: 0]
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    pub(crate) stiction_mrad: Option<PerJoint>,

    /// Coulomb friction: a joint that moves stays this far behind what leads it [mrad], 0 to 500
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    pub(crate) coulomb_mrad: Option<PerJoint>,

    /// Backlash: dead band between motor and measured joint [mrad], 0 to 500
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    pub(crate) backlash_mrad: Option<PerJoint>,

    /// Share of its way that a joint goes, 0 to 2 [default: 1]
    #[arg(long, value_name = "GAIN", value_parser = gain)]
    pub(crate) gain: Option<PerJoint>,

    /// Encoder step: positions are reported in steps of this [mrad], 0 to 500
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    pub(crate) encoder_step_mrad: Option<PerJoint>,

    /// Payload sag of the shoulder lift with the arm stretched out level [mrad], -500 to 500; less elsewhere,
    /// with the gravity torque of a mass at the wrist
    #[arg(long, value_name = "MRAD", value_parser = sag)]
    pub(crate) sag_mrad: Option<f64>,
}

impl JointArgs {
    /// Damping ratio of the servo.
    pub(crate) fn damping(&self) -> f64 {
        self.damping.unwrap_or(1.0)
    }

    pub(crate) fn mechanics(&self) -> Mechanics {
        let radians =
            |given: &Option<PerJoint>| PerJoint::or(given.as_ref(), [0.0; JOINTS]).map(|mrad| mrad * 1e-3);
        Mechanics {
            stiction_rad: radians(&self.stiction_mrad),
            coulomb_rad: radians(&self.coulomb_mrad),
            backlash_rad: radians(&self.backlash_mrad),
            gain: PerJoint::or(self.gain.as_ref(), [1.0; JOINTS]),
            encoder_step_rad: radians(&self.encoder_step_mrad),
            sag_rad: self.sag_mrad.unwrap_or(0.0) * 1e-3,
        }
    }
}

/// A number for all joints, or for some of them.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PerJoint([Option<f64>; JOINTS]);

impl PerJoint {
    /// `text` as one number for all, or JOINT:NUMBER,..., each from `low` to `high`.
    fn read(text: &str, [low, high]: [f64; 2]) -> Result<Self, String> {
        let wrong =
            || format!("a number from {low} to {high}, or JOINT:NUMBER,... with joints 0 to {}", JOINTS - 1);
        let within = |text: &str| number(low..=high, "")(text).map_err(|_| wrong());
        if !text.contains(':') {
            return Ok(Self([Some(within(text)?); JOINTS]));
        }
        let mut all = [None; JOINTS];
        for part in text.split(',') {
            let (joint, value) = part.split_once(':').ok_or_else(wrong)?;
            let slot = joint.parse::<usize>().ok().and_then(|joint| all.get_mut(joint)).ok_or_else(wrong)?;
            if slot.replace(within(value)?).is_some() {
                return Err(format!("joint {joint} twice"));
            }
        }
        Ok(Self(all))
    }

    /// What is given, else of `usual`.
    fn or(given: Option<&Self>, usual: [f64; JOINTS]) -> [f64; JOINTS] {
        let mut all = usual;
        for (value, given) in all.iter_mut().zip(given.iter().flat_map(|given| given.0)) {
            *value = given.unwrap_or(*value);
        }
        all
    }
}

impl std::fmt::Display for PerJoint {
    /// As it is read.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let given = self.0.iter().enumerate().filter_map(|(joint, value)| Some((joint, (*value)?)));
        let parts: Vec<String> = given.map(|(joint, value)| format!("{joint}:{value}")).collect();
        f.write_str(&parts.join(","))
    }
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
        let plain = ArmSettings::ur5(cycle_s, self.look_ahead_ms * 1e-3);
        ArmSettings {
            delay,
            speed_scaling: self.speed_scaling,
            damping: self.joints.damping(),
            velocity_radps: PerJoint::or(self.joint_speed_radps.as_ref(), plain.velocity_radps),
            mechanics: self.joints.mechanics(),
            fault: self.fault,
            ..plain
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

    /// Largest speed of the arm's joints [rad/s], for all or as JOINT:RADPS,... [default: 3.342]
    #[arg(long, value_name = "RADPS", value_parser = speed)]
    arm_joint_speed_radps: Option<PerJoint>,

    /// Damping ratio of the arm's servo, 0.1 to 10 [default: 1]
    #[arg(long, value_name = "ZETA", value_parser = damping)]
    arm_damping: Option<f64>,

    /// Stiction of the arm [mrad], as `foretrace arm sim --stiction-mrad`
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    arm_stiction_mrad: Option<PerJoint>,

    /// Coulomb friction of the arm [mrad]
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    arm_coulomb_mrad: Option<PerJoint>,

    /// Backlash of the arm [mrad]
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    arm_backlash_mrad: Option<PerJoint>,

    /// Gain of the arm's joints, 0 to 2 [default: 1]
    #[arg(long, value_name = "GAIN", value_parser = gain)]
    arm_gain: Option<PerJoint>,

    /// Encoder step of the arm [mrad]
    #[arg(long, value_name = "MRAD", value_parser = milliradians)]
    arm_encoder_step_mrad: Option<PerJoint>,

    /// Payload sag of the arm [mrad], -500 to 500
    #[arg(long, value_name = "MRAD", value_parser = sag)]
    arm_sag_mrad: Option<f64>,
}

impl StartedArmArgs {
    /// As options of `foretrace arm sim`.
    pub(crate) fn arguments(&self) -> Vec<String> {
        let change = self.arm_lag_change.map(|(s, ms)| format!("{s}:{ms}"));
        let one = |value: Option<f64>| value.map(|value| value.to_string());
        let joints = |value: &Option<PerJoint>| value.as_ref().map(PerJoint::to_string);
        let all = [
            ("--lag-ms", one(self.arm_lag_ms)),
            ("--look-ahead-ms", one(self.arm_look_ahead_ms)),
            ("--jitter-ms", one(self.arm_jitter_ms)),
            ("--lag-change", change),
            ("--speed-scaling", one(self.arm_speed_scaling)),
            ("--fault", self.arm_fault.clone()),
            ("--joint-speed-radps", joints(&self.arm_joint_speed_radps)),
            ("--damping", one(self.arm_damping)),
            ("--stiction-mrad", joints(&self.arm_stiction_mrad)),
            ("--coulomb-mrad", joints(&self.arm_coulomb_mrad)),
            ("--backlash-mrad", joints(&self.arm_backlash_mrad)),
            ("--gain", joints(&self.arm_gain)),
            ("--encoder-step-mrad", joints(&self.arm_encoder_step_mrad)),
            ("--sag-mrad", one(self.arm_sag_mrad)),
        ];
        all.into_iter().filter_map(|(name, value)| value.map(|value| format!("{name}={value}"))).collect()
    }
}

fn delay(text: &str) -> Result<f64, String> {
    number(0.0..=500.0, "a number of milliseconds from 0 to 500")(text)
}

fn look_ahead(text: &str) -> Result<f64, String> {
    number(0.0..=200.0, "a number of milliseconds from 0 to 200; servoj takes 30 to 200")(text)
}

fn jitter(text: &str) -> Result<f64, String> {
    number(0.0..=100.0, "a number of milliseconds from 0 to 100")(text)
}

fn speed(text: &str) -> Result<PerJoint, String> {
    PerJoint::read(text, [0.0, 3.342])
}

fn milliradians(text: &str) -> Result<PerJoint, String> {
    PerJoint::read(text, [0.0, 500.0])
}

fn gain(text: &str) -> Result<PerJoint, String> {
    PerJoint::read(text, [0.0, 2.0])
}

fn damping(text: &str) -> Result<f64, String> {
    number(0.1..=10.0, "a number from 0.1 to 10")(text)
}

fn sag(text: &str) -> Result<f64, String> {
    number(-500.0..=500.0, "a number of milliradians from -500 to 500")(text)
}

fn scaling(text: &str) -> Result<f64, String> {
    number(0.0..=1.0, "a number from 0 to 1")(text)
}

/// Checked here as well, so that a demo does not start with options that its arm would refuse.
fn fault(text: &str) -> Result<String, String> {
    text.parse::<Fault>().map(|_| text.to_owned()).map_err(|error| error.to_string())
}

fn change(text: &str) -> Result<(f64, f64), String> {
    let within = |text: &str, most: f64| number(0.0..=most, "")(text).ok();
    let parts = text.split_once(':').and_then(|(s, ms)| within(s, 1e6).zip(within(ms, 500.0)));
    parts.ok_or_else(|| "S:MS, seconds from 0 and milliseconds from 0 to 500, for example 10:80".to_owned())
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
            "--arm-joint-speed-radps=2:0.3",
            "--arm-damping=0.52",
            "--arm-stiction-mrad=1:2.5,4:3",
            "--arm-coulomb-mrad=1",
            "--arm-backlash-mrad=0.5",
            "--arm-gain=5:0.5",
            "--arm-encoder-step-mrad=0.1",
            "--arm-sag-mrad=-4",
        ];
        let starter = Starter::try_parse_from(words).unwrap();
        let arguments = starter.arm.arguments();
        let heard = parsed(&arguments.iter().map(String::as_str).collect::<Vec<_>>()).unwrap();
        assert_eq!((heard.lag_ms, heard.look_ahead_ms, heard.jitter_ms), (12.5, 0.0, 3.0));
        assert_eq!((heard.lag_change, heard.speed_scaling), (Some((2.5, 90.0)), 1.0));
        assert_eq!(heard.fault, Some(Fault { kind: FaultKind::Offset(-0.1), at_s: 3.0 }));
        let settings = heard.settings(0.002);
        assert_eq!(
            (settings.damping, settings.velocity_radps[2], settings.velocity_radps[3]),
            (0.52, 0.3, 3.342)
        );
        let milli = |numbers: [f64; JOINTS]| numbers.map(|number| number * 1e-3);
        let given = Mechanics {
            stiction_rad: milli([0.0, 2.5, 0.0, 0.0, 3.0, 0.0]),
            coulomb_rad: milli([1.0; JOINTS]),
            backlash_rad: milli([0.5; JOINTS]),
            gain: [1.0, 1.0, 1.0, 1.0, 1.0, 0.5],
            encoder_step_rad: milli([0.1; JOINTS]),
            sag_rad: -4.0 * 1e-3,
        };
        assert_eq!(settings.mechanics, given);
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
            (["--damping=0"], "0.1 to 10"),
            (["--stiction-mrad=6:1"], "JOINT:NUMBER"),
            (["--backlash-mrad=1:1,1:2"], "joint 1 twice"),
            (["--gain=-1"], "0 to 2"),
            (["--sag-mrad=nan"], "-500 to 500"),
            (["--joint-speed-radps=9"], "0 to 3.342"),
        ] {
            let refused = parsed(&words).unwrap_err();
            assert!(refused.contains(range), "{words:?}: {refused}");
        }
    }
}
