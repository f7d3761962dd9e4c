//! Shards of the lab's commands, and their merge: the result of a run that is not cut, to the last byte.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use foretrace_tests::{World, assert_refused, told};
use serde_json::Value;

use crate::PROGRAM;

/// Seven files of two writers each at 200 Hz, in an order that is not that of their names, with a jump in
/// every third character; the first two to train on, which is what `train` says.
fn set(world: &World, name: &str, stretch: f64) -> String {
    std::fs::create_dir_all(world.file(name)).unwrap();
    let mut table = String::from("set\tfile\n");
    for file in [3, 0, 6, 1, 5, 2, 4_u32] {
        let mut text = String::from(
            ".VERSION 1.0\n.COORD X Y\n.POINTS_PER_SECOND 200\n.X_POINTS_PER_MM 50\n.Y_POINTS_PER_MM 50\n\
             .HIERARCHY CHARACTER\n",
        );
        let mut segments = String::new();
        let mut component = 0;
        for character in 0..3_u32 {
            let first = component;
            for stroke in 0..1 + u32::from(character == 2) {
                let points: String = (0..40_u32)
                    .map(|i| {
                        let angle = 0.1 * f64::from(i) * (1.0 + 0.1 * f64::from(character + file));
                        let x = stretch * 90.0 * angle.cos() + 2.0 * f64::from(i + 30 * stroke);
                        format!("{x:.0} {:.0}\n", 90.0 * angle.sin())
                    })
                    .collect();
                text += &format!(".PEN_DOWN\n{points}.PEN_UP\n");
                component += 1;
            }
            let range =
                if component - first > 1 { format!("{first}-{}", component - 1) } else { first.to_string() };
            let label = ["o", "C", "e"][character as usize];
            segments += &format!(".WRITER_ID {}\n", ["a", "b"][character as usize % 2]);
            segments += &format!(".SEGMENT CHARACTER {range} OK \"{label}\"\n");
        }
        let file_name = format!("{name}/w{file}.dat");
        world.write(&file_name, &(text + &segments));
        table += &format!("{}\tw{file}.dat\n", if file < 2 { "train" } else { "test" });
    }
    let table = world.write(&format!("{name}/split.tsv"), &table);
    Path::new(&table).parent().unwrap().display().to_string()
}

fn done(world: &World, arguments: &[&str]) -> String {
    let output = world.run_plain(arguments);
    assert!(output.status.success(), "{}", told(&output));
    String::from_utf8(output.stdout).unwrap()
}

/// The files of all shards of `command`.
fn shards(world: &World, command: &[&str], count: usize) -> Vec<String> {
    let shard = |index: usize| {
        let file = world.file(&format!("{}-{index}-of-{count}.json", command[1])).display().to_string();
        done(world, &[command, &["--shard", &format!("{index}/{count}"), "--json", &file]].concat());
        file
    };
    (1..=count).map(shard).collect()
}

/// Text, JSON and pictures of a result, without times and without what says where the pictures are.
fn result(world: &World, command: &[&str], out: &str) -> (String, String, Vec<(PathBuf, String)>) {
    let (folder, json) = (world.file(out), world.file(&format!("{out}.json")));
    let [folder_name, json_name] = [&folder, &json].map(|path| path.display().to_string());
    // Nothing is drawn there.
    let place: &[&str] = if command.contains(&"evaluate") { &[] } else { &["--out", &folder_name] };
    let text = done(world, &[command, place, &["--json", &json_name]].concat());
    let mut value: Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    // A prediction table.
    if value.get("split").is_some() {
        for row in value["rows"].as_array_mut().unwrap() {
            for time in ["us_per_step", "train_s_per_epoch"] {
                row[time] = Value::Null;
            }
        }
    }
    // The last two columns of a row of a prediction table are times.
    let timeless = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let row = words.len() == 17 && words[1].parse::<f64>().is_ok();
        if row { words[..15].join(" ") } else { line.to_owned() }
    };
    let kept = text.lines().filter(|line| !line.starts_with("picture ")).map(timeless);
    let mut pictures: Vec<_> = std::fs::read_dir(&folder)
        .map(|files| files.map(|file| file.unwrap().path()).collect())
        .unwrap_or_default();
    // Single letters are drawn from the recordings; run.json is of its run.
    let is_picture = |file: &PathBuf| file.extension().is_some_and(|ending| ending == "svg");
    pictures.retain(|file| is_picture(file) && !file.display().to_string().contains("letters"));
    pictures.sort();
    let drawn = |file: PathBuf| {
        let text = std::fs::read_to_string(&file).unwrap();
        (file.file_name().unwrap().into(), text)
    };
    (kept.collect::<Vec<_>>().join("\n"), value.to_string(), pictures.into_iter().map(drawn).collect())
}

/// Every hand of `parts`, which name file and writer, is in one shard; two writers of a file are two hands.
fn hands_are_of_writers(files: &[String], hands: impl Fn(&Value) -> Vec<Value>) {
    let mut owners: BTreeMap<(String, String), BTreeSet<usize>> = BTreeMap::new();
    for (shard, file) in files.iter().enumerate() {
        let value: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
        for hand in hands(&value["part"]) {
            let [name, writer] = ["file", "writer"].map(|key| hand[key].as_str().unwrap().to_owned());
            owners.entry((name, writer)).or_default().insert(shard);
        }
    }
    assert!(
        owners.keys().any(|(_, writer)| writer == "b") && owners.values().all(|shards| shards.len() == 1)
    );
    let apart = |((file, writer), shards): (&(String, String), &BTreeSet<usize>)| {
        writer == "a" && owners.get(&(file.clone(), "b".to_owned())).is_some_and(|others| others != shards)
    };
    assert!(owners.iter().any(apart), "{owners:?}");
}

fn list(value: &Value) -> Vec<Value> {
    value.as_array().unwrap().clone()
}

fn same_whatever_the_cut(command: &[&str], world: &World, name: &str, counts: &[usize]) {
    let whole = result(world, command, &format!("{name}-whole"));
    for &count in counts {
        let mut files = shards(world, command, count);
        // In any order.
        files.reverse();
        let mut merge = vec!["lab", "merge"];
        merge.extend(files.iter().map(String::as_str));
        let merged = result(world, &merge, &format!("{name}-merged-{count}"));
        assert_eq!(merged.0, whole.0, "text of {count} shards");
        assert!(merged.1 == whole.1, "JSON of {count} shards:\n{}\n{}", merged.1, whole.1);
        let names = |pictures: &[(PathBuf, String)]| {
            pictures.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(&merged.2), names(&whole.2));
        assert!(merged.2 == whole.2, "pictures of {count} shards");
    }
}

#[test]
fn tables_from_shards_are_those_of_the_whole() {
    let world = World::alone(PROGRAM);
    let set = set(&world, "set", 1.0);
    let models = "hold,constant-velocity,dybm-offline,dybm,dybm-esn,ar-rls,lstm32,mixture,mixture-cold";
    same_whatever_the_cut(
        &["lab", "table1", "--data", &set, "--models", models, "--by-label"],
        &world,
        "table1",
        &[1, 3, 17],
    );
    let evaluate = ["lab", "evaluate", "--data", &set, "--models", "dybm,mixture"];
    same_whatever_the_cut(&evaluate, &world, "evaluate", &[1, 3, 17]);
    hands_are_of_writers(&shards(&world, &evaluate, 3), |part| list(&part["sequences"]));
    // Every shard trains the same network.
    let trained = ["lab", "table1", "--data", &set, "--models", "hold,lstm10", "--train"];
    same_whatever_the_cut(&trained, &world, "trained", &[2]);
}

#[test]
fn lead_times_from_shards_are_those_of_the_whole() {
    let world = World::alone(PROGRAM);
    let (a, b) = (set(&world, "a", 1.0), set(&world, "b", 1.3));
    let data = format!("{a},{b}");
    let exports = world.file("targets").display().to_string();
    done(&world, &["lab", "leadtime", "--data", &b, "--export-targets", &exports]);
    // Predictions of one of the sets, with bands, that are wrong by a little.
    let targets = std::fs::read_to_string(world.file("targets/b-targets.csv")).unwrap();
    let points = std::fs::read_to_string(world.file("targets/b-points.csv")).unwrap();
    let mut answers = String::from("file,segment,t,lead,x,y,r50,r90\n");
    for target in targets.lines().skip(1) {
        let cells: Vec<&str> = target.split(',').collect();
        let key = format!("{},{},{},", cells[0], cells[1], cells[2]);
        let point: Vec<&str> =
            points.lines().find(|line| line.starts_with(&key)).unwrap().split(',').collect();
        answers += &format!("{target},{},{},3,40\n", point[4], point[5].parse::<f64>().unwrap() + 0.1);
    }
    let mine = format!("file:{}", world.write("mine.csv", &answers));
    let models = format!("constant-velocity,ar-rls,dybm,mixture,lstm10,{mine}");
    same_whatever_the_cut(
        &["lab", "leadtime", "--data", &data, "--models", &models, "--each"],
        &world,
        "leads",
        &[1, 3, 17],
    );
}

#[test]
fn the_closed_loop_from_shards_is_that_of_the_whole() {
    let world = World::alone(PROGRAM);
    let set = set(&world, "set", 1.0);
    let command = [
        "lab",
        "closed-loop",
        "--data",
        &set,
        "--predictors",
        "hold,mixture,kalman-legal",
        "--arms",
        "ideal,ur5",
        "--limit",
        "2",
        "--each",
    ];
    let whole = result(&world, &command, "whole");
    let plain = &command[..];
    for count in [1, 3, 17] {
        let files = shards(&world, plain, count);
        let merge: Vec<&str> = ["lab", "merge"].into_iter().chain(files.iter().map(String::as_str)).collect();
        let merged = result(&world, &merge, &format!("merged-{count}"));
        if count == 3 {
            hands_are_of_writers(&files, |part| list(&part["arms"][0]["hands"]));
        }
        assert_eq!(merged.0, whole.0);
        assert!(merged.1 == whole.1 && merged.2 == whole.2, "{count} shards");
        // What was merged can be told again, and with which settings.
        let [of_whole, of_merge] = ["whole", &format!("merged-{count}")].map(|out| {
            let text = std::fs::read(world.file(&format!("{out}/run.json"))).unwrap();
            serde_json::from_slice::<Value>(&text).unwrap()
        });
        let summed: Vec<_> = list(&of_merge["data"]);
        let names: Vec<&str> = summed.iter().filter_map(|sum| sum["folder"].as_str()).collect();
        assert_eq!(names, files, "{of_merge}");
        assert!(summed.iter().all(|sum| sum["sha256"].is_string()), "{of_merge}");
        assert!(of_merge["cwd"].is_string() && of_merge["settings_values_sha256"].is_string());
        assert_eq!(of_merge["settings_values_sha256"], of_whole["settings_values_sha256"]);
    }
}

#[test]
fn settings_count_by_what_they_mean_and_what_their_files_hold() {
    let world = World::alone(PROGRAM);
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let network = std::fs::read(root.join("config/models/lstm10-10ms.safetensors")).unwrap();
    let urdf = std::fs::read_to_string(root.join("config/robots/ur5.urdf")).unwrap();
    // The last bit of the last weight.
    let mut other_network = network.clone();
    let last = network.len() - 4;
    other_network[last] ^= 1;
    let other_urdf = urdf.replacen("<mass value=\"", "<mass value=\"1", 1);
    assert_ne!(urdf, other_urdf);
    let shard = |name: &str, index: usize, remark: &str, network: &[u8], urdf: &str| {
        std::fs::create_dir_all(world.file(name)).unwrap();
        std::fs::write(world.file(&format!("{name}/{name}.safetensors")), network).unwrap();
        world.write(&format!("{name}/{name}.urdf"), urdf);
        let settings = format!(
            "{remark}preset = \"ur5\"\n[robot]\nurdf = \"{name}.urdf\"\ntool_m = [0, 0, 0.15]\n\
             [predictor]\nlstm = \"{name}.safetensors\"\n"
        );
        let config = world.write(&format!("{name}/table.toml"), &settings);
        let (file, shard) = (world.file(&format!("{name}.json")).display().to_string(), format!("{index}/2"));
        let command = ["lab", "closed-loop", "--text", "a", "--arms", "ideal", "--predictors", "hold"];
        done(&world, &[&command[..], &["--config", &config, "--shard", &shard, "--json", &file]].concat());
        file
    };
    let merge =
        |files: [&str; 2]| world.run_plain(&["lab", "merge", files[0], files[1], "--out", "/dev/null/x"]);
    let one = shard("one", 1, "", &network, &urdf);
    // Other places and other lines are not other settings.
    let two = shard("two", 2, "# Two.\n\n", &network, &urdf);
    let out = world.file("pictures").display().to_string();
    done(&world, &["lab", "merge", &one, &two, "--out", &out]);
    let other = shard("network", 2, "", &other_network, &urdf);
    assert_refused(&merge([&one, &other]), 5, &["different runs", "run.files"]);
    let other = shard("robot", 2, "", &network, &other_urdf);
    assert_refused(&merge([&one, &other]), 5, &["different runs", "run.files"]);
}

#[test]
fn another_build_of_the_same_version_is_another_program() {
    let world = World::alone(PROGRAM);
    let set = set(&world, "set", 1.0);
    let command = ["lab", "evaluate", "--data", &set, "--models", "hold"];
    let [one, two] = [1, 2].map(|index| {
        let file = world.file(&format!("{index}.json")).display().to_string();
        (format!("{index}/2"), file)
    });
    done(&world, &[&command[..], &["--shard", &one.0, "--json", &one.1]].concat());
    let other = world.file("foretrace");
    std::fs::copy(PROGRAM, &other).unwrap();
    let run = || {
        let status = Command::new(&other).args(command).args(["--shard", &two.0, "--json", &two.1]).status();
        assert!(status.unwrap().success());
    };
    // A copy is the same program.
    run();
    done(&world, &["lab", "merge", &one.1, &two.1]);
    std::fs::OpenOptions::new().append(true).open(&other).unwrap().write_all(b"\0").unwrap();
    run();
    let refused = world.run_plain(&["lab", "merge", &one.1, &two.1]);
    assert_refused(&refused, 5, &["different runs", "program_file", "same program"]);
}

#[test]
fn shards_that_are_not_all_of_one_run_are_refused() {
    let world = World::alone(PROGRAM);
    let (a, b) = (set(&world, "a", 1.0), set(&world, "b", 1.3));
    let run = |data: &str, models: &'static str, shard: &str, name: &str| {
        let file = world.file(name).display().to_string();
        let command = ["lab", "evaluate", "--data", data, "--models", models];
        done(&world, &[&command[..], &["--shard", shard, "--json", &file]].concat());
        file
    };
    let merge = |files: &[&str]| world.run_plain(&[&["lab", "merge"][..], files].concat());
    let (one, two, three) = (
        run(&a, "dybm", "1/3", "1.json"),
        run(&a, "dybm", "2/3", "2.json"),
        run(&a, "dybm", "3/3", "3.json"),
    );
    // Where nothing is drawn nothing of an earlier run is replaced.
    world.write("report.html", "");
    let folder = world.file("").display().to_string();
    let merged = world.run_plain(&["lab", "merge", &three, &one, &two, "--out", &folder]);
    assert!(merged.status.success() && !told(&merged).contains("earlier run"), "{}", told(&merged));
    assert_refused(&merge(&[&one, &three]), 5, &["1 of 3 shards are missing", ": 2;"]);
    assert_refused(&merge(&[&one, &two, &three, &one]), 5, &["both shard 1/3", "1.json"]);
    let other = run(&a, "dybm", "2/4", "4.json");
    assert_refused(&merge(&[&one, &other]), 5, &["different runs", "N is 3", "4.json"]);
    let other = run(&a, "hold", "2/3", "model.json");
    assert_refused(&merge(&[&one, &other]), 5, &["run.models[0]", "dybm", "hold"]);
    let other = run(&b, "dybm", "2/3", "set.json");
    assert_refused(&merge(&[&one, &other]), 5, &["different runs", "run.set."]);
    // The same names with other strokes.
    let text = std::fs::read_to_string(world.file("a/w3.dat")).unwrap();
    world.write("a/w3.dat", &text.replacen("\n90 ", "\n91 ", 1));
    let other = run(&a, "dybm", "2/3", "data.json");
    assert_refused(&merge(&[&one, &other, &three]), 5, &["different runs", "run.set.data"]);
    for (name, content, words) in [
        ("empty.json", String::new(), "no shard"),
        ("result.json", "{\"set\": \"a\", \"rows\": []}".to_owned(), "foretrace_lab_shard"),
        ("cut.json", std::fs::read_to_string(&two).unwrap()[..900].to_owned(), "no shard"),
    ] {
        let file = world.write(name, &content);
        assert_refused(&merge(&[&one, &file, &three]), 5, &[name, words]);
    }
    assert_refused(&merge(&["/nowhere.json"]), 5, &["/nowhere.json", "cannot read"]);
    let tampered = |from: &str, to: &str| {
        let text = std::fs::read_to_string(&two).unwrap();
        assert!(text.contains(from), "{from}");
        merge(&[&one, &world.write("tampered.json", &text.replacen(from, to, 1)), &three])
    };
    assert_refused(&tampered("\"place\":", "\"place\":99"), 5, &["tampered.json", "of 21"]);
    assert_refused(&tampered("\"times_us\":\"", "\"times_us\":\"AAAAAAAA"), 5, &["tampered.json"]);
    assert_refused(&tampered("\"model\":\"dybm\"", "\"model\":\"hold\""), 5, &["tampered.json", "dybm"]);
    assert_refused(
        &tampered("\"shard\":{\"index\":2", "\"shard\":{\"index\":9"),
        5,
        &["tampered.json", "9/3"],
    );
    let usage = |arguments: &[&str]| world.run_plain(arguments).status.code();
    let plain = ["lab", "evaluate", "--data", &a];
    assert_eq!(usage(&[&plain[..], &["--shard", "1/3"]].concat()), Some(2));
    assert_eq!(usage(&[&plain[..], &["--shard", "4/3", "--json", "-"]].concat()), Some(2));
    assert_eq!(usage(&["lab", "merge"]), Some(2));
}
