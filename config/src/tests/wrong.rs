//! Files with a mistake, and the message about each.

use super::{over_ur5, problems};
use crate::problem::ProblemKind;
use crate::{Config, Draft, Problem};

/// The one message about `text` placed under the UR5 preset.
fn message(text: &str) -> String {
    let error = over_ur5(text).unwrap_err();
    assert_eq!(error.problems().len(), 1, "{error}");
    error.to_string()
}

#[test]
fn negative_limit_names_file_line_key_value_and_range() {
    let text = message("[mpc.limits.x]\njerk_mps3 = -5\n");
    assert!(
        text.starts_with("table.toml:3: key `mpc.limits.x.jerk_mps3` = -5 is outside 1 to 100000 m/s^3: "),
        "{text}"
    );
}

#[test]
fn unknown_key_suggests_the_nearest() {
    let text = message("[mpc]\nhorizn = 10\n");
    assert!(text.contains("table.toml:3") && text.contains("`mpc.horizn`"), "{text}");
    assert!(text.contains("did you mean `mpc.horizon`?"), "{text}");
}

#[test]
fn key_in_the_wrong_section_is_shown_the_right_one() {
    let text = message("[plane]\nmax_speed_mps = 3\n");
    assert!(text.contains("`pen.max_speed_mps`"), "{text}");
    let text = message("rate_hz = 500\n");
    assert!(text.contains("`loop.rate_hz`"), "{text}");
}

#[test]
fn unknown_section_suggests_the_nearest_and_is_reported_once() {
    let text = message("[mcp]\nhorizon = 10\neffort = 1\n");
    assert!(text.contains("`[mcp]`") && text.contains("`[mpc]`"), "{text}");
    let text = message("[limits.x]\njerk_mps3 = 10\n");
    assert!(text.contains("`[limits]`"), "{text}");
}

#[test]
fn key_with_another_unit_is_shown_which_unit_counts() {
    let text = message("[plane]\nlift_height_mm = 20\n");
    assert!(
        text.contains("did you mean `plane.lift_height_m`? It takes the unit m; convert the value"),
        "{text}"
    );
    let text = message("[timing]\ndead_time_s = 0.035\n");
    assert!(text.contains("`timing.dead_time_ms`"), "{text}");
}

#[test]
fn value_in_another_unit_is_recognised() {
    let text = message("[robot]\nvelocity_radps = [3, 3, 3, 180, 3, 3]\n");
    assert!(
        text.contains("`robot.velocity_radps[3]` = 180") && text.contains("looks like degrees"),
        "{text}"
    );
    let same = message("[robot]\nvelocity_radps = [180, 180, 180, 180, 180, 180]\n");
    assert!(same.contains("`robot.velocity_radps[0]` = 180"), "{same}");
    let text = message("[plane]\nlift_height_m = 20\n");
    assert!(text.contains("looks like mm") && text.contains("0.02"), "{text}");
    let text = message("[pen]\nstale_ms = 0.1\n");
    assert!(text.contains("looks like seconds") && text.contains("100"), "{text}");
}

#[test]
fn wrong_types_say_what_was_found_and_what_is_taken() {
    for (text, found, wanted) in [
        ("[loop]\nrate_hz = \"500\"\n", "is text", "a whole number"),
        ("[loop]\nrate_hz = 500.0\n", "is a number", "a whole number"),
        ("[loop]\nlock_memory = 1\n", "is a whole number", "true or false"),
        ("[plane]\norigin_m = [0.1, 0.2]\n", "is a list", "list of 3"),
        ("[plane]\norigin_m = 0.1\n", "is a number", "list of 3"),
        ("[predictor]\nkind = 3\n", "is a whole number", "\"dybm\""),
        ("[predictor.dybm]\ndecays = []\n", "is a list", "list: "),
        ("[robot]\nurdf = \"\"\n", "is text", "not empty"),
        ("[pen]\nstep_ms = 1979-05-27\n", "is a date", "a whole number"),
        ("[pen]\nstep_ms = 99999999999999999999\n", "beyond 64 bits", "a whole number"),
        ("[loop.rate_hz]\na = 1\n", "is a section", "a whole number"),
        ("loop = 5\n", "is a whole number", "a section"),
    ] {
        let message = message(text);
        assert!(message.contains(found) && message.contains(wanted), "{text} -> {message}");
    }
}

#[test]
fn not_a_number_and_infinity_are_refused() {
    for value in ["nan", "+nan", "inf", "-inf", "1e999"] {
        let text = message(&format!("[mpc]\neffort = {value}\n"));
        assert!(text.contains("`mpc.effort`") && text.contains("1e-6 to 1000"), "{text}");
    }
    let text = message("[plane]\norigin_m = [0.1, nan, 0.2]\n");
    assert!(text.contains("`plane.origin_m[1]` = nan is not finite"), "{text}");
}

#[test]
fn wrong_word_suggests_the_nearest() {
    let text = message("[predictor]\nkind = \"dybn\"\n");
    assert!(text.contains("did you mean \"dybm\"?"), "{text}");
    // Its earlier name.
    let text = message("[predictor]\nkind = \"ours\"\n");
    assert!(text.contains("did you mean \"mixture\"?"), "{text}");
    let text = message("[predictor.ours]\nrate = 1.0\n");
    assert!(text.contains("`[predictor.ours]`") && text.contains("`[predictor.mixture]`"), "{text}");
    let text = message("[loop]\nrate_hz = 300\n");
    assert!(text.contains("125, 250, 500, 1000 Hz"), "{text}");
}

#[test]
fn all_problems_are_reported_in_the_order_of_the_file() {
    let found =
        problems("[loop]\nspin_us = -1\nspinn_us = 3\n[mpc]\neffort = nan\n[predictor]\nkind = \"x\"\n");
    let lines: Vec<String> = found.iter().map(|problem| problem.origin.to_string()).collect();
    assert_eq!(lines, ["table.toml:3", "table.toml:4", "table.toml:6", "table.toml:8"]);
}

#[test]
fn missing_keys_are_all_named_with_a_starting_point() {
    let error = Config::parse("[loop]\nrate_hz = 500\n", "table.toml", ".").unwrap_err();
    let required = crate::keys().iter().filter(|key| key.presence == crate::Presence::Required).count();
    assert_eq!(error.problems().len(), required - 1);
    let text = error.to_string();
    assert!(
        text.contains("table.toml: key `pen.step_ms` is missing") && text.contains("preset = \"ur5\""),
        "{text}"
    );
}

#[test]
fn unknown_preset_lists_the_presets_and_nothing_else() {
    let error = Config::parse("preset = \"ur7\"\n", "table.toml", ".").unwrap_err();
    assert_eq!(
        error.to_string(),
        "table.toml:1: preset = \"ur7\" is unknown: the presets are \"ur5\", \"ur5e\", \"ur5-first-run\""
    );
    assert!(Config::preset("ur7").is_err());
    assert!(Config::parse("preset = 5\n", "table.toml", ".").is_err());
}

#[test]
fn every_syntax_error_has_its_line() {
    let error =
        Config::parse("preset = \"ur5\"\n[loop]\nrate_hz = \nspin_us 3\n", "table.toml", ".").unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("table.toml:3: not valid TOML") && text.contains("table.toml:4: not valid TOML"),
        "{text}"
    );
    assert!(!text.contains("missing"), "{text}");
}

#[test]
fn one_open_bracket_does_not_bury_its_cause() {
    let whole = Config::preset("ur5").unwrap().render();
    let broken = whole.replacen("home_rad = [", "home_rad = [[", 1);
    assert_ne!(whole, broken);
    let line = 1 + broken.lines().position(|line| line.starts_with("home_rad")).unwrap();
    let text = Config::parse(&broken, "table.toml", ".").unwrap_err().to_string();
    assert!(text.lines().count() <= 9 && text.contains("more lines cannot be read"), "{text}");
    let first: usize = text.split(':').nth(1).unwrap().parse().unwrap();
    assert!((line..line + 5).contains(&first), "line {line} is broken: {text}");
}

#[test]
fn a_key_given_twice_is_a_syntax_error() {
    assert!(message("[loop]\nrate_hz = 500\nrate_hz = 1000\n").contains("table.toml:4"));
}

#[test]
fn a_quoted_name_with_a_dot_is_not_a_path() {
    assert!(matches!(
        &problems("\"loop.rate_hz\" = 500\n")[..],
        [Problem { kind: ProblemKind::UnknownKey { .. }, .. }]
    ));
}

#[test]
fn missing_file_and_wrong_encoding_say_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("none.toml");
    let text = Config::load(&path).unwrap_err().to_string();
    assert!(
        text.contains("none.toml: cannot be read") && text.contains("foretrace config show ur5"),
        "{text}"
    );
    assert!(Config::load(folder.path()).is_err());
    std::fs::write(&path, b"preset = \"ur5\"\n# caf\xe9\n").unwrap();
    let text = Config::load(&path).unwrap_err().to_string();
    assert!(text.contains("not UTF-8") && text.contains("line 2"), "{text}");
    std::fs::write(&path, b"preset = \"ur5\"\n").unwrap();
    assert!(Config::load(&path).is_ok());
}

#[test]
fn contradictions_name_both_sides() {
    for (text, key, other) in [
        ("[loop]\nrate_hz = 125\n", "pen.step_ms", "use 8, 16 ms"),
        ("[loop]\nrate_hz = 250\n", "pen.step_ms", "use 4, 8, 12, 16, 20 ms"),
        ("[plane]\nx_axis = [0.0, -0.9, 0.0]\n", "plane.x_axis", "[0.000000, -1.000000, 0.000000]"),
        ("[plane]\nx_axis = [0.0, 0.0, 0.0]\n", "plane.x_axis", "plane.x_axis"),
        (
            "[plane]\nworkspace_m = [[-0.1, -0.0999], [-0.1, 0.1], [-0.005, 0.06]]\n",
            "plane.workspace_m",
            "narrower than 1 mm",
        ),
        ("[plane]\nlift_height_m = 0.1\n", "plane.lift_height_m", "z range"),
        (
            "[plane]\nworkspace_m = [[0.1, -0.1], [-0.1, 0.1], [-0.005, 0.06]]\n",
            "plane.workspace_m",
            "x range that is empty",
        ),
        ("[pen]\nbounds_m = [[-0.5, 0.5], [0.5, 0.5]]\n", "pen.bounds_m", "y range that is empty"),
        ("[pen]\nmax_gap_ms = 15\n", "pen.max_gap_ms", "pen.step_ms = 10"),
        ("[pen]\nmax_gap_ms = 400\nstale_ms = 400\n", "pen.max_gap_ms", "use 20 to 320 ms"),
        ("[pen]\nstale_ms = 600\n", "mpc.horizon", "room for 64"),
        (
            "[timing]\ndead_time_ms = 10\nservo_filter_ms = 30\n",
            "timing.servo_filter_ms",
            "more than timing.dead_time_ms = 10",
        ),
        ("[instance]\nroot_dir = \"run/foretrace\"\n", "instance.root_dir", "absolute path"),
        ("[ik]\ngain_hz = 600\n", "ik.gain_hz", "500 Hz"),
        ("[predictor.scale]\ninitial_m = 1e-8\n", "predictor.scale.initial_m", "1e-7"),
        ("[pen]\nstale_ms = 40\n", "pen.stale_ms", "pen.max_gap_ms = 100"),
        ("[safety]\njoint_state_timeout_ms = 10\n", "safety.joint_state_timeout_ms", "16 ms"),
        ("[safety]\nlatch_after_ms = 10\n[loop]\nvalid_periods = 20\n", "safety.latch_after_ms", "40 ms"),
        ("[predictor.dybm]\ndecays = [0.1, 0.2, 0.3, 0.4, 0.5]\n", "predictor.dybm.decays", "4 traces"),
        ("[predictor.dybm]\noptimiser = \"adam\"\nrate = 0.1\n", "predictor.dybm.rate", "0.001"),
    ] {
        let error = over_ur5(text).unwrap_err().to_string();
        assert!(error.contains(&format!("key `{key}`")) && error.contains(other), "{text} -> {error}");
    }
}

#[test]
fn axes_that_are_not_at_right_angles_are_refused() {
    let error =
        over_ur5("[plane]\nx_axis = [0.6, 0.0, 0.8]\nnormal = [0.0, 0.0, 1.0]\n").unwrap_err().to_string();
    assert!(error.contains("right angles") && error.contains("0.8000"), "{error}");
}

#[test]
fn a_predictor_of_an_earlier_name_is_refused_with_its_new_one_and_translated_in_a_recording() {
    for (old, now) in [("ours", "mixture"), ("dybm-online", "dybm"), ("zero", "hold")] {
        let settings = format!("preset = \"ur5\"\n[predictor]\nkind = \"{old}\"\n");
        let refused = Config::parse(&settings, "table.toml", ".").unwrap_err().to_string();
        assert!(refused.contains(&format!("did you mean \"{now}\"?")), "{refused}");
        let recorded = Config::recorded(&settings).unwrap();
        assert_eq!(recorded.settings().predictor.kind.name(), now);
    }
    let section = "preset = \"ur5\"\n[predictor.ours]\nnetwork = \"none\"\n";
    assert!(Config::parse(section, "table.toml", ".").is_err());
    assert_eq!(
        Config::recorded(section).unwrap().settings().predictor.mixture.network.as_deref(),
        Some("none")
    );
    assert!(Config::recorded("preset = \"ur5\"\n[predictor]\nkind = \"hers\"\n").is_err());
}

#[test]
fn a_key_that_is_gone_is_refused_with_the_reason_and_reported_of_a_recording() {
    let settings = "preset = \"ur5\"\n[trust]\nproof_cases = 20\nramp_steps = 7\n";
    let refused = Config::parse(settings, "table.toml", ".").unwrap_err().to_string();
    assert!(refused.contains("table.toml:3") && refused.contains("`trust.proof_cases`"), "{refused}");
    assert!(refused.contains("is gone") && refused.contains("leave the line out"), "{refused}");
    assert!(Draft::preset("ur5").set("trust.proof_cases", "1").finish().is_err());

    let recorded = Config::recorded(settings).unwrap();
    assert_eq!(recorded.settings().trust.ramp_steps, 7, "the keys beside it count");
    let [gone] = recorded.gone().try_into().unwrap();
    assert!(gone.contains("`trust.proof_cases`") && gone.contains("is gone"), "{gone}");
    // A change on top of it is judged like any other.
    let changed = Draft::recorded(settings).set("trust.ramp_steps", "9").finish().unwrap();
    assert_eq!((changed.settings().trust.ramp_steps, changed.gone().len()), (9, 1));
    assert!(Draft::recorded(settings).set("trust.proof_cases", "1").finish().is_err());
    assert!(Draft::preset("ur5").finish().unwrap().gone().is_empty());
}
