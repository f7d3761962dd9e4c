//! Somebody else's eyes on the arm, and what they judge.

use std::io::{BufRead, BufReader};
use std::net::SocketAddrV4;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::Duration;

use foretrace_config::Config;
use foretrace_control::arm::JointLimits;
use foretrace_tests::until;
use foretrace_ur::rtde::{RtdeClient, RtdeValue};

use super::scene::Series;

const JOINTS: usize = 6;
/// Nearer than this to where it ends an arm rests \[rad\], if it stays for so long \[s\].
const REST_RAD: f64 = 1e-6;
const RESTS_S: f64 = 0.6;
/// Fewer states than this of a round tell nothing.
const LEAST_JUDGED: usize = 20;
const PATIENCE: Duration = Duration::from_secs(5);
/// Of the hardest that the program may do, it does at least this.
const LEAST_HARDNESS: f64 = 0.25;
/// Of the program on the controller: what it does. 2 follows.
const STATE: &str = "output_int_register_25";
const FOLLOWS: i32 = 2;

/// One state of the controller.
#[derive(Debug, Clone, Copy)]
struct Sight {
    /// Of the controller's clock \[s\].
    t: f64,
    /// Measured \[rad\].
    q: [f64; JOINTS],
    /// Asked for \[rad/s\]; zero where the client does not read it.
    qd: [f64; JOINTS],
    /// Asked for \[rad/s²\].
    qdd: [f64; JOINTS],
    /// Of the program.
    state: i32,
}

pub(super) struct Watcher {
    limits: JointLimits<JOINTS>,
    seen: Arc<Mutex<Vec<Sight>>>,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// The client of somebody else, if it is one.
    other: Option<Child>,
}

impl Watcher {
    /// Watches the controller behind `address`, with the client of the Python environment `venv` if there is
    /// one.
    pub(super) fn open(address: SocketAddrV4, series: Series, venv: Option<PathBuf>) -> Self {
        let limits = Config::preset(series.preset()).expect("a preset").robot().limits;
        let (seen, ends) = (Arc::default(), Arc::new(AtomicBool::new(false)));
        let (shared, stop): (Arc<Mutex<Vec<Sight>>>, _) = (Arc::clone(&seen), Arc::clone(&ends));
        let mut other = venv.map(|venv| {
            let script = concat!(env!("CARGO_MANIFEST_DIR"), "/ur/watch.py");
            let mut python = Command::new(venv.join("bin/python"));
            python.arg(script).arg(address.ip().to_string()).arg(series.rate_hz().to_string());
            python.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("FORETRACE_UR_VENV has Python")
        });
        let thread = match other.as_mut().and_then(|other| other.stdout.take()) {
            Some(lines) => std::thread::spawn(move || {
                for line in BufReader::new(lines).lines().map_while(Result::ok) {
                    shared
                        .lock()
                        .expect("no thread panics")
                        .push(read(&line).expect("watch.py writes these"));
                }
            }),
            None => {
                let mut client = RtdeClient::connect(address.into(), PATIENCE).expect("RTDE answers");
                let names = ["timestamp", "actual_q", "target_qd", "target_qdd", STATE];
                client.set_up_outputs(&names, f64::from(series.rate_hz())).expect("known fields");
                client.start().expect("it starts");
                std::thread::spawn(move || {
                    while !stop.load(Ordering::Relaxed) {
                        let Ok(package) = client.receive(Duration::from_millis(100)) else { return };
                        if let Some(sight) = package.as_ref().and_then(|package| sight(&package.values)) {
                            shared.lock().expect("no thread panics").push(sight);
                        }
                    }
                })
            }
        };
        let watcher = Self { limits, seen, ends, thread: Some(thread), other };
        until("the controller is seen", || watcher.seen().last().copied());
        watcher
    }

    /// Whose client it is.
    pub(super) const fn whose(&self) -> &'static str {
        if self.other.is_some() { "ur_rtde" } else { "an own client" }
    }

    fn seen(&self) -> MutexGuard<'_, Vec<Sight>> {
        self.seen.lock().expect("no thread panics")
    }

    /// What was seen before `from_s` of the controller's clock counts no more, but for the state just before
    /// it: a motion has to be seen from its beginning.
    pub(super) fn forget(&self, from_s: f64) {
        let mut seen = self.seen();
        let old = seen.partition_point(|sight| sight.t < from_s);
        seen.drain(..old.saturating_sub(1));
    }

    /// The program on the controller follows, as it was last seen.
    pub(super) fn follows(&self) -> bool {
        self.seen().last().is_some_and(|sight| sight.state == FOLLOWS)
    }

    /// When a joint was seen faster than `speed_radps`, if just now, on the controller's clock \[s\].
    pub(super) fn moving(&self, speed_radps: f64) -> Option<f64> {
        let seen = self.seen();
        let [.., a, b] = seen[..] else { return None };
        let fastest = a.q.iter().zip(&b.q).map(|(a, b)| (b - a).abs()).fold(0.0, f64::max);
        (b.t > a.t && fastest / (b.t - a.t) > speed_radps).then_some(b.t)
    }

    /// Waits until the arm has rested for longer than a pen pauses; returns since when, on the controller's
    /// clock \[s\].
    pub(super) fn rests(&self) -> f64 {
        until("the arm rests", || {
            let seen = self.seen();
            let last = seen.last()?;
            let since = seen.iter().rev().take_while(|sight| near(sight, last)).last()?.t;
            (last.t - since > RESTS_S).then_some(since)
        })
    }

    /// For a second of the controller's clock from now, and since it came to rest, nothing moves; otherwise
    /// how it did.
    pub(super) fn stands_for_a_second(&self) -> Result<(), String> {
        let since = self.rests();
        let now = self.seen().last().expect("it is watched").t;
        until("a second of the controller passes", || {
            self.seen().last().filter(|last| last.t > now + 1.0).map(|_| ())
        });
        let seen = self.seen();
        let mut after = seen.iter().filter(|sight| sight.t >= since);
        let stood = *after.next().expect("it is watched");
        let moved = after.find(|sight| !near(sight, &stood));
        moved.map_or(Ok(()), |moved| Err(format!("now is {now}, {moved:?} from {stood:?}")))
    }

    /// No state since it was last told to forget was out of what the arm may do.
    pub(super) fn judge(&self, when: &str) {
        let seen = self.seen();
        let mut judged = 0;
        for three in seen.windows(3).filter(|w| w[0].t < w[1].t && w[1].t < w[2].t) {
            let [a, b, c] = [three[0], three[1], three[2]];
            judged += 1;
            for joint in 0..JOINTS {
                let [first, second] = [(a, b), (b, c)].map(|(a, b)| (b.q[joint] - a.q[joint]) / (b.t - a.t));
                let speed = second.abs();
                assert!(speed < 1.001 * self.limits.velocity()[joint], "{when}: {speed} rad/s at {}", c.t);
                // Mean speeds of neighbouring intervals differ by no more than this, however long they are.
                let hard = (second - first).abs() / (0.5 * (c.t - a.t));
                let most = self.limits.acceleration()[joint];
                assert!(hard < 1.01 * most, "{when}: {hard} rad/s² at {}", c.t);
            }
        }
        assert!(judged >= LEAST_JUDGED, "{when}: only {judged} states seen");
    }

    /// The program on the controller braked with no more than its own deceleration; if it was `alone` with
    /// the arm, it did brake.
    pub(super) fn judge_program(&self, when: &str, alone: bool) {
        let seen = self.seen();
        let mut hardest = 0.0f64;
        for braking in seen.iter().filter(|sight| sight.state != FOLLOWS) {
            for (joint, qdd) in braking.qdd.iter().enumerate() {
                let most = self.limits.deceleration()[joint];
                assert!(qdd.abs() < 1.001 * most, "{when}: joint {joint} braked: {braking:?}");
                hardest = hardest.max(qdd.abs());
            }
        }
        if !alone {
            return;
        }
        let turn = seen.windows(2).rfind(|pair| pair[0].state == FOLLOWS && pair[1].state != FOLLOWS);
        let Some([before, after]) = turn else { panic!("{when}: the program did not stop by itself") };
        // An arm that happens to be slow then stands after one cycle, without all of it.
        let slowest = self.limits.deceleration().iter().copied().fold(f64::INFINITY, f64::min);
        let fastest = before.qd.iter().fold(0.0, |fastest: f64, qd| fastest.max(qd.abs()));
        let needed = slowest.min(fastest / (after.t - before.t));
        assert!(hardest >= LEAST_HARDNESS * needed, "{when}: {hardest} rad/s² from {before:?}");
    }
}

fn near(a: &Sight, b: &Sight) -> bool {
    a.q.iter().zip(&b.q).all(|(a, b)| (a - b).abs() < REST_RAD)
}

/// What the own client asked for, in its order.
fn sight(values: &[RtdeValue]) -> Option<Sight> {
    match *values {
        [
            RtdeValue::Double(t),
            RtdeValue::Vector6d(q),
            RtdeValue::Vector6d(qd),
            RtdeValue::Vector6d(qdd),
            RtdeValue::Int32(state),
        ] => Some(Sight { t, q, qd, qdd, state }),
        _ => None,
    }
}

/// A line of watch.py: time, joints, accelerations. It cannot read the register of the program's state.
fn read(line: &str) -> Option<Sight> {
    let numbers: Option<Vec<f64>> = line.split(' ').map(|word| word.parse().ok()).collect();
    let numbers: [f64; 1 + 2 * JOINTS] = numbers?.try_into().ok()?;
    let six = |from: usize| std::array::from_fn(|joint| numbers[from + joint]);
    Some(Sight { t: numbers[0], q: six(1), qd: [0.0; JOINTS], qdd: six(1 + JOINTS), state: FOLLOWS })
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(other) = &mut self.other {
            let _ = other.kill();
            let _ = other.wait();
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
