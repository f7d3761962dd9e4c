//! Closed-loop experiments through the daemon's own control law: the paper's figures 2 and 3.

mod closed_loop;
mod desk_arm;
mod other_program;
mod entrant;
mod fig2;
mod fig3;
mod letters;
mod shown;

pub(crate) use closed_loop::{AWAY_NS, epoch, feed};
pub use closed_loop::{ClosedLoop, Desk, DeskOptions, LawDesk, RunError, TickTrace, Watch, Watched, desk};
pub(crate) use desk_arm::exceeds;
pub use desk_arm::{ArmError, ArmFacts, ArmKind, DeskArm, Measured};
pub use entrant::LawEntrant;
pub use fig2::{Fig2, Fig2Arm, Fig2Row, fig2, fig2_entrant, fig2_names};
pub use fig3::{Fig3, Fig3Letter, fig3};
pub use letters::{Labels, Letter, LetterError, letters};
pub use other_program::{OtherPredictor, StepPredictor};
pub use shown::fig2_json;

use foretrace_config::{Config, SettingOrigin};
use foretrace_control::follower::FollowerSettings;
use foretrace_control::learn::{Leads, Learner, LearnerSettings};
use foretrace_control::predict::PredictorKind;

use foretrace_sim::arm::{ArmSettings, JOINTS};
use foretrace_sim::spread;

/// Any failure of an experiment.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExperimentError {
    /// A run.
    #[error("letter {label:?} of writer {writer}, {predictor} on {arm}: {error}")]
    Run { label: String, writer: String, predictor: &'static str, arm: &'static str, error: Box<RunError> },
    /// The settings.
    #[error("{0}")]
    Settings(String),
    /// No letter is long enough.
    #[error("no letter lasts {steps} grid steps; choose another label or set")]
    TooShort { steps: u32 },
    /// No letter was ever scored.
    #[error("no letter has pen-down samples to score")]
    Nothing,
}

/// The loop compensates for a servo filter: the arms' own servo is known here.
fn settings_of_servo(config: &Config) -> bool {
    config.settings().timing.servo_filter_ms > 0.0
}

/// The loop of `config` for an arm.
pub(crate) fn settings_for(config: &Config, arm: &ArmFacts, kind: PredictorKind) -> FollowerSettings<JOINTS> {
    let mut settings = config.follower_settings();
    settings.preview.kind = if kind == PredictorKind::ORACLE { PredictorKind::HOLD } else { kind };
    // The default velocity lead is for the lag of real arms and uncertain predictions.
    let asked = !matches!(config.origin("mpc.velocity_lead_ms"), None | Some(SettingOrigin::Default));
    let late = arm.servo && kind != PredictorKind::ORACLE;
    if !asked && !late {
        settings.velocity_lead_ns = 0;
    }
    settings.mpc.servo_s = if arm.servo && settings_of_servo(config) { arm.look_ahead_s } else { 0.0 };
    if let Some(group_delay_s) = arm.group_delay_s {
        settings.dead_time_ns = (group_delay_s * 1e9).round() as u64;
    }
    settings
}

/// A learner for that loop, if its predictor learns.
pub(crate) fn learner_for(
    config: &Config,
    settings: &FollowerSettings<JOINTS>,
    kind: PredictorKind,
) -> Result<Option<Learner>, ExperimentError> {
    if !kind.learns() {
        return Ok(None);
    }
    let ahead_ns = settings.dead_time_ns.saturating_sub(settings.servo_ns()) + settings.response_ns;
    let leads = Leads::of_loop(settings.pen.step_ns, ahead_ns, config.settings().plan_steps());
    Learner::new(LearnerSettings { leads, ..config.learner_settings() }, config.models())
        .map(Some)
        .map_err(|error| ExperimentError::Settings(error.to_string()))
}

/// The simulated arm whose controller runs at the loop's own rate.
pub(crate) fn ur5_at(config: &Config) -> ArmSettings {
    ArmSettings::ur5(config.settings().period_ns() as f64 * 1e-9, LOOK_AHEAD_S)
}

/// servoj's smallest look-ahead \[s\].
const LOOK_AHEAD_S: f64 = 0.030;
/// The pen rests above a letter's first point for this long, so that the tool starts there \[s\].
pub(crate) const WAIT_S: f64 = 1.2;

pub(crate) fn median(values: impl Iterator<Item = f64>) -> f64 {
    spread::median(values).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_predictor_that_learns_is_taught_in_every_experiment() {
        let config = Config::parse("preset = \"ur5\"\n", "t.toml", ".").unwrap();
        let facts = ArmFacts { group_delay_s: None, look_ahead_s: 0.0, servo: false, effort: None };
        for kind in PredictorKind::ALL {
            let settings = settings_for(&config, &facts, kind);
            assert_eq!(learner_for(&config, &settings, kind).unwrap().is_some(), kind.learns(), "{kind:?}");
        }
        assert!(PredictorKind::MIXTURE.learns() && !PredictorKind::LSTM.learns());
    }
}
