//! `foretrace calibrate plane`: where the paper is, from touches of pen and tool on the same marks.
//!
//! Contract: moves nothing. A plane that fits badly, that the arm cannot reach all over, or whose proof touch
//! is off is refused and not written.

use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use foretrace_calibrate::plane::{self, PlaneFit, PlaneReport, TouchListener, TouchMark};
use foretrace_config::Config;

use crate::attach::{attach_within, instance_of};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::output::{JsonArgs, note, say, tell, write_file};
use crate::settings::{SettingsArgs, judged};
use crate::terminal::read_lines;

/// Find the writing plane: touch the same marks with the pen and with the tool's tip
///
/// Make three marks or more on the paper, in a triangle as large as it, and one more as proof. Touch each
/// with the pen on its tablet, then bring the tool's tip to it by hand, and press Enter. The daemon runs and
/// is disarmed; a pen and an arm are connected. The plane that fits best is checked: residual of each touch,
/// reach over the whole paper, and the proof.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace calibrate plane --config table.toml --write\n  foretrace \
                        calibrate plane --config table.toml --save touches.csv\n  foretrace calibrate plane \
                        --config table.toml --touches touches.csv")]
pub(crate) struct PlaneArgs {
    /// Marks that are touched, the proof not counted
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(3..=20))]
    marks: u32,

    /// Largest distance of a touch from the plane, and of the proof [mm]
    #[arg(long, value_name = "MM", default_value_t = 1.0, value_parser = crate::values::positive)]
    within: f64,

    /// Take the marks from a CSV, the last one as proof, instead of listening
    #[arg(long, value_name = "FILE", conflicts_with = "save")]
    touches: Option<PathBuf>,

    /// Write the marks to a CSV
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,

    /// Put the plane into the settings file of --config
    #[arg(long, requires = "config")]
    write: bool,

    /// Seconds to wait for the daemon to come up
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = crate::values::wait)]
    wait: f64,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &PlaneArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let config = args.settings.load()?;
    let marks = match &args.touches {
        Some(file) => plane::read(file)?,
        None => listened(args, &config)?,
    };
    if let Some(file) = &args.save {
        write_file(file, &plane::text(&marks), "--save")?;
    }
    let (fit, report) = plane::fit(&config, &marks)?;
    show(&report, &fit);
    args.json.write(&report)?;
    report.check(args.within)?;
    reached(args, &fit)?;
    if let (true, Some(file)) = (args.write, &args.settings.config) {
        plane::write(file, &fit)?;
        say!("\nwritten into {}; start the daemon again with it", file.display());
    } else {
        say!("\nput these lines into the settings, or give --config FILE --write");
    }
    Ok(())
}

fn listened(args: &PlaneArgs, config: &Config) -> Result<Vec<TouchMark>, Failure> {
    let interrupt = Interrupt::listen()?;
    let instance = instance_of(config.settings())?;
    let foretrace = attach_within(&instance, Duration::from_secs_f64(args.wait))?;
    let (sender, enters) = sync_channel(4);
    // What is typed means nothing, and a line without an end is no Enter.
    read_lines("calibrate-enter", move |line| !line.ends_with('\n') || sender.send(()).is_ok())?;
    let interrupted = || interrupt.is_set();
    let mut listener = TouchListener::open(&foretrace, enters, &interrupted, &tell)?;
    note!("{} marks and one as proof; the arm is moved by hand, the loop stays disarmed", args.marks);
    let all = args.marks as usize + 1;
    (1..=all).map(|number| listener.mark(number, number == all)).collect()
}

fn show(report: &PlaneReport, fit: &PlaneFit) {
    say!("touch      along the paper [mm]   above it [mm]   tilt of the tool [rad]");
    let proof = std::iter::once(("proof".to_owned(), &report.proof));
    let fitted = report.touches.iter().zip(1..).map(|(touch, number)| (number.to_string(), touch));
    for (name, touch) in fitted.chain(proof) {
        say!("{name:<6}{:>25.3} {:>15.3} {:>24.3}", touch.along_mm, touch.above_mm, touch.tilt_rad);
    }
    say!("\n[plane]");
    for (key, value) in plane::lines(fit) {
        say!("{key} = {value}");
    }
}

/// The settings with the new plane, and their reach over the whole paper.
fn reached(args: &PlaneArgs, fit: &PlaneFit) -> Result<(), Failure> {
    let mut source = args.settings.source()?;
    for (key, value) in plane::lines(fit) {
        source.overrides.push((format!("plane.{key}"), value));
    }
    let config = judged(&source)?;
    match plane::missing(&config.settings().plane, config.robot()) {
        None => {
            say!("\nthe arm reaches the whole paper, upright");
            Ok(())
        }
        Some(what) => Err(Failure::bad_input(
            what,
            "nothing was written: move the paper nearer, or make plane.workspace_m smaller",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_control::ik::{ToolTarget, solve_pose};
    use nalgebra::{Vector2, Vector3};

    /// Marks on the preset's paper, as an arm and a pen turned by 0.3 rad and 0.8 times as large would touch
    /// them; the last is off by `off_m` along the normal.
    fn marks(config: &Config, off_m: f64) -> Vec<TouchMark> {
        let (plane, robot) = (&config.settings().plane, config.robot());
        let rotation = plane.rotation();
        let pens = [[-0.06, -0.05], [0.07, -0.06], [0.0, 0.06], [0.05, 0.04]];
        let (sin, cos) = 0.3_f64.sin_cos();
        let touched = |(index, [x, y]): (usize, [f64; 2])| {
            let z = if index == 3 { off_m } else { 0.0 };
            let point = Vector3::new(0.8 * (cos * x - sin * y), 0.8 * (sin * x + cos * y), z);
            let tip = Vector3::from(plane.origin_m) + rotation * point;
            let target = ToolTarget::at_rest(tip, -(rotation * Vector3::z()), None);
            TouchMark { pen: Vector2::new(x, y), q: solve_pose(&robot.chain, &robot.home, &target).unwrap() }
        };
        pens.into_iter().enumerate().map(touched).collect()
    }

    fn args(folder: &std::path::Path, marks: &[TouchMark]) -> PlaneArgs {
        let (file, settings) = (folder.join("touches.csv"), folder.join("table.toml"));
        std::fs::write(&file, plane::text(marks)).unwrap();
        std::fs::write(&settings, "preset = \"ur5\"\n").unwrap();
        PlaneArgs {
            marks: 3,
            within: 1.0,
            touches: Some(file),
            save: None,
            write: true,
            wait: 0.0,
            settings: SettingsArgs { config: Some(settings), ..SettingsArgs::default() },
            json: JsonArgs::default(),
        }
    }

    #[test]
    fn touches_of_pen_and_tool_become_the_plane_of_the_settings() {
        let config = Config::preset("ur5").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let args = args(folder.path(), &marks(&config, 0.0));
        run(&args).unwrap();
        let new = args.settings.load().unwrap();
        let (old, new) = (&config.settings().plane, &new.settings().plane);
        assert!((new.scale - 0.8).abs() < 1e-6);
        assert!((Vector3::from(new.origin_m) - Vector3::from(old.origin_m)).norm() < 1e-6);
        let turned = old.rotation() * Vector3::new(0.3_f64.cos(), 0.3_f64.sin(), 0.0);
        assert!((Vector3::from(new.x_axis) - turned).norm() < 1e-6);
        assert!((Vector3::from(new.normal) - Vector3::from(old.normal)).norm() < 1e-6);
    }

    #[test]
    fn a_proof_that_is_off_is_refused_and_the_settings_stay() {
        let config = Config::preset("ur5").unwrap();
        let folder = tempfile::tempdir().unwrap();
        let args = args(folder.path(), &marks(&config, 0.003));
        let message = run(&args).unwrap_err().to_string();
        assert!(
            message.contains("the proof is 3.00 mm off") && message.contains("nothing was written"),
            "{message}"
        );
        let file = args.settings.config.clone().unwrap();
        assert_eq!(std::fs::read_to_string(file).unwrap(), "preset = \"ur5\"\n");
        // Who knows better may allow more.
        run(&PlaneArgs { within: 5.0, ..args }).unwrap();
    }
}
