//! Whole programs, from outside.

mod bench_against;
mod calibrate;
mod chain;
mod chaos;
mod console;
mod demo;
mod doctor;
mod foxglove;
mod hands;
mod lab_closed_loop;
mod lab_sets;
mod lab_shards;
mod lab_tables;
mod move_home;
mod page_faults;
mod places;
mod record;
mod recordings;
mod refused;
mod rehearsal;
mod results_pages;
mod relay;
mod security;
mod snippets;
mod snippets_demo;
mod snippets_shell;
mod spinning;
mod syscalls;
mod train;
mod ur_settings;
mod wrong_input;

const PROGRAM: &str = env!("CARGO_BIN_EXE_foretrace-under-test");
