//! `foretrace calibrate kinematics`: what the factory measured of an arm, into a URDF for the settings.
//!
//! Contract: reads the controller's primary interface; moves nothing.

use std::path::PathBuf;

use foretrace_config::presets;
use foretrace_report::failures::DOCTOR;
use foretrace_ur::bridge::kinematics::{Deviation, DhParameters};
use foretrace_ur::bridge::probe::{Found, probe};
use serde::Serialize;

use crate::failure::Failure;
use crate::output::{JsonArgs, say, write_file};
use crate::robot::HostArgs;
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
    let found = probe(&args.host.addresses()?).map_err(|error| Failure::failed(error, DOCTOR))?;
    let dh = found.dh.ok_or_else(|| {
        Failure::failed("the controller does not tell its kinematics on port 30001", DOCTOR)
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
        write_file(out, &written(&found, &dh)?, "--out")?;
        let tool = config.settings().robot.tool_m;
        say!("\nwritten to {}; put into the settings, beside your own values:\n", out.display());
        say!("[robot]\nurdf = {:?}  # relative to the settings file", out.display().to_string());
        say!("base_link = \"base_link\"\ntip_link = \"tool0\"\ntool_m = {tool:?}");
        if config.settings().robot.ur.base_turned {
            say!("[robot.ur]\nbase_turned = false  # the file has the controller's own base frame");
        }
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

/// The embedded description of the arm that was found, with its own measures. One of another arm would get
/// its joints, but another's body, and clearance is judged by the body.
fn written(found: &Found, dh: &DhParameters) -> Result<String, Failure> {
    let nominal = found.embedded().and_then(presets::robot).ok_or_else(|| {
        let arm = found.arm().unwrap_or("an arm that foretrace does not know");
        let what = format!("this is {arm}, and foretrace has no description of its body");
        let remedy = format!(
            "it has {}; for another arm take the maker's URDF and put the numbers above into it",
            presets::robot_names()
        );
        Failure::bad_input(what, remedy)
    })?;
    dh.urdf(nominal).map_err(|error| Failure::failed(error, ""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_ur::bridge::check::{Installation, Series, Version};

    fn found(a: [f64; 3], d1: f64) -> Found {
        let [a2, a3, _] = a;
        let dh = DhParameters {
            theta: [0.0; 6],
            a: [0.0, a2, a3, 0.0, 0.0, 0.0],
            d: [d1, 0.0, 0.0, 0.1333, 0.0997, 0.0996],
            alpha: [
                std::f64::consts::FRAC_PI_2,
                0.0,
                0.0,
                std::f64::consts::FRAC_PI_2,
                -std::f64::consts::FRAC_PI_2,
                0.0,
            ],
        };
        Found {
            version: Version { major: 5, minor: 11, bugfix: 0, build: 0 },
            series: Series::E,
            installation: Installation { q: [0.0; 6], payload_kg: None, tcp_m: None },
            dh: Some(dh),
        }
    }

    #[test]
    fn measures_are_written_into_the_body_of_the_arm_that_was_found() {
        let ur5e = found([-0.425, -0.3922, 0.0], 0.1625);
        let text = written(&ur5e, &ur5e.dh.unwrap()).unwrap();
        let body = |text: &str| text.matches("<collision").count();
        assert_eq!(body(&text), body(presets::robot("ur5e").unwrap()));
        assert!(text.contains("ur5e"), "the description of a UR5e, whatever the settings name");
    }

    #[test]
    fn an_arm_without_a_description_is_refused_by_its_name() {
        let ur10e = found([-0.6127, -0.57155, 0.0], 0.1807);
        let refused = written(&ur10e, &ur10e.dh.unwrap()).unwrap_err().to_string();
        assert!(refused.contains("a UR10e or UR12e") && refused.contains("no description"), "{refused}");
    }
}
