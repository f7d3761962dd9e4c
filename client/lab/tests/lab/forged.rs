//! Predictions and checkpoints that were forged: each is refused with a sentence, or read, in little memory
//! and time.

use std::collections::BTreeMap;

use foretrace_config::models::{DType, container_bytes};
use foretrace_lab::prediction::lead_time::Predictions;
use foretrace_lab::train::checkpoint;

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
