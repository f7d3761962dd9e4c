//! Unstable settings are refused with a value that works, and that value works.

use foretrace_config::Draft;
use rand::SeedableRng;
use rand_pcg::Pcg64;

use super::drive::{self, Length};
use super::wrong;

#[test]
fn a_jerk_that_is_too_little_is_refused_with_one_that_is_not() {
    for (axis, would) in [("x", 160), ("y", 160), ("z", 80)] {
        let with = |jerk: f64| {
            Draft::preset("ur5").set(&format!("mpc.limits.{axis}.jerk_mps3"), &format!("{jerk:?}")).finish()
        };
        let refused = with(20.0).unwrap_err().to_string();
        assert!(
            refused.contains(&format!("{would} m/s³ would do")) && refused.contains("jerk_mps3"),
            "{refused}"
        );
        let config = with(f64::from(would) + 1.0).unwrap();
        for seed in 0..8 {
            let seen = drive::live(&config, &mut Pcg64::seed_from_u64(seed), Length::LONG);
            println!("{axis}, {seed}, {}: {:?}", seen.pen, wrong(&config, &seen));
            assert_eq!(wrong(&config, &seen), Vec::<String>::new(), "{axis}: {}", seen.pen);
        }
    }
}

/// The number before `unit` in a refusal.
fn suggested(refused: &str, unit: &str) -> f64 {
    let before = refused.split(&format!(" {unit}")).next().unwrap();
    before
        .rsplit(' ')
        .next()
        .unwrap()
        .parse()
        .unwrap_or_else(|_| panic!("no number before {unit}: {refused}"))
}

#[test]
fn joints_that_could_not_ease_are_refused_with_a_jerk_that_does() {
    let with = |jerk: f64| {
        let list = ["10000.0", "10000.0", "10000.0", "10000.0", &format!("{jerk:?}"), "10000.0"].join(", ");
        Draft::preset("ur5e").set("robot.jerk_radps3", &format!("[{list}]")).finish()
    };
    let refused = with(1.0).unwrap_err().to_string();
    assert!(refused.contains("joint 4") && refused.contains("robot.jerk_radps3"), "{refused}");
    let config = with(suggested(&refused, "rad/s³ would do")).unwrap();
    for seed in 0..8 {
        let seen = drive::live(&config, &mut Pcg64::seed_from_u64(seed), Length::LONG);
        assert_eq!(wrong(&config, &seen), Vec::<String>::new(), "{}", seen.pen);
    }
}

/// Gains that settle far from the limits and oscillate when saturated.
#[test]
fn a_hurry_that_swings_at_the_limits_is_refused_with_a_gain_that_does_not() {
    let with = |gain: f64| {
        let draft = Draft::preset("ur5").rate(125).set("mpc.feedback.position", &format!("{gain:?}"));
        draft.finish()
    };
    let refused = with(1000.0).unwrap_err().to_string();
    assert!(refused.contains("does not come to rest") && refused.contains("mpc.feedback"), "{refused}");
    let (_, suggested) =
        refused.split_once("a feedback gain on position of ").unwrap_or_else(|| panic!("{refused}"));
    let config = with(suggested.split(' ').next().unwrap().parse().unwrap()).unwrap();
    for seed in 0..8 {
        let seen = drive::live(&config, &mut Pcg64::seed_from_u64(seed), Length::LONG);
        assert_eq!(wrong(&config, &seen), Vec::<String>::new(), "{}", seen.pen);
    }
}
