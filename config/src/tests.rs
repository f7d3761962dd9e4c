//! Claims about whole files: presets, rendering, reloading, documentation.

use std::path::PathBuf;

use crate::live::values;
use crate::{Config, ConfigError, Draft, Problem, SettingOrigin, presets};
use documents::{commented, key_table};

mod documents;
mod wrong;
mod arm;
mod headroom;
mod law;
mod others;
mod hostile;

/// A file that starts from the UR5 preset and adds `text`.
pub(crate) fn over_ur5(text: &str) -> Result<Config, ConfigError> {
    Config::parse(&format!("preset = \"ur5\"\n{text}"), "table.toml", ".")
}

/// Presets by name, and where their text lives in the repository.
fn preset_files() -> [(&'static str, PathBuf); 3] {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("presets");
    ["ur5", "ur5e", "ur5-first-run"].map(|name| (name, folder.join(format!("{name}.toml"))))
}

/// True when the run is meant to rewrite files that are made from the table of keys.
fn blessing() -> bool {
    std::env::var_os("FORETRACE_BLESS").is_some()
}

#[test]
fn presets_explain_every_key_as_the_table_does() {
    for (name, path) in preset_files() {
        let text = presets::text(name).unwrap();
        let wanted = commented(text, &Config::preset(name).unwrap());
        if blessing() {
            std::fs::write(&path, &wanted).unwrap();
        } else {
            assert!(text == wanted, "{} is out of step: run with FORETRACE_BLESS=1", path.display());
        }
    }
}

#[test]
fn a_preset_over_another_has_only_what_differs_and_says_where_each_value_stands() {
    let (below, above) = (Config::preset("ur5").unwrap(), Config::preset("ur5e").unwrap());
    let [of_below, of_above] = [&below, &above].map(|config| values(config.settings()));
    let mut own = Vec::new();
    for key in crate::keys() {
        let Some(SettingOrigin::Preset { name, line }) = above.origin(&key.path) else { continue };
        let text = presets::text(name).unwrap().lines().nth(line - 1).unwrap();
        let bare = key.path.rsplit('.').next().unwrap();
        assert!(text.starts_with(&format!("{bare} = ")), "{}: {name}:{line} is {text}", key.path);
        if name.as_ref() == "ur5e" {
            own.push(key.path.as_str());
        }
    }
    let differing = crate::keys().iter().map(|key| key.path.as_str());
    let differing: Vec<&str> = differing.filter(|key| of_below[*key] != of_above[*key]).collect();
    assert_eq!(own, differing);
    let shown = above.render();
    assert!(shown.contains("dead_time_ms = 35.0  # from preset ur5e:"), "{shown}");
    assert!(shown.contains("tip_link = \"tool0\"  # from preset ur5:"), "{shown}");
}

/// Prose at the width of the documents; rows of tables and headings stay as they are.
fn wrapped(text: &str) -> String {
    const WIDTH: usize = 110;
    let mut out = String::new();
    for line in text.lines() {
        let mut width = 0;
        for word in line.split(' ') {
            let length = word.chars().count();
            if width > 0 && width + 1 + length > WIDTH && !line.starts_with(['|', '#']) {
                out.push('\n');
                width = 0;
            } else if width > 0 {
                out.push(' ');
                width += 1;
            }
            out.push_str(word);
            width += length;
        }
        out.push('\n');
    }
    out
}

#[test]
fn the_documents_list_every_key_as_the_table_does() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/configure/settings.md");
    let text = std::fs::read_to_string(&path).unwrap();
    let (head, rest) = text.split_once("<!-- keys: begin -->").unwrap();
    let (_, tail) = rest.split_once("<!-- keys: end -->").unwrap();
    let keys = wrapped(&key_table());
    let wanted = format!("{head}<!-- keys: begin -->\n{keys}<!-- keys: end -->{tail}");
    if blessing() {
        std::fs::write(&path, &wanted).unwrap();
    } else {
        assert!(text == wanted, "{} is out of step: run with FORETRACE_BLESS=1", path.display());
    }
}

#[test]
fn rendered_presets_read_back_as_the_same_settings() {
    for (name, _) in preset_files() {
        let config = Config::preset(name).unwrap();
        let again = Config::parse(&config.render(), "rendered.toml", ".").unwrap();
        assert_eq!(config.settings(), again.settings(), "{name}");
        assert_eq!(again.render().lines().count(), config.render().lines().count());
    }
}

#[test]
fn rendering_keeps_optional_keys_and_odd_numbers() {
    let config = over_ur5(
        "[loop]\ncpu = 1\n[instance]\nroot_dir = \"/tmp/a \\\"b\\\"\"\n[mpc]\neffort = \
         0.1000000000000000055\n\
         [robot]\njerk_radps3 = [1e4, 1e4, 1e4, 1e4, 1e4, 1234.56]\n",
    )
    .unwrap();
    let again = Config::parse(&config.render(), "rendered.toml", ".").unwrap();
    assert_eq!(config.settings(), again.settings());
    assert_eq!(again.settings().control_loop.cpu, Some(1));
}

#[test]
fn rendering_says_where_each_value_comes_from() {
    let config = Draft::text("preset = \"ur5\"\n\n[trust]\nramp_steps = 20\n", "table.toml", ".")
        .set("loop.rate_hz", "1000")
        .finish()
        .unwrap();
    let shown = config.render();
    assert!(shown.contains("ramp_steps = 20  # from table.toml:4"), "{shown}");
    assert!(shown.contains("rate_hz = 1000  # from command line"), "{shown}");
    assert!(shown.contains("spin_us = 50  # from default"), "{shown}");
    assert!(
        shown.lines().any(|l| l.starts_with("warmup_steps") && l.contains("# from preset ur5:")),
        "{shown}"
    );
}

#[test]
fn the_meaning_of_settings_is_the_same_wherever_they_lie() {
    let of = |folder: &std::path::Path, name: &str, text: &str| {
        let urdf = crate::presets::robot("ur5").unwrap();
        std::fs::write(folder.join(format!("{name}.urdf")), urdf).unwrap();
        let text =
            format!("preset = \"ur5\"\n{text}\n[robot]\nurdf = \"{name}.urdf\"\ntool_m = [0, 0, 0.15]\n");
        Config::parse(&text, &format!("{name}.toml"), folder).unwrap().meaning()
    };
    let (a, b) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let one = of(a.path(), "one", "");
    assert_eq!(one, of(b.path(), "two", "# Other lines.\n"));
    assert!(one.contains("robot.urdf = a file\n") && one.contains("predictor.kind = \"mixture\"\n"), "{one}");
    assert_ne!(one, of(b.path(), "two", "[trust]\nramp_steps = 21\n"));
    assert_ne!(one, Config::preset("ur5").unwrap().meaning(), "an embedded robot is none of a file");
    assert_eq!(one.lines().count(), crate::keys().len());
}

#[test]
fn a_later_layer_wins_key_by_key() {
    let config = over_ur5("[mpc.limits.x]\njerk_mps3 = 300\n").unwrap();
    let limits = &config.settings().mpc.limits;
    assert_eq!((limits.x.jerk_mps3, limits.y.jerk_mps3), (300.0, 16000.0));
    assert_eq!(limits.x.velocity_mps, 0.8);
}

#[test]
fn a_bare_word_on_the_command_line_is_text() {
    let config = Draft::preset("ur5").set("predictor.kind", "hold").finish().unwrap();
    assert_eq!(config.settings().predictor.kind.name(), "hold");
}

#[test]
fn live_keys_may_change_and_others_are_named() {
    let before = Config::preset("ur5").unwrap();
    let live = over_ur5("[trust]\nmode = \"manual\"\nvalue = 0.5\n").unwrap();
    let change = before.live_diff(&live).unwrap();
    let keys: Vec<&str> = change.keys.iter().map(|change| change.key.as_str()).collect();
    assert_eq!(keys, ["trust.mode", "trust.value"]);
    assert_eq!(change.settings.trust.value, 0.5);

    let both = over_ur5("[trust]\nvalue = 0.5\n[loop]\nrate_hz = 1000\ncpu = 1\n").unwrap();
    let refused = before.live_diff(&both).unwrap_err();
    let keys: Vec<&str> = refused.iter().map(|key| key.0.key.as_str()).collect();
    assert_eq!(keys, ["loop.rate_hz", "loop.cpu"]);
    let text = refused[1].to_string();
    assert!(text.contains("loop.cpu") && text.contains("not set") && text.contains("restart"), "{text}");
    assert!(before.live_diff(&before).unwrap().keys.is_empty());
}

#[test]
fn every_key_ends_in_its_unit_and_is_described() {
    for key in crate::keys() {
        assert!(key.meaning.ends_with('.'), "{}: {}", key.path, key.meaning);
        assert!(!key.start_with.is_empty(), "{}", key.path);
        assert!(!key.path.ends_with('_'), "{}", key.path);
    }
}

/// The problems of a text that has to be refused.
pub(crate) fn problems(text: &str) -> Vec<Problem> {
    over_ur5(text).unwrap_err().problems().to_vec()
}

#[test]
fn changing_the_rate_brings_a_grid_step_that_fits() {
    for (rate_hz, step_ms) in [(125, 8), (250, 8), (500, 10), (1000, 10)] {
        let config = Draft::preset("ur5").rate(rate_hz).finish().unwrap();
        assert_eq!(
            (config.settings().control_loop.rate_hz, config.settings().pen.step_ms),
            (rate_hz, step_ms)
        );
    }
    assert!(Draft::preset("ur5").rate(0).finish().is_err());
    assert!(
        Draft::preset("ur5").rate(300).finish().unwrap_err().to_string().contains("125, 250, 500, 1000 Hz")
    );
}
