//! Predictions and checkpoints that were forged: each is refused with a sentence, or read, in little memory
//! and time.

use std::collections::BTreeMap;
use std::path::Path;

use foretrace_config::models::{DType, container_bytes};
use foretrace_control::estimate::LawParameters;
use foretrace_lab::closed_loop::{BenchArm, Benchmark, Flaws, Rival};
use foretrace_lab::prediction::lead_time::{Entrant, Predictions, predict_all};
use foretrace_lab::prediction::{CharacterSequence, Model, Set, runs};
use foretrace_lab::shards::{
    ClosedLoopRun, LeadRun, MergeError, MergedLeads, MergedLoop, MergedTable, SetRun, Shard, ShardFile,
    TableRun, brought, closed_loop_part, command_of, digest, files_digest, lead_part, networks, own_hands,
    table_part,
};
use foretrace_lab::train::checkpoint;
use serde::Serialize;
use serde_json::{Value, json};

use crate::closed_loop::{config, hand};
use crate::forging::read_forged;

/// Rows in memory are several times as long as in the file.
const MIB: u64 = 1024;

#[test]
fn forged_predictions_and_checkpoints_are_refused_with_a_sentence() {
    let rows =
        "file,segment,t,lead,x,y,r50,r90\na.dat,0,3,10,1.5,-2,0.1,0.2\n\"b,c.dat\",1,4,200,1e3,0,1,2\n";
    let text = ["plan", "epoch", "rate"].map(|key| (key.to_owned(), "3ff0000000000000".to_owned()));
    let numbers = [0.5; 12];
    let tensor = (vec![12], &numbers[..]);
    let tensors = ["parameters", "adam.mean", "adam.square", "best"].map(|name| (name, tensor.clone()));
    let seeds = [
        rows.as_bytes().to_vec(),
        rows.replace(",r50,r90", "").into_bytes(),
        container_bytes(&BTreeMap::from(text), &BTreeMap::from(tensors), DType::F32),
    ];
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.csv");
    read_forged(
        "forged::forged_predictions_and_checkpoints_are_refused_with_a_sentence",
        MIB,
        &seeds,
        |bytes| {
            std::fs::write(&file, bytes).unwrap();
            let message = [
                Predictions::load(&file).err().map(|error| error.to_string()),
                checkpoint::load(&file, "3ff0000000000000", 12).err().map(|error| error.to_string()),
            ];
            for message in message.into_iter().flatten() {
                assert!(
                    message.contains("a.csv") && message.len() < 20_000,
                    "{} bytes: {message:.300}",
                    message.len()
                );
            }
        },
    );
}

fn set() -> Set {
    let sequence = |segment: usize| CharacterSequence {
        file: "w0.dat".to_owned(),
        writer: ["a", "b"][segment % 2].to_owned(),
        segment,
        label: "o".to_owned(),
        v: (0..60).map(|t| [90.0 * (0.1 * f64::from(t)).cos(), 90.0 * (0.1 * f64::from(t)).sin()]).collect(),
        jump: (0..60).map(|t| t == 30).collect(),
        rate_hz: 200.0,
        rate_assumed: false,
        units_per_m: Some([50_000.0; 2]),
    };
    Set {
        name: "set".to_owned(),
        split: "test".to_owned(),
        scored: (0..3).map(sequence).collect(),
        train: Vec::new(),
        cold: true,
        refused: Vec::new(),
        damaged: Vec::new(),
        remarks: Vec::new(),
    }
}

/// The only shard of a run of each kind.
fn whole_shards() -> [Vec<u8>; 3] {
    fn bytes<R: Serialize, P: Serialize>(command: &str, run: R, part: P) -> Vec<u8> {
        let program = ("0.1.0", "00000000".to_owned());
        serde_json::to_vec(&ShardFile::new(program, command, Shard::WHOLE, run, part)).unwrap()
    }
    let (set, owned) = (set(), vec![true; 3]);
    let models = Model::list("hold,constant-velocity").unwrap();
    let names: Vec<String> = models.iter().map(Model::to_string).collect();
    let (of_set, own) = (SetRun::of(&set), networks(&models));
    let run = TableRun { set: of_set.clone(), models: names.clone(), networks: own, by_label: true };
    let table = table_part(&set, &owned, &runs(&models, &set, &owned, &|| ()).unwrap());
    let entrants: Vec<Entrant> = models.into_iter().map(Entrant::Model).collect();
    let leads = LeadRun { sets: vec![of_set], models: names, networks: brought(&entrants), each: true };
    let (sets, owned) = ([set], [owned]);
    let predicted = predict_all(&entrants, &sets, &owned, &|| ()).unwrap();
    let config = config();
    let arms = vec![(BenchArm::Ideal, vec![hand(BenchArm::Ideal, &config, &["o"])])];
    let loop_run = ClosedLoopRun {
        set: "set".to_owned(),
        lifts: "leap".to_owned(),
        each: true,
        arms: vec!["ideal".to_owned()],
        hands: vec![1],
        predictors: vec!["hold".to_owned()],
        options: String::new(),
        settings: config.meaning(),
        files: files_digest(&config),
        data: digest(&arms),
    };
    let (arms, places) = own_hands(arms, Shard::WHOLE);
    let rivals = vec![Rival::named("hold").unwrap()];
    let benchmark =
        Benchmark { config: &config, arms, rivals, flaws: Flaws::default(), law: LawParameters::SHIPPED };
    let outcomes = benchmark.run(|| ()).unwrap();
    [
        bytes("table1", run, table),
        bytes("leadtime", leads, lead_part(&sets, &owned, &predicted)),
        bytes("closed-loop", loop_run, closed_loop_part(&benchmark.names(), &places, &outcomes)),
    ]
}

/// What `foretrace lab merge` does with the file of one shard, whatever its command says.
fn merged(file: &Path) -> Vec<Result<(), MergeError>> {
    let files = [file.to_owned()];
    vec![
        command_of(&files).map(|_| ()),
        MergedTable::of(&files).map(|_| ()),
        MergedLeads::of(&files).map(|_| ()),
        MergedLoop::of(&files).map(|_| ()),
    ]
}

/// Files that claim a product of what they list, and list little of it.
fn claims(seeds: &[Vec<u8>; 3]) -> Vec<Value> {
    let [table, leads, of_loop] =
        seeds.each_ref().map(|bytes| serde_json::from_slice::<Value>(bytes).unwrap());
    let empty = |sequence: &Value, place: usize| {
        let mut short = sequence.clone();
        short["place"] = json!(place);
        for list in ["v", "jumps", "label", "file", "writer"] {
            short[list] = if list == "jumps" { json!([]) } else { json!("") };
        }
        short
    };
    let many = 30_000;
    let names: Vec<String> = (0..9_000).map(|name| name.to_string()).collect();
    let mut a = table;
    let sequence = a["part"]["sequences"][0].clone();
    a["part"]["sequences"] = (0..many).map(|place| empty(&sequence, place)).collect();
    a["run"]["set"]["sequences"] = json!(many);
    let model = |name: &String| json!({"model": name, "errors": "", "times_us": "", "train_s_per_epoch": "", "note": null});
    a["part"]["models"] = names.iter().map(model).collect();
    a["run"]["models"] = json!(names);
    let mut b = leads;
    b["part"]["sets"][0]["sequences"] = a["part"]["sequences"].clone();
    b["run"]["sets"][0]["sequences"] = json!(many);
    let lane = |name: &String| json!({"model": name, "note": null, "predicted": "", "elsewhere": false, "radii": ""});
    b["part"]["sets"][0]["lanes"] = names.iter().map(lane).collect();
    b["run"]["models"] = json!(names);
    // Each writes nothing, and is another one.
    let mut writers = b.clone();
    let written = |place: usize| {
        let mut short = empty(&sequence, place);
        short["writer"] = json!(place.to_string());
        short
    };
    writers["part"]["sets"][0]["sequences"] = (0..150_000).map(written).collect();
    writers["run"]["sets"][0]["sequences"] = json!(150_000);
    writers["part"]["sets"][0]["lanes"] = json!([lane(&names[0])]);
    writers["run"]["models"] = json!([names[0]]);
    let mut more_models = b.clone();
    more_models["run"]["models"] = json!(vec!["a"; 1_000_000]);
    let mut more_methods = of_loop.clone();
    more_methods["run"]["predictors"] = (0..300_000).map(|number| format!("external:{number}")).collect();
    let mut c = of_loop;
    let hand = |place: usize| json!({"place": place, "file": "", "writer": "", "labels": []});
    c["run"]["hands"] = json!([many]);
    c["run"]["predictors"] = json!(vec!["hold"; many]);
    c["part"]["arms"][0]["hands"] = (0..many).map(hand).collect();
    c["part"]["arms"][0]["methods"] = vec![json!({"scored": [], "scores": ""}); many].into();
    vec![a, b, writers, more_models, more_methods, c]
}

#[test]
fn forged_shards_are_refused_with_a_sentence() {
    let seeds = whole_shards();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("part.json");
    let mut first = true;
    read_forged("forged::forged_shards_are_refused_with_a_sentence", MIB, &seeds, |bytes| {
        if std::mem::take(&mut first) {
            for (seed, reader) in seeds.iter().zip(1..) {
                std::fs::write(&file, seed).unwrap();
                let results = merged(&file);
                assert!(results[0].is_ok() && results[reader].is_ok(), "{results:?}");
            }
            // All together have the time of one file: of its 20 s of the processor they take less than 10.
            for (claim, number) in claims(&seeds).iter().zip(0..) {
                std::fs::write(&file, claim.to_string()).unwrap();
                let told: Vec<String> = merged(&file)
                    .into_iter()
                    .filter_map(Result::err)
                    .map(|error| error.to_string())
                    .collect();
                assert!(told.iter().all(|message| message.len() < 20_000), "claim {number}");
            }
        }
        std::fs::write(&file, bytes).unwrap();
        for error in merged(&file).into_iter().filter_map(Result::err) {
            let message = error.to_string();
            assert!(
                (message.contains("part.json") || matches!(error, MergeError::Missing { .. }))
                    && message.len() < 20_000,
                "{} bytes: {message:.300}",
                message.len()
            );
        }
    });
}
