//! A whole loop that follows a pen, with the recorder; and its end, with every command accounted for.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write as _};
use std::rc::Rc;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use foretrace_client::{Mode, monotonic_now_ns};
use foretrace_shm::{JointCommand, Message};
use foretrace_tests::{PATIENT, Process, World, json, told, until};
use serde_json::Value;

use crate::PROGRAM;

/// What the recorder saw last.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Beat {
    pub(crate) mode: u64,
    pub(crate) pen_ns: u64,
    pub(crate) published_ns: u64,
}

/// The recorder's process, and its output.
pub(crate) struct Recorder {
    process: Process,
    until: std::path::PathBuf,
    last: Arc<Mutex<Vec<Beat>>>,
    reader: JoinHandle<Option<Value>>,
}

impl Recorder {
    fn start(world: &World, name: &str) -> Self {
        let until_file = world.file(name);
        let mut process = world.start(0, &["recorder", &until_file.display().to_string()]);
        let lines = BufReader::new(process.take_stdout().expect("a pipe")).lines();
        let last = Arc::new(Mutex::new(Vec::new()));
        let beats = last.clone();
        let (heard_in, heard) = std::sync::mpsc::channel();
        let reader = std::thread::spawn(move || {
            let mut report = None;
            for line in lines.map_while(Result::ok) {
                let Ok(said) = serde_json::from_str::<Value>(&line) else { continue };
                if said["report"].is_object() {
                    report = Some(said["report"].clone());
                } else if let Some(mode) = said["mode"].as_u64() {
                    let of = |key: &str| said[key].as_u64().unwrap_or(0);
                    let beat = Beat { mode, pen_ns: of("pen"), published_ns: of("published") };
                    beats.lock().expect("no panics").push(beat);
                } else {
                    let _ = heard_in.send(());
                }
            }
            report
        });
        let patience = Duration::from_secs(60);
        heard.recv_timeout(patience).expect("the recorder listens within a minute");
        Self { process, until: until_file, last, reader }
    }

    /// The first beat that `wanted` accepts.
    fn first(&self, wanted: impl Fn(&Beat) -> bool) -> Option<Beat> {
        self.last.lock().expect("no panics").iter().find(|beat| wanted(beat)).copied()
    }

    fn finish(self) -> Value {
        std::fs::write(&self.until, "").expect("own folder");
        let output = self.process.output();
        assert!(output.status.success(), "the recorder: {}", told(&output));
        self.reader.join().expect("no panics").expect("the recorder reports")
    }
}

/// Daemon, arm, pen and recorder. Whatever a test takes out it may leave out.
pub(crate) struct Scene {
    pub(crate) world: Rc<World>,
    pub(crate) daemon: Option<Process>,
    pub(crate) arm: Option<Process>,
    pub(crate) player: Option<Process>,
    recorder: Option<Recorder>,
    arms: u32,
    /// An arm failed on purpose: its measured position does not test the loop.
    pub(crate) arm_fails: bool,
    /// How often the arm's process was held up: it brakes where the loop does not know, and then refuses what
    /// was sent to an arm that follows.
    pub(crate) arm_held_up: u64,
    /// The last answer, for the diagnosis of a test that times out.
    noted: std::cell::RefCell<String>,
}

impl Drop for Scene {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let status = self.world.run(0, &["status"]);
            say("failed", &format!("last answer: {}\n{}", self.noted.borrow(), told(&status)));
            for process in [self.daemon.take(), self.arm.take(), self.player.take()].into_iter().flatten() {
                say("failed", &process.testify());
            }
        }
    }
}

/// Joint states older than this arm nothing, whatever the patience with an arm in charge: three cycles of 8
/// ms, and room \[ms\].
const FORGOTTEN_MS: f64 = 40.0;

/// How deep the tip may be pressed into the paper by an arm that loses its daemon while it lowers the pen
/// \[m\]. It follows the last command for up to 10 ms of validity and a cycle of 8 ms, at the 0.1875 m/s that
/// the preset's plan allows: 3.4 mm. Then its joints brake at 20 rad/s², each by itself: 0.4 rad/s take 20
/// ms, 1.9 mm. On top of the workspace's 0.5 mm and the envelope's 1 mm.
const DEEPEST_M: f64 = 0.0068;

/// The options of the hand that writes, over and over.
pub(crate) const PLAY: [&str; 3] = ["play", "glyphs:ab", "--loop"];

impl Scene {
    /// Everything runs and follows the pen.
    pub(crate) fn following() -> Self {
        Self::following_in(World::new(PROGRAM))
    }

    pub(crate) fn following_in(world: impl Into<Rc<World>>) -> Self {
        Self::following_with(world, &[])
    }

    /// The same, with further options for the daemon.
    pub(crate) fn following_with(world: impl Into<Rc<World>>, daemon: &[&str]) -> Self {
        let mut scene = Self::idle_with(world, daemon);
        scene.start_arm();
        let since = monotonic_now_ns();
        scene.player = Some(scene.world.start(0, &PLAY));
        scene.follows_again(since);
        scene
    }

    /// Everything but a pen.
    pub(crate) fn armed_in(world: impl Into<Rc<World>>) -> Self {
        let mut scene = Self::idle_in(world);
        scene.start_arm();
        scene
    }

    /// Everything but a pen, with further options for the arm.
    pub(crate) fn armed_with(arm: &[&str]) -> Self {
        let mut scene = Self::idle_in(World::new(PROGRAM));
        scene.start_arm_with(arm);
        scene
    }

    /// Daemon and recorder only.
    pub(crate) fn idle_in(world: impl Into<Rc<World>>) -> Self {
        Self::idle_with(world, &[])
    }

    pub(crate) fn idle_with(world: impl Into<Rc<World>>, daemon: &[&str]) -> Self {
        let world = world.into();
        let daemon = world.daemon_with(0, &[&PATIENT, daemon].concat());
        let recorder = Recorder::start(&world, "enough");
        Self {
            world,
            daemon: Some(daemon),
            arm: None,
            player: None,
            recorder: Some(recorder),
            arms: 0,
            arm_fails: false,
            arm_held_up: 0,
            noted: String::new().into(),
        }
    }

    /// Where the next arm is to write its report.
    pub(crate) fn next_arm_report(&mut self) -> String {
        self.arms += 1;
        self.world.file(&format!("arm-{}.json", self.arms)).display().to_string()
    }

    /// A new arm, armed.
    pub(crate) fn start_arm(&mut self) {
        self.start_arm_with(&[]);
    }

    /// The same with further options.
    fn start_arm_with(&mut self, options: &[&str]) {
        self.arm_fails |= options.contains(&"--fault");
        if self.arms > 0 {
            // The next arm stands elsewhere: the last word of the one before must be too old to be armed at.
            // Without a daemon there is nothing to wait for.
            until("the old arm is forgotten", || {
                let asked = self.world.run(0, &["status", "--json", "-"]);
                let status: Value = serde_json::from_slice(&asked.stdout).unwrap_or_default();
                let age_ms = status["arm"]["age_ms"].as_f64();
                age_ms.is_none_or(|age_ms| age_ms > FORGOTTEN_MS).then_some(())
            });
        }
        let report = self.next_arm_report();
        let arm = self.world.start(0, &[&["arm", "sim", "--json", &report], options].concat());
        self.arm = Some(arm);
        self.rearm();
    }

    /// Arms the arm that is there.
    pub(crate) fn rearm(&mut self) {
        let mut arm = self.arm.take().expect("an arm");
        self.world.arm(0, &mut arm);
        self.arm = Some(arm);
    }

    /// Waits for a command that follows a pen sample younger than `since_ns`; returns the milliseconds from
    /// there to it.
    pub(crate) fn follows_again(&self, since_ns: u64) -> f64 {
        until("commands follow the pen again", || self.follows_now(since_ns))
    }

    /// The same without waiting.
    pub(crate) fn follows_now(&self, since_ns: u64) -> Option<f64> {
        let following = u64::from(u32::from(Mode::Following));
        let newer = |beat: &Beat| beat.pen_ns > since_ns && beat.published_ns > since_ns;
        let beat = self.recorder.as_ref()?.first(|beat| beat.mode == following && newer(beat))?;
        Some((beat.published_ns - since_ns) as f64 * 1e-6)
    }

    /// How long after `since_ns` the first command of a stop left, if one has \[ms\].
    pub(crate) fn stopped_at(&self, since_ns: u64) -> Option<f64> {
        let stopped = u64::from(u32::from(Mode::Stopped));
        let recorder = self.recorder.as_ref()?;
        let beat = recorder.first(|beat| beat.mode == stopped && beat.published_ns > since_ns)?;
        Some((beat.published_ns - since_ns) as f64 * 1e-6)
    }

    /// Keeps an answer, should the test fail.
    pub(crate) fn note(&self, answer: String) {
        *self.noted.borrow_mut() = answer;
    }

    /// A count in the status, by its JSON pointer.
    pub(crate) fn count(&self, pointer: &str) -> u64 {
        let status = self.world.status(0);
        let found = status.pointer(pointer).and_then(Value::as_u64);
        found.unwrap_or_else(|| panic!("{pointer} is no count in {status}"))
    }

    /// Runs `foretrace forge KIND SECONDS` to its end; returns what it says last.
    pub(crate) fn forge(&self, kind: &str, seconds: &str) -> Value {
        last_line(&self.world.run(0, &["forge", kind, seconds]))
    }

    /// Kills everything at once, recorder included.
    pub(crate) fn slaughter(mut self) {
        let recorder = self.recorder.take().map(|recorder| recorder.process);
        for process in
            [self.daemon.take(), self.arm.take(), self.player.take(), recorder].into_iter().flatten()
        {
            process.kill();
        }
    }

    /// Ends everything in order and judges: no command broke a rule, none is unaccounted for, nothing is left
    /// behind. Returns the recorder's report.
    pub(crate) fn end(self) -> Value {
        self.end_and_listen().0
    }

    /// The same; returns also the number of bytes of the daemon's output that were not read.
    pub(crate) fn end_and_listen(mut self) -> (Value, usize) {
        if let Some(player) = self.player.take() {
            player.end();
        }
        if self.arm.is_some() && self.daemon.is_some() {
            // Not armed any more, for example: nothing to let go of.
            let _ = self.world.run(0, &["request", "disarm"]);
            until("the loop comes to rest", || {
                let mode = self.world.status(0)["mode"].clone();
                (mode == "idle" || mode == "stopped" || mode == "fault").then_some(())
            });
        }
        // A stopping loop still sends commands; the status is a tenth of a second old.
        let sent = self.daemon.is_some().then(|| {
            std::thread::sleep(Duration::from_millis(300));
            let status = self.world.status(0);
            assert_eq!(status["arm"]["commands_failed"], 0, "{status}");
            status["arm"]["commands_sent"].as_u64().expect("a count")
        });
        if let Some(arm) = self.arm.take() {
            arm.end();
            let report = json(&self.world.file(&format!("arm-{}.json", self.arms)));
            assert_eq!(report["commands"]["limit_violations"], 0, "{report}");
            let count = |key: &str| report.pointer(key).and_then(Value::as_u64).expect("a count");
            let jumps = count("/commands/refused/jump");
            assert!(jumps <= self.arm_held_up * JointCommand::QOS.buffer as u64, "{report}");
            assert!(jumps == 0 || count("/commands/lost") > 0, "{report}");
        }
        std::thread::sleep(Duration::from_millis(100));
        let report = self.recorder.take().expect("a recorder").finish();
        assert_eq!(report["violations"], 0, "{report}");
        // Whichever process died: the measured arm stayed over the paper and in the workspace.
        let envelope = &report["envelope"];
        let figure = |key: &str| envelope[key].as_f64().filter(|_| !self.arm_fails);
        if let (Some(low), Some(outside)) = (figure("height_min_m"), figure("outside_max_m")) {
            assert!(low >= -DEEPEST_M && outside <= 0.003, "{report}");
        }
        let count = |key: &str| report[key].as_u64().expect("a count");
        if let Some(sent) = sent {
            // A daemon that sent nothing yet has nothing to be compared with.
            assert!(sent == 0 || count("last_sequence") == sent, "{sent} commands sent, but {report}");
        }
        // A recorder without CPU time for half a second misses commands, and reports it.
        assert!(count("missed") * 20 <= count("seen"), "{report}");
        let said = self.daemon.take().map_or(0, |daemon| daemon.end().stderr.len());
        assert_nothing_left(&self.world);
        (report, said)
    }
}

/// Nothing of this world is left in shared memory.
pub(crate) fn assert_nothing_left(world: &World) {
    let asked = world.run(0, &["leftovers"]);
    assert!(asked.status.success(), "{}", told(&asked));
    let left = last_line(&asked);
    for (key, none) in
        [("alive", "[]"), ("dead", "[]"), ("damaged", "0"), ("held", "false"), ("segments", "0")]
    {
        assert_eq!(left[key].to_string(), none, "{left}");
    }
}

/// The last line of stdout, as JSON.
pub(crate) fn last_line(output: &std::process::Output) -> Value {
    assert!(output.status.success(), "{}", told(output));
    let text = String::from_utf8_lossy(&output.stdout);
    let line = text.lines().last().unwrap_or_default();
    serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))
}

/// Says what was measured, past the test harness' capture.
pub(crate) fn say(fault: &str, what: &str) {
    let _ = writeln!(std::io::stderr(), "chaos: {fault}: {what}");
}

/// Says median and largest of recovery times \[ms\].
pub(crate) fn say_times(fault: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let mut text = String::new();
    if let (Some(median), Some(most)) = (times.get(times.len() / 2), times.last()) {
        let _ = write!(
            text,
            "{} times, recovered after {median:.0} ms (median), {most:.0} ms (longest)",
            times.len()
        );
    }
    say(fault, &text);
}

/// How often to kill, of all rounds `share` for this test; at least twice.
pub(crate) fn rounds(share: u32) -> u32 {
    let asked = std::env::var("FORETRACE_CHAOS_ROUNDS").ok();
    let all = asked.map_or(20, |text| {
        text.parse()
            .unwrap_or_else(|_| panic!("FORETRACE_CHAOS_ROUNDS is {text:?}, and must be a whole number"))
    });
    u32::max(all / share, 2)
}

/// Moments that differ from run to run only by FORETRACE_CHAOS_SEED (and by what the machine makes of them).
pub(crate) struct Moments(u64);

impl Moments {
    pub(crate) fn new() -> Self {
        let asked = std::env::var("FORETRACE_CHAOS_SEED").ok().and_then(|text| text.parse().ok());
        Self(asked.unwrap_or(1))
    }

    /// Sleeps for up to `ms` milliseconds.
    pub(crate) fn wait(&mut self, ms: u64) {
        // Knuth's MMIX.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        std::thread::sleep(Duration::from_micros((self.0 >> 33) % (1000 * ms)));
    }
}
