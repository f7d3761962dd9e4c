//! `foretrace calibrate kinematics`: what the factory measured of an arm, into a URDF for the settings.
//!
//! Contract: reads the controller's primary interface; moves nothing.

use std::path::PathBuf;

use foretrace_config::{Config, presets};
use foretrace_report::failures::DOCTOR;
use foretrace_ur::bridge::check::ANOTHER_ARM_MM;
use foretrace_ur::bridge::kinematics::{Deviation, DhParameters, deviation, fitting_base, tool_from_flange};
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
    tell(&dh, deviation, &config);
    if let Some(out) = &args.out {
        write_file(out, &written(&found, &dh)?, "--out")?;
        say!("\nwritten to {}; put into the settings, beside your own values:\n", out.display());
        say!("{}", to_write(&dh, &config, &out.display().to_string()));
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

/// The lines for the settings that take a written file `name` instead of the model of `config`, and what of
/// theirs has to be written anew with it.
fn to_write(dh: &DhParameters, config: &Config, name: &str) -> String {
    let robot = &config.settings().robot;
    let mut text = format!(
        "[robot]\nurdf = {name:?}  # relative to the settings file\nbase_link = \"base_link\"\n\
         tip_link = \"tool0\"\n"
    );
    // To hundredths of a millimetre: the model's own error is in it.
    let rounded = |tool: [f64; 3]| tool.map(|x| (x * 1e5).round() / 1e5 + 0.0);
    match (tool_from_flange(dh, config, ANOTHER_ARM_MM), robot.ur.tcp_m) {
        (Some(tool), _) if apart(&tool, &robot.tool_m) < CLOSE_M => {
            text += &format!("tool_m = {:?}\n", robot.tool_m)
        }
        (Some(tool), _) => {
            text += &format!("tool_m = {:?}  # as the present model has it: compare\n", rounded(tool));
        }
        (None, Some(tcp)) => text += &format!("tool_m = {tcp:?}  # robot.ur.tcp_m: compare\n"),
        (None, None) => {
            text += &format!(
                "tool_m = {:?}  # the present model does not fit: measure where the pen's tip is, seen from the \
                 flange\n",
                robot.tool_m
            );
        }
    }
    let frame = NewFrame::of(dh, config);
    if robot.ur.base_turned {
        text += "[robot.ur]\nbase_turned = false  # the file has the controller's own base frame\n";
    }
    let clearance = &config.settings().clearance;
    let kept = [
        ("planes_m", clearance.planes_m.as_ref().map_or(0, Vec::len)),
        ("boxes_m", clearance.boxes_m.as_ref().map_or(0, Vec::len)),
    ];
    let kept: Vec<String> =
        kept.iter().filter(|(_, count)| *count > 0).map(|(key, count)| format!("{key} ({count})")).collect();
    let kept = if kept.is_empty() { "none is set here".to_owned() } else { kept.join(" and ") };
    text += "\nThen calibrate [plane] again: it was measured with the other model.";
    match frame {
        NewFrame::Same => {}
        NewFrame::Turned => {
            text += &format!(
                "\n\nThe base frame turns by 180 degrees about z with it. In [clearance] ({kept}), and in \
                 whatever else is written in the base frame, x and y change their sign: of each point, \
                 centre and normal; yaw of a box grows by 3.14159. As they are, keep-outs stand mirrored, on \
                 the wrong side of the arm. The first angle of robot.home_rad changes by 3.14159 as well, if \
                 the home was over the paper."
            );
        }
        NewFrame::Other => {
            text += &format!(
                "\n\nThe base frame changes with it, to the one that the pendant shows. Write [clearance] \
                 ({kept}), and whatever else is written in the base frame, anew: as they are, keep-outs \
                 stand elsewhere."
            );
        }
    }
    text
}

/// How the controller's base frame stands in that of the present model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum NewFrame {
    Same,
    /// By 180 degrees about z.
    Turned,
    /// Elsewhere, or nobody knows.
    Other,
}

impl NewFrame {
    fn of(dh: &DhParameters, config: &Config) -> Self {
        let turned = config.settings().robot.ur.base_turned;
        match deviation(dh, config) {
            Some(off) if off.most_mm <= ANOTHER_ARM_MM && !turned => Self::Same,
            Some(off) if off.most_mm <= ANOTHER_ARM_MM => Self::Turned,
            Some(off) if off.turned_mm <= ANOTHER_ARM_MM && turned => Self::Same,
            Some(off) if off.turned_mm <= ANOTHER_ARM_MM => Self::Turned,
            _ => Self::Other,
        }
    }
}

/// Tools nearer to each other than this are the same \[m\].
const CLOSE_M: f64 = 1e-3;

fn apart(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

/// What a model that is off by `off` has wrong in its base frame, if that explains it.
fn frame_words(off: &Deviation, dh: &DhParameters, config: &Config) -> Option<String> {
    if off.most_mm <= ANOTHER_ARM_MM {
        return None;
    }
    let turned = config.settings().robot.ur.base_turned;
    let base = config.robot().chain.ends().0;
    if off.turned_mm <= ANOTHER_ARM_MM {
        return Some(format!(
            "turned by 180 degrees about z it is off by {:.2} mm: the base frame of the model, link `{base}`, {} \
             the controller's, and robot.ur.base_turned = {turned} says otherwise",
            off.turned_mm,
            if turned { "is" } else { "is turned against" },
        ));
    }
    let fits = fitting_base(dh, config, ANOTHER_ARM_MM)?;
    Some(format!(
        "in the frame of link `{}`{} the model fits: `{base}`, its base link, stands elsewhere than the \
         controller's base frame",
        fits.link,
        if fits.turned { ", turned by 180 degrees about z," } else { "" },
    ))
}

fn tell(dh: &DhParameters, deviation: Option<Deviation>, config: &Config) {
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
            if let Some(words) = frame_words(&off, dh, config) {
                say!("{words}");
            }
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
    use std::sync::Arc;

    use foretrace_config::Draft;
    use foretrace_config::files::Files;
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

    /// The embedded UR5 as a file with `more` at its end, and settings over it.
    fn config(more: &str, robot: &str) -> Config {
        let urdf = presets::robot("ur5").unwrap().replace("\"base_link\"", "\"inner\"");
        let ends = "<link name=\"base_link\"/><joint name=\"t\" type=\"fixed\"><parent link=\"base_link\"/><child \
                    link=\"inner\"/><origin rpy=\"0 0 3.14159265\"/></joint>";
        let urdf = urdf.replace("</robot>", &format!("{ends}{more}</robot>"));
        let files = Files::Only(Arc::new([(PathBuf::from("/arm/arm.urdf"), urdf.into_bytes())].into()));
        let text = format!("preset = \"ur5\"\n[robot]\nurdf = \"arm.urdf\"\n{robot}");
        Draft::text(&text, "t.toml", "/arm").files(files).finish().unwrap()
    }

    const ROS: &str = "tool_m = [0.0, 0.0, 0.15]\nhome_rad = [0.0, -1.3, 1.8, -2.0708, -1.5708, 0.0]\n";
    const KEPT: &str = "[clearance]\nplanes_m = [[[0.0, 0.0, -0.2], [0.0, 0.0, 1.0]], [[-0.6, 0.0, 0.0], [1.0, 0.0, 0.0]]]\n";

    #[test]
    fn keep_outs_that_a_new_base_frame_mirrors_are_told() {
        let dh = found([-0.425, -0.39225, 0.0], 0.089159)
            .dh
            .map(|dh| DhParameters { d: [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823], ..dh });
        let dh = dh.unwrap();
        let words = |robot: &str| {
            let config = config("", robot);
            let off = deviation(&dh, &config).unwrap();
            (to_write(&dh, &config, "new.urdf"), frame_words(&off, &dh, &config).unwrap_or_default())
        };
        // Said or not, the frame of the settings is turned against that of the file.
        for said in ["", "[robot.ur]\nbase_turned = true\n"] {
            let (text, frame) = words(&format!("{ROS}{said}{KEPT}"));
            assert!(text.contains("planes_m (2)") && text.contains("x and y change their sign"), "{text}");
            assert!(text.contains("mirrored") && text.contains("tool_m = [0.0, 0.0, 0.15]"), "{text}");
            assert_eq!(text.contains("base_turned = false"), !said.is_empty());
            assert_eq!(
                frame.contains("turned by 180 degrees about z it is off by 0.0"),
                said.is_empty(),
                "{frame}"
            );
        }
        let inner = format!("base_link = \"inner\"\n{}{KEPT}", ROS.replace("[0.0, -1.3", "[3.1416, -1.3"));
        let (text, frame) = words(&inner);
        assert!(!text.contains("180 degrees") && !text.contains("anew") && frame.is_empty(), "{text}{frame}");
        // A model of another arm: nobody knows what its frame is.
        let mut other = dh;
        other.a[1] -= 0.2;
        let config = config("", &format!("{ROS}{KEPT}"));
        let text = to_write(&other, &config, "new.urdf");
        assert!(
            text.contains("planes_m (2)") && text.contains("anew") && text.contains("measure where"),
            "{text}"
        );
    }

    #[test]
    fn a_pen_that_is_a_link_is_in_the_tool_of_the_written_file() {
        let mut dh = found([-0.425, -0.39225, 0.0], 0.089159).dh.unwrap();
        dh.d = [0.089159, 0.0, 0.0, 0.10915, 0.09465, 0.0823];
        let pen = "<link name=\"pen\"/><joint name=\"p\" type=\"fixed\"><parent link=\"tool0\"/><child \
                   link=\"pen\"/><origin xyz=\"0 0 0.15\"/></joint>";
        let robot = format!("{}tip_link = \"pen\"\n", ROS.replace("0.15]", "0.0]"));
        let text = to_write(&dh, &config(pen, &robot), "new.urdf");
        assert!(text.contains("tip_link = \"tool0\"\ntool_m = [0.0, 0.0, 0.15]"), "{text}");
    }
}
