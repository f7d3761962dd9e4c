//! `foretrace calibrate kinematics`: what the factory measured of an arm, into a URDF for the settings.
//!
//! Contract: reads the controller's primary interface; moves nothing.

use std::path::PathBuf;

use foretrace_config::{Config, presets};
use foretrace_ur::bridge::kinematics::{Deviation, DhParameters};
use foretrace_ur::bridge::probe::{Found, probe};
use serde::Serialize;

use crate::failure::{Cause, Failure};
use crate::output::{JsonArgs, say};
use crate::robot::{self, HostArgs};
use crate::settings::SettingsArgs;

/// Read a Universal Robots arm's factory calibration and write its kinematics as a URDF for the settings
///
/// Every arm differs from its data sheet by up to millimetres. The controller knows by how much; with its
/// numbers the tip is where the settings believe it. Says how far off the present model is over the paper,
/// and what to write into the settings.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  foretrace calibrate kinematics --robot 192.168.0.9\n  \
                  foretrace calibrate kinematics --robot 192.168.0.9 --config table.toml --out arm.urdf")]
pub(crate) struct KinematicsArgs {
    #[command(flatten)]
    host: HostArgs,

    /// Write the URDF to this file
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

/// The result; keys are stable.
#[derive(Debug, Serialize)]
struct KinematicsReport {
    host: String,
    arm: Option<&'static str>,
    /// As the controller tells them.
    theta_rad: [f64; 6],
    a_m: [f64; 6],
    d_m: [f64; 6],
    alpha_rad: [f64; 6],
    /// Of the settings' model from them, over the paper.
    deviation: Option<Deviation>,
    urdf: Option<PathBuf>,
}

pub(super) fn run(args: &KinematicsArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let config = args.settings.load()?;
    let found = probe(&args.host.addresses()?).map_err(|error| Failure::failed(error, robot::DOCTOR))?;
    let dh = found.dh.ok_or_else(|| {
        Failure::failed("the controller does not tell its kinematics on port 30001", robot::DOCTOR)
    })?;
    let deviation = found.deviation(&config);
    say!(
        "arm         {} {}, {}",
        found.series,
        found.version,
        found.arm().unwrap_or("not one that foretrace knows")
    );
    tell(&dh, deviation);
    if let Some(out) = &args.out {
        let text = written(&config, &found, &dh)?;
        foretrace_sim::whole::write(out, |file| std::io::Write::write_all(file, text.as_bytes())).map_err(
            |error| {
                let what = format!("cannot write {}: {error}", out.display());
                Failure::failed(what, "give a writable --out FILE")
            },
        )?;
        let tool = config.settings().robot.tool_m;
        say!("\nwritten to {}; put into the settings, beside your own values:\n", out.display());
        say!("[robot]\nurdf = {:?}  # relative to the settings file", out.display().to_string());
        say!("base_link = \"base_link\"\ntip_link = \"tool0\"\ntool_m = {tool:?}");
        say!("\nThen calibrate [plane] again: it was measured with the other model.");
    } else {
        say!("\nwith --out FILE they are written as a URDF for the settings");
    }
    args.json.write(&KinematicsReport {
        host: args.host.robot.clone(),
        arm: found.arm(),
        theta_rad: dh.theta,
        a_m: dh.a,
        d_m: dh.d,
        alpha_rad: dh.alpha,
        deviation,
        urdf: args.out.clone(),
    })
}

fn tell(dh: &DhParameters, deviation: Option<Deviation>) {
    say!("\njoint       theta [rad]         a [m]         d [m]   alpha [rad]");
    let rows = dh.theta.iter().zip(&dh.a).zip(&dh.d).zip(&dh.alpha).zip(1..);
    for ((((theta, a), d), alpha), joint) in rows {
        say!("{joint:<5} {theta:17.9} {a:13.7} {d:13.7} {alpha:13.9}");
    }
    match deviation {
        None => say!("\nthe settings' model reaches no point of the paper: nothing to compare"),
        Some(off) => {
            say!("\nthe settings' model is off by up to {:.2} mm over the paper", off.most_mm);
            say!(
                "once the plane is calibrated with it, by {:.2} mm, of which {:.2} mm in height",
                off.uneven_mm,
                off.height_mm
            );
        }
    }
}

/// The embedded description of this arm, with its own measures.
fn written(config: &Config, found: &Found, dh: &DhParameters) -> Result<String, Failure> {
    let named = &config.settings().robot.urdf;
    let nominal =
        presets::robot(named).or_else(|| found.embedded().and_then(presets::robot)).ok_or_else(|| {
            let what = format!("foretrace has no description of {}", found.arm().unwrap_or("this arm"));
            Failure::new(Cause::BadInput, what, format!("it has {}", presets::robot_names()))
        })?;
    dh.urdf(nominal).map_err(|error| Failure::failed(error, ""))
}
