//! Sets and runs of the lab: generated, fetched by hand and checked, and the folder that a run leaves.

use std::fs::Permissions;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use foretrace_tests::{World, assert_refused, shared_data, told};
use serde_json::{Value, json};

use crate::PROGRAM;

fn done(world: &World, words: &[&str]) -> String {
    let out = world.run_plain(words);
    assert!(out.status.success(), "{}", told(&out));
    String::from_utf8(out.stdout).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> =
        entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn json_of(file: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

#[test]
fn every_run_has_a_folder_of_its_own_that_tells_how_to_repeat_it() {
    let world = World::new(PROGRAM);
    done(&world, &["lab", "generate", "ink", "--writers", "2", "--text", "Ka"]);
    let words = ["lab", "leadtime", "--data", "ink", "--models", "hold,constant-velocity"];
    let told_first = done(&world, &words);
    done(&world, &words);
    done(&world, &["lab", "fig3", "--data", "ink", "--set", "mpc.horizon=10"]);
    let below = world.file("foretrace-lab");
    let runs = names(&below);
    assert_eq!(runs.len(), 3, "{runs:?}");
    assert!(runs[0].starts_with("fig3-ink-2") && runs[1].starts_with("leadtime-ink-2"), "{runs:?}");
    assert!(told_first.contains(&format!("foretrace-lab/{}", runs[1])), "{told_first}");
    for run in &runs {
        let files = names(&below.join(run));
        assert!(
            files.contains(&"run.json".to_owned()) && files.iter().any(|file| file.ends_with(".svg")),
            "{files:?}"
        );
    }
    let [first, second] = [1, 2].map(|run| json_of(&below.join(&runs[run]).join("run.json")));
    let command: Vec<&str> = first["command"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert_eq!(command[1..], words);
    assert_eq!(first["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!((&first["data"], &first["settings_sha256"]), (&second["data"], &Value::Null));
    assert_eq!((&first["data"][0]["folder"], &first["data"][0]["files"]), (&json!("ink"), &json!(3)));

    // Other settings and other data have other sums.
    let sums = |options: &[&str]| {
        let out = world.file("fig").display().to_string();
        done(&world, &[&["lab", "fig3", "--data", "ink", "--out", &out], options].concat());
        let record = json_of(&world.file("fig/run.json"));
        [&record["settings_sha256"], &record["data"][0]["sha256"]].map(|sum| sum.as_str().unwrap().to_owned())
    };
    let fig3 = json_of(&below.join(&runs[0]).join("run.json"));
    let ten = sums(&["--set", "mpc.horizon=10"]);
    assert_eq!((&fig3["settings_sha256"], &fig3["data"][0]["sha256"]), (&json!(ten[0]), &json!(ten[1])));
    let usual = sums(&[]);
    assert!(usual[0] != ten[0] && usual[1] == ten[1]);
    let ink = world.file("ink/hand-02.dat");
    let text = std::fs::read_to_string(&ink).unwrap();
    std::fs::write(&ink, format!("{text}.COMMENT changed\n")).unwrap();
    assert_ne!(sums(&[])[1], usual[1]);

    // Pictures that cannot be drawn cost no result, and a place that cannot be written no work.
    std::fs::create_dir_all(world.file("blocked/leadtime.svg/x")).unwrap();
    std::fs::set_permissions(world.file("blocked"), Permissions::from_mode(0o777)).unwrap();
    let (blocked, result) = (world.file("blocked"), world.file("kept.json"));
    let [blocked, result] = [blocked, result].map(|path| path.display().to_string());
    let out = world.run_plain(&[&words[..], &["--out", &blocked, "--json", &result]].concat());
    assert!(!out.status.success(), "{}", told(&out));
    assert!(json_of(Path::new(&result))["standings"][0]["model"].is_string());
    let file = world.write("file", "");
    let result = world.file("none.json").display().to_string();
    let out = world.run_plain(&[&words[..], &["--out", &format!("{file}/out"), "--json", &result]].concat());
    assert!(!out.status.success() && told(&out).contains("--out DIR"), "{}", told(&out));
    assert!(!told(&out).contains("hold") && !Path::new(&result).exists(), "{}", told(&out));

    // A run without a result leaves no folder.
    assert_refused(&world.run_plain(&["lab", "fig3", "--data", "ink", "--label", "Q"]), 5, &["Q"]);
    assert_eq!(names(&below), runs);
}

#[test]
fn where_every_published_set_is_stands_on_its_page_and_nothing_is_made() {
    let world = World::new(PROGRAM);
    let all = done(&world, &["lab", "fetch"]);
    let listed: Value = serde_json::from_str(&done(&world, &["lab", "fetch", "--json", "-"])).unwrap();
    for set in ["unipen-ced", "unipen-tos", "pendigits-orig", "character-trajectories"] {
        assert!(all.contains(set), "{all}");
        let one = done(&world, &["lab", "fetch", set]);
        for words in
            ["https://doi.org/10.", "licence", "CC BY 4.0", "mkdir -p", "parts", &format!("--check {set}")]
        {
            assert!(one.contains(words), "{set}: {words} is not in\n{one}");
        }
        assert!(listed["sets"].as_array().unwrap().iter().any(|found| found["set"] == set), "{listed}");
    }
    assert_refused(&world.run_plain(&["lab", "fetch", "mnist"]), 2, &["the sets are unipen-ced, unipen-tos"]);
    let without = world.run_plain(&["lab", "fetch", "--check", "here"]);
    assert_eq!(without.status.code(), Some(2), "{}", told(&without));
    assert_eq!(names(&world.file("")), Vec::<String>::new());
}

#[test]
fn a_folder_without_the_sets_files_gets_no_table() {
    let world = World::new(PROGRAM);
    done(&world, &["lab", "generate", "unipen-tos", "--writers", "2", "--text", "K"]);
    std::fs::remove_file(world.file("unipen-tos/split.tsv")).unwrap();
    let check = |set: &str| world.run_plain(&["lab", "fetch", set, "--check", "unipen-tos"]);
    assert_refused(
        &check("unipen-tos"),
        5,
        &["216 of 216 files are missing", "data/2/tos/", "lab fetch unipen-tos"],
    );
    std::fs::write(world.file("unipen-tos/pendigits-orig.tra"), "1").unwrap();
    std::fs::write(world.file("unipen-tos/pendigits-orig.tes"), "1").unwrap();
    assert_refused(&check("pendigits-orig"), 5, &["2 of 2 files differ", "pendigits-orig.tes"]);
    assert!(!world.file("unipen-tos/split.tsv").exists());
}

fn copied(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().flatten() {
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copied(&entry.path(), &target)
        } else {
            drop(std::fs::copy(entry.path(), target))
        }
    }
}

#[test]
fn sets_as_they_were_measured_get_the_table_of_the_results() {
    let world = World::new(PROGRAM);
    for name in ["unipen-ced", "unipen-tos", "pendigits-orig", "character-trajectories"] {
        let Some(shared) = shared_data(name) else { continue };
        let folder = world.file(name);
        copied(&shared, &folder);
        let words = ["lab", "fetch", name, "--check", folder.to_str().unwrap(), "--json", "-"];
        // As the tests' own user, whom the copies belong to.
        let check = || {
            let out = std::process::Command::new(PROGRAM).args(words).output().unwrap();
            (out.status.code(), serde_json::from_slice::<Value>(&out.stdout).unwrap_or_default(), told(&out))
        };
        let split = folder.join("split.tsv");
        if !split.exists() {
            let (code, found, words) = check();
            assert_eq!((code, &found["split"]), (Some(0), &json!("not-needed")), "{name}: {words}");
            assert!(found["parts"].as_array().unwrap().contains(&json!("test")), "{found}");
            continue;
        }
        let published = std::fs::read_to_string(&split).unwrap();
        assert_eq!(check().1["split"], "agrees", "{name}");
        std::fs::remove_file(&split).unwrap();
        let (code, found, words) = check();
        assert_eq!((code, &found["split"]), (Some(0), &json!("written")), "{name}: {words}");
        let rows = |text: &str| {
            text.lines()
                .map(|line| line.split('\t').take(3).collect::<Vec<_>>().join("\t"))
                .collect::<Vec<_>>()
        };
        assert_eq!(rows(&std::fs::read_to_string(&split).unwrap()), rows(&published), "{name}");
        // Another table is not replaced, and a recording too many is not taken in.
        std::fs::write(&split, published.replace("test\t", "mine\t")).unwrap();
        let (code, _, words) = check();
        assert!(code == Some(5) && words.contains("other parts than the rule"), "{name}: {words}");
        std::fs::remove_file(&split).unwrap();
        let file = published.lines().nth(1).unwrap().split('\t').nth(2).unwrap();
        let more = folder.join(file).with_file_name("more.dat");
        std::fs::write(&more, ".COORD X Y\n.POINTS_PER_SECOND 100\n.WRITER_ID zz\n.PEN_DOWN\n1 2\n.SEGMENT CHARACTER 0 ? \"a\"\n")
            .unwrap();
        let (code, _, words) = check();
        assert!(code == Some(5) && words.contains("writers; the published set has"), "{name}: {words}");
        assert!(!split.exists(), "{name}");
    }
}
