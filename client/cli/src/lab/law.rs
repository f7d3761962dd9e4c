//! `foretrace lab law`: what half and double of each number of the law do.

use std::path::PathBuf;

use foretrace_control::estimate::{LawParameters, Number};
use foretrace_lab::closed_loop::{Benchmark, Flaws, HandOptions, NumberEffect, Rival, hands_of_set};
use foretrace_sim::data::Split;
use foretrace_sim::path::Lift;
use serde_json::json;

use super::closed_loop::arms;
use super::progress::StepProgress;
use crate::failure::Failure;
use crate::output::{JsonArgs, say, tell};
use crate::settings::SettingsArgs;
use crate::units::UnitArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct LawArgs {
    /// Data-set folders, comma-separated
    #[arg(long, value_name = "DIR", value_delimiter = ',', required = true)]
    data: Vec<PathBuf>,

    /// Part of the sets: a word of split.tsv, or all. Numbers are chosen by train writers
    #[arg(long, value_name = "WORD", default_value = "train")]
    split: Split,

    /// Arms, comma-separated
    #[arg(long, value_name = "NAMES", value_delimiter = ',', default_value = "ideal,delay30,ur5,slow")]
    arms: Vec<String>,

    /// Numbers, comma-separated [default: all]
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    numbers: Vec<String>,

    /// At most this many sequences of each hand, in the order of the file
    #[arg(long, value_name = "N", value_parser = super::count)]
    limit: Option<usize>,

    /// At most this many hands of each set, in the order of the files
    #[arg(long, value_name = "N", value_parser = super::count)]
    hands: Option<usize>,

    #[command(flatten)]
    unit: UnitArgs,

    /// Stop at a bad file instead of leaving it out
    #[arg(long)]
    strict: bool,

    #[command(flatten)]
    settings: SettingsArgs,

    #[command(flatten)]
    json: JsonArgs,
}

pub(super) fn run(args: &LawArgs) -> Result<(), Failure> {
    args.json.claim()?;
    let config = args.settings.load()?;
    let numbers = numbers(&args.numbers)?;
    let mut effects = Vec::new();
    for folder in &args.data {
        let options = HandOptions {
            split: Some(args.split.clone()),
            strict: args.strict,
            lift: Lift::Leap,
            sequences: args.limit,
            hands: args.hands,
            units: args.unit.units(),
        };
        let (set, arms) = hands_of_set(folder, &options, arms(&args.arms)?, &config, &tell)?;
        let law = LawParameters::SHIPPED;
        let benchmark = Benchmark { config: &config, arms, rivals: Vec::new(), flaws: Flaws::default(), law };
        let progress = StepProgress::of("lab law", benchmark.sensitivity_jobs(numbers.len()));
        let found = benchmark
            .sensitivity(Rival::AS_SHIPPED, &numbers, || progress.step())
            .map_err(|error| Failure::failed(error, ""))?;
        effects.extend(found.into_iter().map(|effect| (set.clone(), effect)));
    }
    say!("| number | value | change | geometric mean | least | most |\n|---|---|---|---|---|---|");
    for number in &numbers {
        let of = |(_, effect): &&(String, NumberEffect)| effect.number == number.name;
        let mut values: Vec<_> = effects.iter().filter(of).map(|(_, effect)| effect.value).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        for value in values {
            let ratios: Vec<_> = effects
                .iter()
                .filter(of)
                .filter(|(_, effect)| effect.value == value)
                .map(|(set, effect)| (effect.error_ratio, set.as_str(), effect.arm))
                .collect();
            say!("{}", row(number, value, &ratios));
        }
    }
    let cells: Vec<_> = effects.iter().map(|(set, effect)| json!({ "set": set, "effect": effect })).collect();
    args.json.write(&json!({ "cells": cells }))
}

/// A row of the table.
fn row(number: &Number, value: f64, ratios: &[(f64, &str, &str)]) -> String {
    let unit = if number.unit == "1" { String::new() } else { format!(" {}", number.unit) };
    let mean = ratios.iter().map(|(ratio, ..)| ratio.ln()).sum::<f64>() / ratios.len().max(1) as f64;
    let percent = |ratio: f64| {
        let tenths = (1000.0 * (ratio - 1.0)).round();
        if tenths == 0.0 { "0".to_owned() } else { format!("{:+.1} %", 0.1 * tenths) }
    };
    let cell = |chosen: Option<&(f64, &str, &str)>| {
        chosen.map_or_else(String::new, |(ratio, set, arm)| format!("{} {set} {arm}", percent(*ratio)))
    };
    let least = ratios.iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let most = ratios.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    format!(
        "| `{}` | {}{unit} | {value} | {} | {} | {} |",
        number.name,
        number.value,
        percent(mean.exp()),
        cell(least),
        cell(most)
    )
}

fn numbers(names: &[String]) -> Result<Vec<Number>, Failure> {
    if names.is_empty() {
        return Ok(LawParameters::NUMBERS.to_vec());
    }
    names.iter().map(|name| named_number(name.trim())).collect()
}

/// The number of the law with this name.
pub(super) fn named_number(name: &str) -> Result<Number, Failure> {
    LawParameters::named(name).copied().ok_or_else(|| {
        let known = LawParameters::NUMBERS.iter().map(|number| number.name).collect::<Vec<_>>().join(" ");
        Failure::usage(
            format_args!("no number of the law is called {name:?}"),
            format_args!("choose from {known}"),
        )
    })
}
