//! The distances that the daemon keeps within the arm, for judges of its shapes (`tests/shapes/judge.sh`).
//!
//! `cargo run --release -p foretrace-config --example own_distances PRESET < POSES`: the first line is what
//! does not change, as JSON: the margin [m], home [rad], joints with their fixed transforms (rows of a 3 x 4
//! matrix, [m]), axes and limits [rad], capsules in the frame of the joint before their link [m], and pairs
//! of them. Then, for every line of six joint positions [rad], a line with each pair's distance [m].

use std::io::{BufRead, BufWriter, Write};

use foretrace_config::Config;
use foretrace_control::arm::Capsule;
use foretrace_control::clearance::Clearance;
use serde_json::json;

type Fallible<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> Fallible<()> {
    let name =
        std::env::args().nth(1).ok_or("own_distances PRESET < POSES: the name of a preset is missing")?;
    let config = Config::preset(&name)?;
    let robot = config.robot();
    let settings = robot.clearance.as_ref().ok_or("this preset keeps away from nothing")?;
    let period_s = config.settings().period_ns() as f64 * 1e-9;
    let clearance = Clearance::new(&robot.chain, &robot.limits, period_s, settings)?;

    let all: Vec<&Capsule> = robot.chain.capsules().iter().collect();
    let number = |capsule: &Capsule| all.iter().position(|other| *other == capsule);
    let at_home = robot.chain.forward(&robot.home);
    let pairs: Vec<_> = clearance.distances_within(&at_home).map(|(pair, _)| pair.map(number)).collect();
    let capsules: Vec<_> = all
        .iter()
        .map(|capsule| {
            let [from, to] = [capsule.segment.from, capsule.segment.to].map(<[f64; 3]>::from);
            json!({ "name": capsule.name, "link": capsule.link, "from": from, "to": to, "radius": capsule.radius })
        })
        .collect();
    let out = &mut BufWriter::new(std::io::stdout().lock());
    writeln!(
        out,
        "{}",
        json!({
            "margin_m": settings.margin_m, "home_rad": robot.home, "limits_rad": robot.limits.position(),
            "capsules": capsules, "pairs": pairs,
        })
    )?;
    for (at, line) in std::io::stdin().lock().lines().enumerate() {
        let numbers: Result<Vec<f64>, _> = line?.split_whitespace().map(str::parse).collect();
        let q = numbers.ok().and_then(|numbers| numbers.try_into().ok());
        let q: [f64; 6] = q.ok_or_else(|| format!("line {} does not hold six numbers", at + 1))?;
        let kinematics = robot.chain.forward(&q);
        for (index, (_, distance)) in clearance.distances_within(&kinematics).enumerate() {
            write!(out, "{}{distance}", if index == 0 { "" } else { " " })?;
        }
        writeln!(out)?;
    }
    Ok(())
}
