//! The plane put into a settings file, key by key, everything else as it was.

use std::path::Path;

use foretrace_config::files::{LONGEST_SETTINGS, read_text};
use foretrace_config::{Config, Settings};

use crate::plane::PlaneFit;
use foretrace_failure::Failure;

/// Two numbers of the settings that count as the same.
const SAME: f64 = 1e-9;

/// The keys and values, as they stand in a file.
pub fn lines(fit: &PlaneFit) -> Vec<(&'static str, String)> {
    let list = |values: &[f64]| {
        let words: Vec<String> = values.iter().map(|value| format!("{value:.9}")).collect();
        format!("[{}]", words.join(", "))
    };
    vec![
        ("origin_m", list(fit.origin.as_slice())),
        ("x_axis", list(fit.x_axis.as_slice())),
        ("normal", list(fit.normal.as_slice())),
        ("pen_origin_m", list(fit.pen_origin.as_slice())),
        ("scale", format!("{:.9}", fit.scale)),
    ]
}

/// Puts them into `path`; the file is judged as a whole before it is replaced.
pub fn write(path: &Path, fit: &PlaneFit) -> Result<(), Failure> {
    let refused = |what: String| {
        Failure::bad_input(
            format_args!("{}: {what}", path.display()),
            "nothing was written; put the lines above into [plane] by hand",
        )
    };
    let text = read_text(path, LONGEST_SETTINGS).map_err(|error| refused(error.to_string()))?;
    let new = put(&text, &lines(fit));
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let config = Config::parse(&new, &path.display().to_string(), folder)
        .map_err(|error| refused(format!("with the new plane the settings are wrong: {error}")))?;
    if !says(config.settings(), fit) {
        return Err(refused("its [plane] is written in a way that is not understood here".to_owned()));
    }
    foretrace_host::whole::write(path, |file| std::io::Write::write_all(file, new.as_bytes()))
        .map_err(|error| refused(error.to_string()))
}

fn says(settings: &Settings, fit: &PlaneFit) -> bool {
    let plane = &settings.plane;
    let same = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME);
    same(&plane.origin_m, fit.origin.as_slice())
        && same(&plane.x_axis, fit.x_axis.as_slice())
        && same(&plane.normal, fit.normal.as_slice())
        && same(&plane.pen_origin_m, fit.pen_origin.as_slice())
        && (plane.scale - fit.scale).abs() <= SAME
}

/// `text` with these keys of `[plane]` replaced, or added where they are missing.
fn put(text: &str, keys: &[(&'static str, String)]) -> String {
    let mut out: Vec<String> = Vec::new();
    let mut left: Vec<&(&str, String)> = keys.iter().collect();
    let (mut inside, mut header, mut skipping) = (false, None, 0_i64);
    for line in text.lines() {
        let bare = line.split('#').next().unwrap_or_default().trim();
        if skipping > 0 {
            // The rest of a value over several lines.
            skipping += brackets(bare);
            continue;
        }
        if bare.starts_with('[') && !bare.contains('=') {
            inside = bare == "[plane]";
            if inside {
                header = Some(out.len());
            }
        }
        let key = bare.split_once('=').map(|(key, _)| key.trim());
        match keys.iter().find(|(name, _)| inside && key == Some(*name)) {
            Some((name, value)) => {
                let comment =
                    line.split_once('#').map(|(_, words)| format!("  #{words}")).unwrap_or_default();
                skipping = brackets(bare);
                out.push(format!("{name} = {value}{}", if skipping > 0 { String::new() } else { comment }));
                left.retain(|(other, _)| other != name);
            }
            None => out.push(line.to_owned()),
        }
    }
    let added = left.iter().map(|(name, value)| format!("{name} = {value}"));
    match header {
        Some(at) => {
            let tail = out.split_off(at + 1);
            out.extend(added);
            out.extend(tail);
        }
        None => {
            out.extend([String::new(), "[plane]".to_owned()]);
            out.extend(added);
        }
    }
    out.join("\n") + "\n"
}

/// Brackets that are opened and not closed.
fn brackets(text: &str) -> i64 {
    text.chars().map(|c| i64::from(c == '[') - i64::from(c == ']')).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector2, Vector3};

    fn fit() -> PlaneFit {
        PlaneFit {
            origin: Vector3::new(0.55, 0.11, 0.07),
            x_axis: Vector3::new(0.0, -1.0, 0.0),
            y_axis: Vector3::new(1.0, 0.0, 0.0),
            normal: Vector3::z(),
            scale: 1.25,
            pen_origin: Vector2::new(0.01, 0.0),
        }
    }

    #[test]
    fn keys_are_replaced_where_they_stand_and_the_rest_stays() {
        let text = "preset = \"ur5\"  # begin\n[plane]\norigin_m = [\n  0.5, # x\n  0.0, 0.0]\nscale = 1.0 # large\n\
                    lift_height_m = 0.01\n\n[pen]\nscale = 3\n";
        let new = put(text, &lines(&fit()));
        assert!(new.contains("origin_m = [0.550000000, 0.110000000, 0.070000000]\n"), "{new}");
        assert!(
            new.contains("scale = 1.250000000  # large\n") && new.contains("lift_height_m = 0.01\n"),
            "{new}"
        );
        assert!(new.contains("[pen]\nscale = 3\n") && !new.contains("0.5, # x"), "{new}");
        assert!(new.contains("[plane]\nx_axis = "), "{new}");
    }

    #[test]
    fn a_file_is_replaced_only_where_it_then_says_the_plane() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.toml");
        let (old, preset) = (|| std::fs::read_to_string(&path).unwrap(), Config::preset("ur5").unwrap());
        let own = &preset.settings().plane;
        let rotation = own.rotation();
        let near = PlaneFit {
            origin: Vector3::from(own.origin_m) + Vector3::new(0.003, 0.002, 0.001),
            x_axis: rotation * Vector3::x(),
            y_axis: rotation * Vector3::y(),
            normal: rotation * Vector3::z(),
            scale: 0.9,
            pen_origin: Vector2::zeros(),
        };
        std::fs::write(&path, "preset = \"ur5\"\n").unwrap();
        write(&path, &near).unwrap();
        assert!(says(Config::load(&path).unwrap().settings(), &near), "{}", old());
        // Written as an inline table it is not understood, and stays as it was.
        for text in ["preset = \"ur5\"\nplane = { scale = 1.0 }\n", "preset = \"ur5\"\nplane.scale = 1.0\n"] {
            std::fs::write(&path, text).unwrap();
            let told = write(&path, &near).unwrap_err().to_string();
            assert!(told.contains("by hand") && old() == text, "{told}");
        }
        // A plane far away is refused by the settings themselves.
        std::fs::write(&path, "preset = \"ur5\"\n").unwrap();
        let told =
            write(&path, &PlaneFit { origin: Vector3::new(2.5, 0.0, 0.0), ..near }).unwrap_err().to_string();
        assert!(told.contains("out of reach") && old() == "preset = \"ur5\"\n", "{told}");
    }
}
