//! Whether the arm gets everywhere on the new paper, upright and inside its limits.
//!
//! Contract: a grid over the whole workspace, on the paper (as deep as the pen presses) and lifted. Each
//! point is solved from its neighbour, as the arm would move; the tool stands exactly upright in every
//! solution, so what needs a tilt counts as out of reach.

use foretrace_config::settings::PlaneSection;
use foretrace_config::{JOINTS, Robot};
use foretrace_control::ik::{ToolTarget, solve_pose};
use nalgebra::Vector3;

/// Points along each side of the paper.
const SIDE: usize = 9;

/// The first place of `plane` that is out of reach, in words.
pub fn missing(plane: &PlaneSection, robot: &Robot) -> Option<String> {
    let rotation = plane.rotation();
    let (origin, axis) = (Vector3::from(plane.origin_m), -(rotation * Vector3::z()));
    let solve = |seed: &[f64; JOINTS], [x, y, z]: [f64; 3]| {
        let target = ToolTarget::at_rest(origin + rotation * Vector3::new(x, y, z), axis, None);
        solve_pose(&robot.chain, seed, &target)
    };
    let [[x_min, x_max], [y_min, y_max], _] = plane.workspace_m;
    let at = |share: usize, low: f64, high: f64| low + (high - low) * share as f64 / (SIDE - 1) as f64;
    let lift = plane.lift_height_m;
    let Some(mut row_seed) =
        solve(&robot.home, [at(SIDE / 2, x_min, x_max), at(SIDE / 2, y_min, y_max), lift])
    else {
        return Some("the middle of the paper is out of reach from robot.home_rad".to_owned());
    };
    for row in 0..SIDE {
        let mut seed = row_seed;
        for column in 0..SIDE {
            let (x, y) = (at(column, x_min, x_max), at(row, y_min, y_max));
            for z in [lift, -plane.press_m] {
                let place = || format!("x = {x:.3}, y = {y:.3}, z = {z:.3} m of the plane");
                let Some(q) = solve(&seed, [x, y, z]) else {
                    return Some(format!("{} is out of reach with an upright tool", place()));
                };
                let names = &robot.chain.limits().names;
                let bounds = robot.limits.position().iter();
                for ((name, q), [low, high]) in names.iter().zip(&q).zip(bounds) {
                    if !(*low..=*high).contains(q) {
                        return Some(format!(
                            "{} needs joint `{name}` at {q:.3} rad ({low:.3} to {high:.3})",
                            place()
                        ));
                    }
                }
                if z == lift {
                    seed = q;
                    if column == 0 {
                        row_seed = q;
                    }
                }
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;

    #[test]
    fn the_presets_reach_their_whole_paper() {
        for preset in ["ur5", "ur5e"] {
            let config = Config::preset(preset).unwrap();
            assert_eq!(missing(&config.settings().plane, config.robot()), None, "{preset}");
        }
    }

    #[test]
    fn the_first_place_out_of_reach_is_named() {
        let config = Config::preset("ur5").unwrap();
        let mut plane = config.settings().plane.clone();
        plane.workspace_m[0] = [-0.1, 1.5];
        let told = missing(&plane, config.robot()).unwrap();
        assert!(told.contains("of the plane"), "{told}");
        plane.origin_m = [2.5, 0.0, 0.0];
        assert!(missing(&plane, config.robot()).unwrap().contains("middle of the paper"));
    }
}
