//! Arms of which one or two joints do not answer as the others, and arms whose servo swings over: the
//! daemon's law in simulated time, beside the same arm without its fault.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use crate::desk::{Desk, DeskArm, Pen, home};
use foretrace_config::Config;
use foretrace_control::arm::Chain;
use foretrace_control::follower::Request;
use foretrace_control::monitor::TrackingSettings;
use foretrace_control::stop::{StopDetail, StopReason};
use foretrace_lab::closed_loop::{BenchArm, hands};
use foretrace_sim::arm::{JOINTS, Joints};
use foretrace_sim::data::{DataSet, Split, median_glyph_height};
use foretrace_sim::path::{Lift, PenPath};
use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;

/// Cycle of the arms \[s\], and the steps in which their servos are integrated.
const CYCLE_S: f64 = 0.002;
const STEPS: usize = 20;

/// A healthy arm: pure delay, then a servo of second order.
#[derive(Debug, Clone, Copy)]
struct Servo {
    delay_s: f64,
    /// Group delay at low frequency \[s\]; 0: none.
    group_s: f64,
    damping: f64,
}

impl Servo {
    const fn new(delay_s: f64, group_s: f64, damping: f64) -> Self {
        Self { delay_s, group_s, damping }
    }
}

/// What one joint makes of the answer that it ought to give.
#[derive(Debug, Clone, Copy)]
enum Odd {
    /// No faster than this \[rad/s\].
    Ceiling(f64),
    /// This share of the way from where it was.
    Gain(f64),
    /// In steps of this size \[rad\].
    Steps(f64),
    /// In steps that last this long \[s\].
    Holds(f64),
}

/// How states are reported.
#[derive(Debug, Clone, Copy, Default)]
struct Report {
    noise_rad: f64,
    /// Share of states that are lost: the last one stands.
    lost: f64,
    /// Quantum \[rad\].
    step_rad: f64,
}

/// The same joints with and without the fault.
struct OddArm {
    servo: Servo,
    odd: Vec<(usize, Odd)>,
    report: Report,
    begins_s: f64,
    t_s: f64,
    targets: VecDeque<[f64; JOINTS]>,
    healthy: Joints,
    begin: Option<[f64; JOINTS]>,
    really: Joints,
    reported: Joints,
    random: Pcg64,
    judge: Rc<RefCell<Judge>>,
}

/// How far the tool is from where it would be without the fault.
struct Judge {
    chain: Chain<JOINTS>,
    away: VecDeque<f64>,
    /// When it had been farther than the tolerance of the tool for 300 ms of a second \[s\].
    far: Option<f64>,
}

/// The tolerance that is shipped \[m\].
const TOOL_M: f64 = TrackingSettings::DEFAULT.tool_m;

impl Judge {
    fn see(&mut self, t_s: f64, healthy: &Joints, really: &Joints) {
        let place = |joints: &Joints| -> Vector3<f64> { self.chain.forward(&joints.q).position };
        let away = (place(healthy) - place(really)).norm();
        self.away.push_front(away);
        self.away.truncate(500);
        let long = self.away.iter().filter(|away| **away > TOOL_M).count() >= 150;
        if self.far.is_none() && long {
            self.far = Some(t_s);
        }
    }
}

impl OddArm {
    fn new(servo: Servo, odd: Vec<(usize, Odd)>, begins_s: f64, report: Report) -> Self {
        let still = Joints { q: home(), qd: [0.0; JOINTS] };
        let judge = Judge {
            chain: Config::preset("ur5e").unwrap().follower_settings().chain,
            away: VecDeque::new(),
            far: None,
        };
        Self {
            servo,
            odd,
            report,
            begins_s,
            t_s: 0.0,
            targets: VecDeque::from(vec![home(); (servo.delay_s / CYCLE_S).round() as usize + 1]),
            healthy: still,
            begin: None,
            really: still,
            reported: still,
            random: Pcg64::seed_from_u64(7),
            judge: Rc::new(RefCell::new(judge)),
        }
    }
}

impl DeskArm for OddArm {
    fn cycle_s(&self) -> f64 {
        CYCLE_S
    }

    fn cycle(&mut self, target: [f64; JOINTS]) {
        self.t_s += CYCLE_S;
        let from = *self.targets.back().unwrap();
        self.targets.push_front(target);
        self.targets.pop_back();
        let to = *self.targets.back().unwrap();
        let before = self.healthy.q;
        for axis in 0..JOINTS {
            let (q, qd) = (&mut self.healthy.q[axis], &mut self.healthy.qd[axis]);
            if self.servo.group_s <= 0.0 {
                (*q, *qd) = (to[axis], (to[axis] - from[axis]) / CYCLE_S);
                continue;
            }
            let w = 2.0 * self.servo.damping / self.servo.group_s;
            let h = CYCLE_S / STEPS as f64;
            for step in 0..STEPS {
                let u = from[axis] + (to[axis] - from[axis]) * (step as f64 + 0.5) / STEPS as f64;
                *qd += h * (w * w * (u - *q) - 2.0 * self.servo.damping * w * *qd);
                *q += h * *qd;
            }
        }
        let last = self.really.q;
        self.really = self.healthy;
        if self.t_s >= self.begins_s {
            let begin = *self.begin.get_or_insert(before);
            for (axis, odd) in &self.odd {
                let (axis, healthy) = (*axis, self.healthy.q[*axis]);
                self.really.q[axis] = match odd {
                    Odd::Ceiling(radps) => {
                        last[axis] + (healthy - last[axis]).clamp(-radps * CYCLE_S, radps * CYCLE_S)
                    }
                    Odd::Gain(gain) => begin[axis] + gain * (healthy - begin[axis]),
                    Odd::Steps(rad) => {
                        if (healthy - last[axis]).abs() > *rad {
                            healthy
                        } else {
                            last[axis]
                        }
                    }
                    Odd::Holds(seconds) => {
                        let cycles = (seconds / CYCLE_S).round();
                        let now = (self.t_s / CYCLE_S).round();
                        if now % cycles == 0.0 { healthy } else { last[axis] }
                    }
                };
                self.really.qd[axis] = (self.really.q[axis] - last[axis]) / CYCLE_S;
            }
        }
        self.judge.borrow_mut().see(self.t_s, &self.healthy, &self.really);
        if self.report.lost > 0.0 && self.random.random_range(0.0..1.0) < self.report.lost {
            return;
        }
        self.reported = self.really;
        for q in &mut self.reported.q {
            if self.report.noise_rad > 0.0 {
                *q += self.report.noise_rad * self.random.random_range(-1.0..=1.0);
            }
            if self.report.step_rad > 0.0 {
                *q = (*q / self.report.step_rad).round() * self.report.step_rad;
            }
        }
    }

    fn joints(&self) -> Joints {
        self.reported
    }

    fn really(&self) -> Joints {
        self.really
    }
}

/// A hand.
#[derive(Debug, Clone, Copy)]
enum Hand {
    Circle(Pen),
    Eight(Pen),
    Text(&'static str, u64),
}

const HANDS: [(&str, Hand); 8] = [
    ("circle 4 mm", Hand::Circle(Pen { radius_m: 0.004, speed_mps: 0.06 })),
    ("circle 20 mm", Hand::Circle(Pen { radius_m: 0.02, speed_mps: 0.2 })),
    ("circle 60 mm", Hand::Circle(Pen { radius_m: 0.06, speed_mps: 0.5 })),
    ("circle 50 mm slow", Hand::Circle(Pen { radius_m: 0.05, speed_mps: 0.05 })),
    ("eight 30 mm", Hand::Eight(Pen { radius_m: 0.03, speed_mps: 0.25 })),
    ("eight 60 mm", Hand::Eight(Pen { radius_m: 0.06, speed_mps: 0.5 })),
    ("text", Hand::Text("Kx4 Rg8 Sy2", 0)),
    ("text 2", Hand::Text("anticipate", 1)),
];

const ARMS: [(&str, Servo); 7] = [
    ("2 ms", Servo::new(0.0, 0.0, 1.0)),
    ("8 ms", Servo::new(0.0, 0.008, 1.0)),
    ("34 ms", Servo::new(0.002, 0.030, 1.0)),
    ("66 ms", Servo::new(0.032, 0.032, 1.0)),
    ("100 ms", Servo::new(0.066, 0.032, 1.0)),
    ("150 ms servo", Servo::new(0.0, 0.146, 1.0)),
    ("190 ms", Servo::new(0.156, 0.032, 1.0)),
];

/// Stop, time of the stop and what the judge saw.
struct Run {
    stop: Option<(StopReason, StopDetail)>,
    stopped_s: f64,
    judge: Rc<RefCell<Judge>>,
}

fn run(arm: OddArm, hand: Hand, seconds: f64) -> Run {
    let settings = Config::preset("ur5e").unwrap().follower_settings();
    let judge = Rc::clone(&arm.judge);
    let mut desk = Desk::around(Box::new(arm), settings);
    assert_eq!(desk.ask(Request::Arm), Ok(()));
    let stop = match hand {
        Hand::Circle(pen) => desk.write(pen, seconds),
        Hand::Eight(pen) => desk.write_eight(pen, seconds),
        Hand::Text(text, seed) => desk.write_text(text, seed),
    };
    // Desk begins one second before its pen does; its clock and the arm's begin together.
    let stopped_s = stop.map_or(f64::NAN, |(_, detail)| desk.since_begin(detail.at) + 1.0);
    Run { stop, stopped_s, judge }
}

/// Every how many-th case runs: `FORETRACE_ODD_JOINTS=1` runs all (half an hour), and
/// `FORETRACE_ODD_JOINTS_FROM` leaves out those before.
fn every(usual: usize) -> usize {
    number("FORETRACE_ODD_JOINTS", usual)
}

fn number(name: &str, usual: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// Faults of one and of two joints.
fn faults() -> Vec<Vec<(usize, Odd)>> {
    let mut faults = vec![];
    for joint in 0..5 {
        let ceilings = [0.02, 0.05, 0.1, 0.2].map(|share| Odd::Ceiling(share * 3.1));
        let gains = [0.3, 0.6, 0.9].map(Odd::Gain);
        let steps = [Odd::Steps(0.03), Odd::Holds(0.15)];
        faults.extend(ceilings.into_iter().chain(gains).chain(steps).map(|odd| vec![(joint, odd)]));
    }
    for (a, b) in [(0, 1), (1, 2), (0, 3), (2, 3)] {
        faults.extend([Odd::Ceiling(0.2), Odd::Gain(0.5)].map(|odd| vec![(a, odd), (b, odd)]));
    }
    faults
}

/// Latest stop after the fault has taken the tool farther than its tolerance for 300 ms \[s\].
const LATEST_S: f64 = 0.3;

/// Wherever the fault takes the tool farther than its tolerance from where it would be without it, for 300 ms
/// within a second, a stop is latched, and soon; never before the fault.
#[test]
fn one_or_two_joints_that_do_not_answer_as_the_others_are_stopped() {
    let (mut case, mut found, mut late, mut latest) = (0, 0, 0, (f64::NEG_INFINITY, String::new()));
    let first = number("FORETRACE_ODD_JOINTS_FROM", 1);
    for (lag, servo) in ARMS {
        for (name, hand) in HANDS {
            for begins_s in [0.0, 4.0] {
                for odd in faults() {
                    case += 1;
                    if case < first || case % every(149) != 0 {
                        continue;
                    }
                    let arm = OddArm::new(servo, odd.clone(), begins_s, Report::default());
                    let run = run(arm, hand, 8.0);
                    let what = format!("{lag}, {name}, {odd:?} from {begins_s} s on");
                    let stopped = run.stop.is_some();
                    found += usize::from(stopped);
                    assert!(!stopped || run.stopped_s >= begins_s, "{what}: {:?}", run.stop);
                    if let Some(at) = run.judge.borrow().far {
                        assert!(stopped, "{what}: not noticed, far from {at:.2} s on");
                        let after = run.stopped_s - at;
                        late += usize::from(after > 0.1);
                        if after > latest.0 {
                            latest = (after, what);
                        }
                    }
                }
            }
        }
    }
    println!(
        "{found} of {} stopped; after it was far off for 300 ms, {late} took more than 100 ms, the latest {:.0} \
         ms ({})",
        (case + 1 - first) / every(149),
        latest.0 * 1e3,
        latest.1
    );
    assert!(latest.0 < LATEST_S, "{}: {:.2} s late", latest.1, latest.0);
    assert!(found >= 10, "only {found} runs say anything");
}

/// Two joints at half of their gain are slower than asked, as behind a speed slider; when they have become
/// too slow for one, what was far off until then counts.
#[test]
fn a_fault_that_may_be_a_slider_at_first_is_stopped_in_time() {
    let odd = vec![(1, Odd::Gain(0.5)), (2, Odd::Gain(0.5))];
    let mut far_off = 0;
    for ((lag, servo), (name, hand)) in ARMS.into_iter().flat_map(|arm| HANDS.map(|hand| (arm, hand))) {
        let run = run(OddArm::new(servo, odd.clone(), 4.0, Report::default()), hand, 8.0);
        let Some(far) = run.judge.borrow().far else { continue };
        far_off += 1;
        let after = run.stopped_s - far;
        println!("{lag}, {name}: stopped {:.0} ms after it was far off for 300 ms", after * 1e3);
        assert!(after < LATEST_S, "{lag}, {name}: {after:.2} s late: {:?}", run.stop);
    }
    assert!(far_off > 0, "no run says anything");
}

/// Arms whose joints answer alike, whatever their lag, their damping and how they report.
#[test]
fn arms_whose_joints_answer_alike_are_never_stopped() {
    let reports = [
        Report::default(),
        Report { noise_rad: 1e-3, ..Report::default() },
        Report { lost: 0.3, ..Report::default() },
        Report { step_rad: 5e-4, ..Report::default() },
    ];
    let mut arms: Vec<Servo> = ARMS.iter().map(|(_, servo)| *servo).collect();
    for damping in [0.45, 0.5, 0.52, 0.6, 0.7] {
        for group_s in [0.008, 0.015, 0.03, 0.04, 0.06] {
            arms.push(Servo::new(0.002, group_s, damping));
        }
    }
    let mut case = 0;
    for servo in arms {
        for (name, hand) in HANDS {
            for report in reports {
                case += 1;
                if case % every(23) != 0 {
                    continue;
                }
                let run = run(OddArm::new(servo, vec![], 0.0, report), hand, 8.0);
                assert!(run.stop.is_none(), "{servo:?}, {name}, {report:?}: {:?}", run.stop);
            }
        }
    }
}

/// Recorded hands behind servos that swing over: no stop. `FORETRACE_ODD_JOINTS_S=120` for two minutes each.
#[test]
fn recorded_hands_behind_servos_with_overshoot_are_never_stopped() {
    let Some(shared) = crate::shared::shared() else { return };
    let seconds: f64 =
        std::env::var("FORETRACE_ODD_JOINTS_S").ok().and_then(|text| text.parse().ok()).unwrap_or(6.0);
    for (set, split) in [
        ("unipen-tos", Split::train()),
        ("unipen-ced", Split::train()),
        ("pendigits-orig", Split::train()),
        ("character-trajectories", Split::train()),
    ] {
        let set = DataSet::load(&shared.join("data").join(set), &split, false).unwrap();
        for (damping, group_s) in [(0.5, 0.008), (0.5, 0.03), (0.5, 0.04), (0.7, 0.03)] {
            let arm = OddArm::new(Servo::new(0.002, group_s, damping), vec![], 0.0, Report::default());
            let mut desk = Desk::around(Box::new(arm), Config::preset("ur5e").unwrap().follower_settings());
            assert_eq!(desk.ask(Request::Arm), Ok(()));
            let paths = recorded(&set, seconds);
            assert!(paths.len() > 1, "{}: nothing to write", set.name);
            let mut begin_s = 0.0;
            for path in &paths {
                begin_s = desk.write_path(&path.samples, begin_s).unwrap_or_else(|(reason, detail)| {
                    panic!("{}, damping {damping}, {group_s} s: {reason:?} {detail:?}", set.name)
                });
            }
        }
    }
}

/// About `seconds` of what was written in `set`, character by character.
fn recorded(set: &DataSet, seconds: f64) -> Vec<PenPath> {
    let config = Config::preset("ur5e").unwrap();
    let height = median_glyph_height(set.characters()).unwrap();
    let (hands, _) = hands(set, height, BenchArm::Ur5, &config, Lift::Travel).unwrap();
    let mut left_s = seconds;
    let paths = hands.into_iter().flat_map(|hand| hand.sequences).map(|sequence| sequence.path);
    let long = |path: &PenPath| path.samples.last().map_or(0.0, |last| last.t_s - path.samples[0].t_s);
    paths
        .take_while(|path| {
            let goes_on = left_s > 0.0;
            left_s -= long(path);
            goes_on
        })
        .collect()
}
