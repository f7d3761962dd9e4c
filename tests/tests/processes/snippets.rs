//! Every Rust snippet of the documents is compiled, and is what the document says.
//!
//! The functions below are the documents' snippets with what their readers bring themselves (a tablet, an
//! arm, a proposal). They are not called: they would need a daemon and never end. A snippet that no function
//! here has, letter for letter, fails the test; one that does not compile fails the build. Settings must be
//! accepted, dependencies be crates of this workspace, and blocks are of a kind that is checked. Shell:
//! [`crate::snippets_shell`].

#![allow(dead_code, reason = "compiled, not run")]

use std::error::Error;
use std::path::{Path, PathBuf};

use foretrace_client::{JOINTS, PenReading, monotonic_now_ns};
use foretrace_control::guard::Commanded as Command;
use foretrace_control::units::Stamp;

/// The predictors of docs/extend/predictor.md, which are compiled and run by the law's tests, and where they
/// are listed.
const EXAMPLES: [&str; 3] = [
    include_str!("../../../daemon/control/examples/predictors/damped_velocity.rs"),
    include_str!("../../../daemon/control/examples/predictors/learned_damping.rs"),
    include_str!("../../../daemon/control/src/predict/models/mod.rs"),
];

/// What a reader has.
struct Arm;

impl Arm {
    fn servo(&mut self, _q: [f64; JOINTS], _qd: [f64; JOINTS]) {}
    fn brake(&mut self) {}
    fn measured(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        ([0.0; JOINTS], [0.0; JOINTS])
    }
    fn may_move(&self) -> bool {
        true
    }
    fn has_power(&self) -> bool {
        true
    }
}

struct Switch;

impl Switch {
    fn is_held(&self) -> bool {
        false
    }
}

fn read_my_tablet() -> (u64, f64, f64, bool) {
    (monotonic_now_ns(), 0.01, 0.02, true)
}

fn now() -> Stamp {
    Stamp(monotonic_now_ns())
}

fn my_proposal() -> [f64; 2] {
    [0.1, f64::NAN]
}

fn send(_command: &Command<2>) {}

const PERIOD_NS: u64 = 2_000_000;
const VALID_NS: u64 = 10_000_000;

#[rustfmt::skip]
fn pen() -> Result<(), Box<dyn Error>> {
    use foretrace_client::{FeedError, Foretrace, PenReading};

    let foretrace = Foretrace::attach(0)?;              // instance 0; says what to do if no daemon runs
    let mut pen = foretrace.pen_feed()?;
    loop {
        let (device_stamp_ns, x_m, y_m, contact) = read_my_tablet();   // on CLOCK_MONOTONIC; its own plane
        match pen.send(PenReading { device_stamp_ns, x_m, y_m, contact, ..Default::default() }) {
            Ok(_heard) => {}
            Err(FeedError::HandedOver) => break,        // somebody else asked for the pen
            Err(error) => eprintln!("left out: {error}"),   // one bad reading ends nothing
        }
    }
    Ok(())
}

#[rustfmt::skip]
fn pen_of_another_user(x_m: f64, y_m: f64, contact: bool) -> Result<(), Box<dyn Error>> {
    let mut pen = foretrace_client::GatewayFeed::connect("/tmp/foretrace-pen.socket")?;    // instead of attach and pen_feed
    pen.send(PenReading { device_stamp_ns: monotonic_now_ns(), x_m, y_m, contact, ..Default::default() })?;
    println!("{}", pen.finish()?);          // ... closed: ended by the client; 802 samples passed on, 0 refused
    Ok(())
}

#[rustfmt::skip]
fn watch() -> Result<(), Box<dyn Error>> {
    use foretrace_client::{Foretrace, Stage};

    let foretrace = Foretrace::attach(0)?;
    let mut telemetry = foretrace.telemetry()?;
    telemetry.drain(|record| {                          // one TickRecord per tick: what it saw, decided and cost
        println!("{} ns late, {} ns of work", record.stage(Stage::Wakeup), record.stage(Stage::Step));
        println!("pen sample {} is {} ns old", record.pen_sequence, record.chain.pen_age_ns);
    });
    println!("{} records lost", telemetry.lost());
    Ok(())
}

#[rustfmt::skip]
fn hardware(mut my_arm: Arm) -> Result<(), Box<dyn Error>> {
    use foretrace_client::{Demand, Foretrace, JointState, RobotMode, SafetyMode, demand_at, monotonic_now_ns};

    let foretrace = Foretrace::attach(0)?;
    let (mut commands, mut states) = (foretrace.commands(1)?, foretrace.joint_states()?);
    loop {                                              // at your controller's rate
        let now = monotonic_now_ns();
        match commands.latest().map_or(Demand::Brake, |command| demand_at(command, now)) {
            Demand::Follow { q, qd } => my_arm.servo(q, qd),   // q + q̇·(now − stamp), until valid_until
            Demand::Brake => my_arm.brake(),                   // no command, an old one, or not armed: stop by yourself
        }
        let (q, qd) = my_arm.measured();                       // rad, rad/s
        let measured_ns = monotonic_now_ns();
        let safety_mode = if my_arm.may_move() { SafetyMode::Normal } else { SafetyMode::ProtectiveStop };
        let robot_mode = if my_arm.has_power() { RobotMode::Running } else { RobotMode::PowerOff };
        let modes = JointState { safety_mode: safety_mode.into(), robot_mode: robot_mode.into(), ..commands.echo() };
        if let Err(error) = states.publish(measured_ns, JointState { q, qd, ..modes }) {
            eprintln!("left out: {error}");                    // go on: who ends here brakes nothing
        }
    }
}

#[rustfmt::skip]
fn dead_man(my_switch: &Switch) -> Result<(), Box<dyn Error>> {
    use foretrace_client::Foretrace;

    let mut dead_man = Foretrace::attach(0)?.dead_man()?;
    while my_switch.is_held() {
        dead_man.beat()?;                                      // 50 times per second
        std::thread::sleep(foretrace_client::DeadMan::INTERVAL);
    }
    dead_man.stop()?;                                          // falling silent stops as well, a little later
    Ok(())
}

#[rustfmt::skip]
fn guard_alone(position: [[f64; 2]; 2], [velocity, acceleration, braking, measured]: [[f64; 2]; 4]) -> Result<(), Box<dyn Error>> {
    use foretrace_control::guard::{Commanded, Guard, consumer_state};
    use foretrace_control::arm::JointLimits;

    let limits = JointLimits::new(position, velocity, acceleration)?    // any number of joints; rad, rad/s, rad/s²
        .with_stale_braking(0.010, braking)?;           // how the arm stops by itself: extrapolates for 10 ms, then brakes
    let guard = Guard::new(limits);
    let mut last = Commanded::at_rest(now(), measured).ok_or("not finite")?;
    loop {
        let at = now();
        if at >= last.stamp() + PERIOD_NS {             // time was lost: go on from where the arm braked to by itself
            let arm = consumer_state(&last, last.stamp() + VALID_NS, limits.deceleration(), at);
            last = Commanded::new(at, arm).ok_or("not finite")?;
        }
        let verdict = guard.clamp(&last, &my_proposal(), last.stamp() + PERIOD_NS);    // and `verdict.reasons` says what was wrong
        send(&verdict.command);                         // q, q̇, and the stamp at which they hold
        last = verdict.command;
    }
}

/// The documents with their place: those at the top, the book, the cards of the models.
pub(crate) fn documents() -> Vec<(PathBuf, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let (mut found, mut folders) = (Vec::new(), vec![root.join("docs"), root.join("config/models")]);
    let mut look = |folder: &Path, folders: Option<&mut Vec<PathBuf>>| {
        let (below, files): (Vec<PathBuf>, Vec<PathBuf>) = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .partition(|path| path.is_dir());
        for path in files.into_iter().filter(|path| path.extension().is_some_and(|ending| ending == "md")) {
            let text = std::fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
        if let Some(folders) = folders {
            folders.extend(below);
        }
    };
    look(&root, None);
    while let Some(folder) = folders.pop() {
        look(&folder, Some(&mut folders));
    }
    found
}

/// What stands between fences of a document, with the word behind the first of them; without the indentation
/// of a list.
pub(crate) fn blocks(text: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut block: Option<(String, String, usize)> = None;
    for line in text.lines() {
        if let Some(kind) = line.trim_start().strip_prefix("```") {
            match block.take() {
                Some((kind, body, _)) => found.push((kind, body)),
                None => block = Some((kind.to_owned(), String::new(), line.len() - line.trim_start().len())),
            }
        } else if let Some((_, body, indent)) = &mut block {
            body.push_str(line.get(*indent..).unwrap_or_default());
            body.push('\n');
        }
    }
    assert!(block.is_none(), "a block without an end");
    found
}

/// The blocks of one kind with the document that each stands in.
pub(crate) fn blocks_of(wanted: &str) -> Vec<(PathBuf, String)> {
    let of = |(path, text): (PathBuf, String)| {
        let here = blocks(&text).into_iter().filter(|(kind, _)| kind == wanted);
        here.map(|(_, body)| (path.clone(), body)).collect::<Vec<_>>()
    };
    documents().into_iter().flat_map(of).collect()
}

#[test]
fn every_block_of_the_documents_is_of_a_kind_that_is_checked() {
    for (path, text) in documents() {
        for (kind, body) in blocks(&text) {
            // C++ is built by tests/c/judge.sh, Python run by tests/python/judge.sh.
            let known = ["rust", "sh", "toml", "text", "cpp", "python"].contains(&kind.as_str());
            assert!(
                known,
                "{}: a block of kind {kind:?}; text is what a program prints:\n{body}",
                path.display()
            );
        }
    }
}

#[test]
fn every_rust_snippet_of_the_documents_is_compiled_here_letter_for_letter() {
    let compiled = include_str!("snippets.rs");
    let snippets = blocks_of("rust");
    assert!(snippets.len() >= 5, "only {} snippets were found", snippets.len());
    for (path, snippet) in snippets {
        let indented: String = snippet
            .lines()
            .map(|line| if line.is_empty() { "\n".to_owned() } else { format!("    {line}\n") })
            .collect();
        // From the start of a line: an example must not match in the middle of one.
        let example = || EXAMPLES.iter().any(|file| format!("\n{file}").contains(&format!("\n{snippet}")));
        assert!(
            compiled.contains(&indented) || example(),
            "{}: this snippet is not compiled; put it into a function of tests/tests/processes/snippets.rs:\n{snippet}",
            path.display()
        );
    }
}

/// Whether a manifest's dependencies are crates of this workspace, seen from a folder beside the repository.
fn depends_on_crates_of_ours(manifest: &toml::Table) -> Result<(), String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let dependencies =
        manifest.get("dependencies").and_then(toml::Value::as_table).ok_or("no [dependencies]")?;
    for (name, dependency) in dependencies {
        let path =
            dependency.get("path").and_then(toml::Value::as_str).ok_or(format!("{name} has no path"))?;
        let folder =
            path.strip_prefix("../foretrace/").ok_or(format!("{path} is not beside the repository"))?;
        let theirs = std::fs::read_to_string(root.join(folder).join("Cargo.toml"))
            .map_err(|error| format!("{path}: {error}"))?;
        let theirs: toml::Table = theirs.parse().map_err(|error| format!("{path}: {error}"))?;
        if theirs["package"]["name"].as_str() != Some(name) {
            return Err(format!("{path} is not {name}"));
        }
    }
    if manifest.len() == 1 { Ok(()) } else { Err("more than [dependencies]".to_owned()) }
}

#[test]
fn every_toml_snippet_of_the_documents_is_accepted_as_settings_or_as_dependencies() {
    let (mut settings, mut manifests) = (0, 0);
    for (path, snippet) in blocks_of("toml") {
        let outcome = if snippet.contains("preset = ") {
            settings += 1;
            foretrace_config::Config::parse(&snippet, "a snippet", "/")
                .map(drop)
                .map_err(|error| error.to_string())
        } else {
            manifests += 1;
            let manifest: Result<toml::Table, _> = snippet.parse();
            manifest
                .map_err(|error| error.to_string())
                .and_then(|manifest| depends_on_crates_of_ours(&manifest))
        };
        if let Err(why) = outcome {
            panic!("{}: {why}\n{snippet}", path.display());
        }
    }
    assert!(settings >= 2 && manifests >= 3, "found {settings} settings and {manifests} manifests");
}

#[test]
fn the_first_predictor_of_ones_own_is_shown_whole() {
    let [whole, ..] = EXAMPLES;
    let (_, code) = whole.split_once("\n\n").unwrap();
    let (code, _) = code.split_once("\n#[cfg(test)]").unwrap();
    let shown = blocks_of("rust").iter().any(|(_, snippet)| snippet == code);
    assert!(shown, "docs/extend/predictor.md does not show the whole of damped_velocity.rs");
}
