//! Trained networks from files: PyTorch's numbers reproduced, and everything that can be wrong with a file
//! refused. `fixtures/lstm`: fixed random weights (`F32`) and what PyTorch computes from them in double
//! precision.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foretrace_config::models::{
    Assumed, Container, DType, ForesightModel, LstmModel, Shipped, container_bytes, shipped, shipped_names,
};
use foretrace_control::predict::models::lstm::{LstmState, LstmTensors, Precision};
use foretrace_control::predict::{Lstm, Predictor};
use serde_json::Value;

const PYTORCH: &[u8] = include_bytes!("fixtures/lstm/lstm2-10_linear10-2.safetensors");
const NUMBERS: &str = include_str!("fixtures/lstm/lstm2-10_linear10-2.json");
/// The fixture is a bare `state_dict` on unscaled inputs.
const BARE: Assumed = Assumed { input_scale: Some(1.0), step_ns: Some(5_000_000) };

fn model() -> LstmModel {
    LstmModel::parse("fixture", PYTORCH, BARE).unwrap()
}

fn rows<const N: usize>(value: &Value) -> Vec<[f64; N]> {
    let row = |row: &Value| {
        let numbers: Vec<f64> = row.as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect();
        numbers.try_into().unwrap()
    };
    value.as_array().unwrap().iter().map(row).collect()
}

fn worst(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn pytorchs_outputs_and_states_are_reproduced() {
    let stored: Value = serde_json::from_str(NUMBERS).unwrap();
    let single = &stored["single"];
    let inputs: Vec<[f64; 2]> = rows(&single["input_sequence"]);
    let (outputs, h, c) =
        (rows::<2>(&single["output"]), rows::<10>(&single["h_per_step"]), rows::<10>(&single["c_per_step"]));
    let weights = model().weights;
    // The plain equations, the predictor in double precision, and in single (24 bits).
    let mut plain = LstmState::empty();
    let mut double = Lstm::with_precision(weights.clone(), Precision::Double);
    let mut single = Lstm::with_precision(weights.clone(), Precision::Single);
    for (t, x) in inputs.iter().take(45).enumerate() {
        weights.step(&mut plain, *x);
        let mut next = [[0.0; 2]];
        assert!(worst(&weights.output(&plain, 1).unwrap(), &outputs[t]) < 1e-12, "step {t}");
        assert!(worst(&plain.h[..10], &h[t]) < 1e-12 && worst(&plain.c[..10], &c[t]) < 1e-12, "step {t}");
        for (lstm, tolerance) in [(&mut double, 1e-12), (&mut single, 1e-6)] {
            lstm.observe(*x);
            lstm.preview(&mut next);
            assert!(worst(&next[0], &outputs[t]) < tolerance, "step {t}");
            assert!(worst(lstm.hidden(), &h[t]) < tolerance, "step {t}");
            assert!(worst(&lstm.state().c[..10], &c[t]) < tolerance, "step {t}");
        }
    }
}

#[test]
fn pytorchs_roll_out_is_reproduced_and_leaves_the_state_untouched() {
    let stored: Value = serde_json::from_str(NUMBERS).unwrap();
    let inputs: Vec<[f64; 2]> = rows(&stored["single"]["input_sequence"]);
    let expected: Vec<[f64; 2]> = rows(&stored["rollout_after_first_20_inputs"]);
    for (precision, tolerance) in [(Precision::Double, 1e-12), (Precision::Single, 1e-6)] {
        let mut lstm = Lstm::with_precision(model().weights, precision);
        for x in &inputs[..20] {
            lstm.observe(*x);
        }
        let before = lstm.state();
        let mut rolled = [[0.0; 2]; 10];
        lstm.preview(&mut rolled);
        assert!(worst(rolled.as_flattened(), expected.as_flattened()) < tolerance, "{precision:?}");
        assert_eq!(lstm.state(), before);
    }
}

#[test]
fn saved_models_load_as_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = *model().weights.spec();
    (spec.residual, spec.input_clip, spec.input_scale, spec.leads) = (true, Some(4.25), 0.1, 3);
    let mut tensors = LstmTensors::zero(10, 3);
    for (i, value) in tensors.all_mut().into_iter().flatten().enumerate() {
        *value = 0.1 * i as f64;
    }
    let weights = foretrace_control::predict::LstmWeights::new(spec, tensors).unwrap();
    let notes = BTreeMap::from([("cité".to_owned(), "quotes \" and \\ and\nlines".to_owned())]);
    let model = LstmModel { file: "here".to_owned(), weights: Arc::new(weights), notes };
    let path = folder.path().join("model.safetensors");
    std::fs::write(&path, "what stood there before").unwrap();
    model.save(&path, DType::F64).unwrap();
    let loaded = LstmModel::load(&path).unwrap();
    assert_eq!((&loaded.weights, &loaded.notes), (&model.weights, &model.notes));
    assert_eq!(loaded.to_bytes(DType::F64), std::fs::read(&path).unwrap());
    // Single precision rounds once, then never again.
    model.save(&path, DType::F32).unwrap();
    let rounded = LstmModel::load(&path).unwrap();
    assert!(
        worst(&rounded.weights.tensors().weight_hh, &model.weights.tensors().weight_hh) < 1e-7 * 0.1 * 1000.0
    );
    assert_eq!(rounded.to_bytes(DType::F32), std::fs::read(&path).unwrap());
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "temporary files are left behind: {left:?}");
    let nowhere = folder.path().join("missing/model.safetensors");
    let error = model.save(&nowhere, DType::F32).unwrap_err().to_string();
    assert!(error.contains("missing/model.safetensors: cannot be written (No such file"), "{error}");
}

/// The fixture with metadata, then changed.
fn changed(change: impl FnOnce(&mut BTreeMap<String, String>, &mut Tensors)) -> String {
    let container = Container::read("fixture", PYTORCH).unwrap();
    let mut tensors: Tensors = container
        .tensors
        .iter()
        .map(|(name, t)| (name.clone(), (t.shape.clone(), t.numbers().unwrap())))
        .collect();
    let mut metadata = BTreeMap::from(
        [("input_scale", "10.5"), ("step_ns", "5000000")].map(|(k, v)| (k.to_owned(), v.to_owned())),
    );
    change(&mut metadata, &mut tensors);
    let tensors =
        tensors.iter().map(|(name, (shape, numbers))| (name.as_str(), (shape.clone(), numbers.as_slice())));
    let bytes = container_bytes(&metadata, &tensors.collect(), DType::F32);
    match LstmModel::parse("pen.safetensors", &bytes, Assumed::default()) {
        Ok(model) => format!("{:?}", model.weights.spec()),
        Err(error) => error.to_string(),
    }
}

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f64>)>;

const NAMES: &str =
    "lstm.weight_ih_l0, lstm.weight_hh_l0, lstm.bias_ih_l0, lstm.bias_hh_l0, out.weight, out.bias";

#[test]
fn unchanged_fixture_with_metadata_loads() {
    assert_eq!(
        changed(|_, _| {}),
        "LstmSpec { hidden: 10, leads: 1, residual: false, input_clip: None, input_scale: 10.5, step_ns: 5000000 }"
    );
}

#[test]
fn wrong_names_are_named() {
    let renamed = changed(|_, tensors| {
        let tensor = tensors.remove("out.weight").unwrap();
        tensors.insert("fc.weight".to_owned(), tensor);
    });
    assert_eq!(
        renamed,
        format!(
            "pen.safetensors: tensor out.weight is missing, the file has fc.weight, lstm.bias_hh_l0, \
             lstm.bias_ih_l0, \
             lstm.weight_hh_l0, lstm.weight_ih_l0, out.bias: name the tensors as PyTorch does ({NAMES})"
        )
    );
    let second_layer = changed(|_, tensors| {
        tensors.insert("lstm.weight_ih_l1".to_owned(), (vec![40, 10], vec![0.0; 400]));
    });
    assert_eq!(
        second_layer,
        format!(
            "pen.safetensors: tensor lstm.weight_ih_l1 is unknown, the network has {NAMES}: remove it, or \
             let its name \
             begin with `extra.`"
        )
    );
    let extra = changed(|_, tensors| {
        tensors.insert("extra.adam.m".to_owned(), (vec![3], vec![f64::NAN; 3]));
    });
    assert!(extra.starts_with("LstmSpec"), "{extra}");
    let none = changed(|_, tensors| tensors.clear());
    assert!(
        none.starts_with("pen.safetensors: tensor lstm.weight_hh_l0 is missing, the file has no tensors:"),
        "{none}"
    );
}

#[test]
fn wrong_shapes_and_sizes_are_named() {
    let wide = changed(|_, tensors| {
        tensors.insert("out.weight".to_owned(), (vec![4, 10], vec![0.0; 40]));
    });
    assert_eq!(
        wide,
        "pen.safetensors: tensor out.weight has shape [4, 10], needed is [2, 10] (H = 10, leads = 1): all \
         tensors must \
         come from one network on two inputs, and metadata `leads` from its training"
    );
    let projected = changed(|_, tensors| {
        tensors.insert("lstm.weight_hh_l0".to_owned(), (vec![40, 5], vec![0.0; 200]));
    });
    assert_eq!(
        projected,
        "pen.safetensors: tensor lstm.weight_hh_l0 has shape [40, 5], needed is [4H, H] (H cells, four gates \
         each): save \
         an nn.LSTM with one layer, one direction and no projection"
    );
    let eleven = changed(|_, tensors| {
        for (tensor, shape) in [
            ("lstm.weight_ih_l0", vec![44, 2]),
            ("lstm.weight_hh_l0", vec![44, 11]),
            ("lstm.bias_ih_l0", vec![44]),
            ("lstm.bias_hh_l0", vec![44]),
            ("out.weight", vec![2, 11]),
        ] {
            let count = shape.iter().product();
            tensors.insert(tensor.to_owned(), (shape, vec![0.0; count]));
        }
    });
    assert_eq!(
        eleven,
        "pen.safetensors: the LSTM has 11 cells, compiled are 10, 32 and 64: train one of these sizes"
    );
}

#[test]
fn wrong_dtypes_are_named() {
    // Half precision by hand: the same header with other words, half the bytes.
    let header = r#"{"lstm.weight_hh_l0":{"dtype":"F16","shape":[40,10],"data_offsets":[0,800]},"lstm.weight_ih_l0":{"dtype":"F16","shape":[40,2],"data_offsets":[800,960]}}"#;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.extend([0; 960]);
    assert_eq!(
        LstmModel::parse("pen.safetensors", &bytes, BARE).unwrap_err().to_string(),
        "pen.safetensors: tensor lstm.weight_ih_l0 is of dtype F16, legal are F32 and F64: convert it with \
         `.float()` \
         before saving"
    );
}

#[test]
fn poisoned_numbers_are_named_with_their_position() {
    let poisoned =
        |value: f64| changed(|_, tensors| tensors.get_mut("lstm.bias_ih_l0").unwrap().1[17] = value);
    for (value, written) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (2000.0, "2000")] {
        assert_eq!(
            poisoned(value),
            format!(
                "pen.safetensors: tensor lstm.bias_ih_l0 holds {written} at index 17 (counted row by row \
                 from 0), legal \
                 are finite values within ±1000: the training diverged or the file is damaged"
            )
        );
    }
}

#[test]
fn missing_and_wrong_metadata_is_named() {
    let with = |key: &str, value: &str| {
        changed(|metadata, _| drop(metadata.insert(key.to_owned(), value.to_owned())))
    };
    assert_eq!(
        changed(|metadata, _| drop(metadata.remove("step_ns"))),
        "pen.safetensors: metadata key `step_ns` is missing: save the model with \
         metadata={\"input_scale\": \"10.13\", \
         \"step_ns\": \"5000000\"} (RMS and step in ns of the displacements it was trained on)"
    );
    assert_eq!(
        with("input_scale", "ten"),
        "pen.safetensors: metadata key `input_scale` = \"ten\" cannot be read, legal is a positive number: \
         correct it and \
         save again"
    );
    assert_eq!(
        with("input_scale", "nan"),
        "pen.safetensors: the LSTM's input_scale is NaN, legal are 0.000000001 to 1000000000"
    );
    assert_eq!(
        with("residual", "yes"),
        "pen.safetensors: metadata key `residual` = \"yes\" cannot be read, legal is true or false: correct \
         it and save \
         again"
    );
    assert_eq!(
        with("leads", "65").split(": ").nth(1),
        Some("tensor out.weight has shape [2, 10], needed is [130, 10] (H = 10, leads = 65)")
    );
    assert_eq!(
        with("input_clp", "4"),
        "pen.safetensors: metadata key `input_clp` is unknown but looks like `input_clip`: correct it, or \
         name the note \
         otherwise"
    );
    assert!(with("note", "anything").starts_with("LstmSpec"));
}

#[test]
fn damaged_containers_are_refused_with_the_position() {
    let refused = |bytes: &[u8]| Container::read("x", bytes).unwrap_err().to_string();
    let with_header = |header: &str, data: usize| {
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header.as_bytes());
        bytes.resize(bytes.len() + data, 0);
        refused(&bytes)
    };
    let cut = "x: not a safetensors file, tensor \"out.weight\" lies at data bytes 2248 to 2328, there are \
               2327: save the \
               model with `safetensors.torch.save_file` or `foretrace lab train`";
    assert_eq!(refused(&PYTORCH[..PYTORCH.len() - 1]), cut);
    assert!(refused(&[1, 2, 3]).contains("it has 3 bytes, a header alone has 8"));
    assert!(refused(&[0xff; 64]).contains("its header would have 18446744073709551615 bytes, 56 follow"));
    assert!(with_header("[]", 0).contains("its header is not legal JSON"));
    let one = |offsets: &str| format!(r#"{{"a":{{"dtype":"F32","shape":[2],"data_offsets":{offsets}}}}}"#);
    assert!(
        with_header(&one("[4,12]"), 12)
            .contains("tensor \"a\" begins at data byte 4, the one before ends at 0")
    );
    assert!(with_header(&one("[0,8]"), 12).contains("its tensors end at data byte 8, its data at 12"));
    assert!(with_header(&one("[8,0]"), 12).contains("lies at data bytes 8 to 0"));
    assert!(with_header(&one("[0,18446744073709551615]"), 12).contains("there are 12"));
    assert!(with_header(&one("[0,-1]"), 12).contains("lacks a dtype, a shape, or data_offsets"));
    assert!(with_header(&one("[0,12]"), 12).contains("of dtype F32 and shape [2] has 12 bytes"));
    let twice = r#"{"a":{"dtype":"F32","shape":[1],"data_offsets":[0,4]},"a":{"dtype":"F32","shape":[1],"data_offsets":[4,8]}}"#;
    assert!(with_header(twice, 8).contains("tensor \"a\" stands in it twice"));
    let huge = r#"{"a":{"dtype":"F32","shape":[4294967296,4294967296],"data_offsets":[0,0]}}"#;
    assert!(with_header(huge, 0).contains("has 0 bytes"));
    assert!(with_header(r#"{"__metadata__":{"a":1}}"#, 0).contains("its metadata \"a\" is not text"));
    let nested = "[".repeat(100_000);
    assert!(with_header(&nested, 0).contains("not legal JSON"));
}

#[test]
fn models_that_are_not_there_are_named() {
    let error = LstmModel::find("lstm12").unwrap_err().to_string();
    assert!(error.starts_with("\"lstm12\" is neither a shipped model (lstm10-reference"), "{error}");
    let error = LstmModel::load(Path::new("/nowhere/x.safetensors")).unwrap_err().to_string();
    assert!(
        error.starts_with("/nowhere/x.safetensors: cannot be read (No such file or directory"),
        "{error}"
    );
    assert!(
        error.ends_with(&format!(
            "name a readable .safetensors file, or a shipped model ({})",
            shipped_names()
        ))
    );
}

#[test]
fn every_shipped_model_loads_has_a_card_and_is_as_foretrace_writes_it() {
    for Shipped { name, bytes, card } in Shipped::all() {
        assert!(card.starts_with(&format!("# {name}\n")), "{name}");
        for word in ["split", "seed", "scores", "citation", "icence"] {
            assert!(card.contains(word), "{name}.md says nothing about {word}");
        }
        if let Ok(model) = ForesightModel::parse(name, bytes) {
            assert!(model.notes.contains_key("citation"), "{name}");
            assert!(model.to_bytes() == *bytes, "{name} is not as foretrace would write it");
            continue;
        }
        let Ok(model) = shipped(name).unwrap().lstm() else { continue };
        assert!(model.notes.contains_key("citation"), "{name}");
        assert!(model.to_bytes(DType::F32) == *bytes, "{name} is not as foretrace would write it");
    }
}

#[test]
fn reference_is_for_five_milliseconds_and_no_other_loop() {
    let model = LstmModel::find("lstm10-reference").unwrap();
    assert_eq!(model.weights.spec().input_scale, 10.134_499_977_859_948);
    assert_eq!(model.fits(5_000_000), Ok(()));
    assert_eq!(
        model.fits(10_000_000).unwrap_err().to_string(),
        "lstm10-reference: the LSTM was trained at a step of 5000000 ns, the loop runs at 10000000 ns: take \
         a model for \
         this step, or train one"
    );
}
