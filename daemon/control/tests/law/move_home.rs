//! The way home through the whole step: refused where it is not clear, slow and straight where it is, and
//! ended by a smooth stop from anywhere on it. `support::Bench` checks every command's legality and
//! continuity.

use crate::support::{Bench, HOME, PERIOD_NS, settings};
use foretrace_control::arm::JointLimits;
use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle};
use foretrace_control::follower::{
    Budget, EnableReading, FollowerSettings, Health, HomeProgress, Mode, Refusal, Request, StepInput,
    StepOutput, WayBlocked,
};
use foretrace_control::predict::PredictorKind;
use foretrace_control::stop::{StopCause, StopDetail, StopReason};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const MARGIN_M: f64 = 0.01;
const VELOCITY: f64 = 0.25;
const ACCELERATION: f64 = 0.5;
const JERK: f64 = 2.0;

/// A UR5 that keeps clear of itself and of a table 10 cm below its base.
fn careful() -> FollowerSettings<6> {
    let table = Obstacle::plane([0.0, 0.0, -0.1], [0.0, 0.0, 1.0]).unwrap();
    let mut settings = settings(PredictorKind::HOLD);
    settings.clearance = Some(ClearanceSettings { margin_m: MARGIN_M, itself: true, obstacles: vec![table] });
    settings
}

fn judge(settings: &FollowerSettings<6>) -> Clearance<6> {
    let keep = settings.clearance.as_ref().unwrap();
    Clearance::new(&settings.chain, &settings.limits, PERIOD_NS as f64 * 1e-9, keep).unwrap()
}

/// The arm stands at `q`, and the way home is requested.
fn asked(settings: FollowerSettings<6>, q: [f64; 6]) -> (Bench, StepOutput<6>) {
    let mut bench = Bench::new(settings);
    bench.joints.q = q;
    let output = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
    (bench, output)
}

/// Continues until the way has been checked.
fn looked_along(bench: &mut Bench, first: StepOutput<6>) -> Result<(), Refusal> {
    assert_eq!((first.answer, first.begins), (Some(Ok(())), true));
    assert_eq!(first.mode, if matches!(first.way, Some(Err(_))) { Mode::Idle } else { Mode::Homing });
    let start = first.command.unwrap().q;
    if let Some(way) = first.way {
        return way;
    }
    // At most a thousand checks, four in a tick of 2 ms.
    for _ in 0..260 {
        let output = bench.tick(&[]);
        assert_eq!(output.command.unwrap().q, start, "it moves before the way is known");
        if let Some(way) = output.way {
            return way;
        }
    }
    panic!("the way is never known");
}

/// The smallest distance on the straight way from `q`, by dense sampling.
fn smallest(settings: &FollowerSettings<6>, q: &[f64; 6]) -> f64 {
    let judge = judge(settings);
    let at = |k: u32| {
        let share = f64::from(k) / 3000.0;
        let q = std::array::from_fn(|j| q[j] + share * (HOME[j] - q[j]));
        judge.nearest(&settings.chain.forward(&q)).unwrap().distance_m
    };
    (0..=3000).map(at).fold(f64::INFINITY, f64::min)
}

fn farthest(q: &[f64; 6], from: &[f64; 6]) -> f64 {
    q.iter().zip(from).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

/// Follows the whole way; every command on the straight line, within the limits. Returns how long it took
/// \[s\], and whether obstacles slowed it.
fn followed_home(bench: &mut Bench, start: &[f64; 6]) -> (f64, bool) {
    let h = PERIOD_NS as f64 * 1e-9;
    let (_, joint) =
        (0..6).map(|j| ((HOME[j] - start[j]).abs(), j)).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
    let (mut qd, mut qdd) = ([0.0; 6], [0.0; 6]);
    let (mut held_back, mut last) = (false, HomeProgress::default());
    for tick in 0..40_000u32 {
        let output = bench.tick(&[]);
        let command = output.command.expect("in charge until it is there");
        let share = (command.q[joint] - start[joint]) / (HOME[joint] - start[joint]);
        let off = (0..6).map(|j| (command.q[j] - start[j] - share * (HOME[j] - start[j])).abs());
        assert!(off.fold(0.0, f64::max) < 1e-9, "off the straight way");
        held_back |= output.health.has(Health::CLEARANCE);
        for j in 0..6 {
            let accelerates = (command.qd[j] - qd[j]) / h;
            assert!(command.qd[j].abs() <= VELOCITY * (1.0 + 1e-9), "{}", command.qd[j]);
            if !held_back {
                assert!(accelerates.abs() <= ACCELERATION * (1.0 + 1e-6), "{accelerates}");
                assert!((accelerates - qdd[j]).abs() <= JERK * h * 1.01, "{accelerates} after {}", qdd[j]);
            } else {
                // In front of obstacles it slows down as fast as gaps are damped.
                assert!(accelerates.abs() <= 2.0 * ACCELERATION, "{accelerates}");
            }
            qdd[j] = accelerates;
        }
        qd = command.qd;
        if output.mode == Mode::Idle {
            assert!(farthest(&command.q, &HOME) < 1e-9 && qd == [0.0; 6], "{command:?}");
            assert_eq!(output.home, None);
            assert!(bench.tick(&[]).command.is_none());
            return (f64::from(tick) * h, held_back);
        }
        let progress = output.home.expect("told while it moves");
        assert!(progress.share >= last.share && progress.left_s <= last.left_s.max(60.0));
        last = progress;
    }
    panic!("it never arrives: {last:?}");
}

#[test]
fn from_anywhere_it_goes_home_gently_or_says_what_is_in_the_way() {
    let mut rng = Pcg64::seed_from_u64(27);
    let (mut clear, mut blocked) = (0, 0);
    for _ in 0..32 {
        let settings = careful();
        let start: [f64; 6] = std::array::from_fn(|j| HOME[j] + rng.random_range(-1.6..1.6));
        let (mut bench, first) = asked(settings.clone(), start);
        let smallest = smallest(&settings, &start);
        match looked_along(&mut bench, first) {
            Ok(()) => {
                clear += 1;
                // Two starts in three are clear; a start inside the margin is left, never deepened.
                let at_start = judge(&settings).nearest(&settings.chain.forward(&start)).unwrap().distance_m;
                assert!(smallest >= MARGIN_M.min(at_start) - 1e-5, "{smallest} of {at_start}");
                let (took, _) = followed_home(&mut bench, &start);
                assert!(took >= farthest(&start, &HOME) / VELOCITY);
                assert_eq!(
                    bench.tick_with(&[], Some(Request::Arm), Budget::default()).answer,
                    Some(Ok(())),
                    "home is where it can be armed"
                );
            }
            // Judged in `move_home_paper.rs`.
            Err(Refusal::WayBlocked(by)) if by.pair == WayBlocked::PAPER => {}
            Err(Refusal::WayBlocked(WayBlocked { pair, percent, distance_um })) => {
                blocked += 1;
                assert!(smallest < MARGIN_M + 1.5e-3, "refused though {smallest} is the nearest");
                let names = judge(&settings).pair_names();
                assert!(names[usize::from(pair)].contains('`') && percent <= 100);
                assert!(f64::from(distance_um) * 1e-6 < MARGIN_M + 1e-3);
                let output = bench.tick(&[]);
                assert_eq!((output.mode, output.command), (Mode::Idle, None));
            }
            other => panic!("{other:?}"),
        }
    }
    println!("{clear} ways clear, {blocked} blocked");
    assert!(clear >= 5 && blocked >= 3, "{clear} {blocked}");
}

#[test]
fn a_way_through_a_box_is_refused_with_its_name_and_place() {
    let mut settings = careful();
    let turned = |by: f64| [HOME[0] + by, HOME[1], HOME[2], HOME[3], HOME[4], HOME[5]];
    // Where the tool comes by when the base turns, a third of the way before home.
    let by_the_way = settings.chain.forward(&turned(0.5)).position;
    let pillar = Obstacle::cuboid(by_the_way.into(), [0.06, 0.06, 0.3], [0.0; 3]).unwrap();
    settings.clearance.as_mut().unwrap().obstacles.push(pillar);
    let (mut bench, first) = asked(settings.clone(), turned(1.5));
    let Err(Refusal::WayBlocked(by)) = looked_along(&mut bench, first) else { panic!("it is not clear") };
    let name = &judge(&settings).pair_names()[usize::from(by.pair)];
    assert!(name.ends_with("and box 0 of clearance.boxes_m"), "{name} {by:?}");
    assert!((30..70).contains(&by.percent), "{by:?}");
    // From the other side nothing is in the way.
    let (mut bench, first) = asked(settings, turned(-1.5));
    looked_along(&mut bench, first).unwrap();
    followed_home(&mut bench, &turned(-1.5));
}

#[test]
fn a_way_through_itself_is_refused_with_both_links() {
    let mut settings = careful();
    settings.clearance.as_mut().unwrap().obstacles.clear();
    // The elbow turned beyond the upper arm: to get home the wrist would pass through it.
    let start = [0.0, -0.2, -4.5, -3.6, HOME[4], HOME[5]];
    let (mut bench, first) = asked(settings.clone(), start);
    let Err(Refusal::WayBlocked(by)) = looked_along(&mut bench, first) else { panic!("it is not clear") };
    let name = &judge(&settings).pair_names()[usize::from(by.pair)];
    assert_eq!(name, "`upper_arm` and `wrist_1`", "{by:?}");
}

/// A wall that the arm, turned about its base, is nearest to one radian before home: it stands \[m\] from it
/// there.
fn passing_a_wall(settings: &mut FollowerSettings<6>, distance_m: f64) -> f64 {
    let turned = |q0: f64| [q0, HOME[1], HOME[2], HOME[3], HOME[4], HOME[5]];
    let wall = |angle: f64, far: f64| {
        let out = [angle.cos(), angle.sin(), 0.0];
        Obstacle::plane(out.map(|x| far * x), out.map(|x| -x)).unwrap()
    };
    let away = |settings: &mut FollowerSettings<6>, obstacle: Obstacle, q0: f64| {
        let keep = settings.clearance.as_mut().unwrap();
        (keep.obstacles, keep.itself) = (vec![obstacle], false);
        judge(settings).nearest(&settings.chain.forward(&turned(q0))).unwrap().distance_m
    };
    let (mut low, mut high) = (-0.6, 0.6);
    for _ in 0..80 {
        let [a, b] = [low + (high - low) / 3.0, high - (high - low) / 3.0];
        if away(settings, wall(0.0, 2.0), a) < away(settings, wall(0.0, 2.0), b) { high = b } else { low = a }
    }
    // A wall turned with the base is passed as near, one radian before home.
    let (nearest, angle) = (HOME[0] - 1.0, HOME[0] - 1.0 - low);
    let far = 2.0 - away(settings, wall(angle, 2.0), nearest) + distance_m;
    assert!((away(settings, wall(angle, far), nearest) - distance_m).abs() < 1e-9);
    nearest
}

#[test]
fn near_things_it_keeps_its_way_and_slows_down() {
    let mut settings = careful();
    let nearest = passing_a_wall(&mut settings, MARGIN_M + 0.0012);
    let start = [nearest - 1.0, HOME[1], HOME[2], HOME[3], HOME[4], HOME[5]];
    let seconds = settings.way_home(&start).unwrap().2;
    let (mut bench, first) = asked(settings, start);
    looked_along(&mut bench, first).unwrap();
    let (took, slowed) = followed_home(&mut bench, &start);
    // At home it is held for the longest lag, 0.2 s.
    assert!(slowed && took > seconds + 0.3, "as fast as with nothing near: {took} s, {seconds} s");
}

#[test]
fn what_holds_the_arm_up_stops_it_with_what_was_seen() {
    let mut settings = careful();
    // Inside the margin, and nearer still by less than the check of the way tolerates.
    let nearest = passing_a_wall(&mut settings, MARGIN_M - 0.001);
    let start = [nearest - 4e-4, HOME[1], HOME[2], HOME[3], HOME[4], HOME[5]];
    let (mut bench, first) = asked(settings, start);
    looked_along(&mut bench, first).unwrap();
    let last = (0..1500).map(|_| bench.tick(&[])).last().unwrap();
    assert_eq!((last.mode, last.stop_reason), (Mode::Stopped, StopReason::WayBlocked));
    let StopDetail { cause, amount, limit, .. } = last.stop_detail;
    assert_eq!((cause, limit), (StopCause::Clearance, MARGIN_M));
    assert!((amount - (MARGIN_M - 0.001)).abs() < 1e-5, "{amount}");
    assert!(farthest(&bench.joints.q, &start) < 1e-5);
}

/// Half a second on the way from `HOME` turned by half a radian at every joint.
fn underway() -> Bench {
    let start = HOME.map(|q| q + 0.5);
    let (mut bench, first) = asked(settings(PredictorKind::HOLD), start);
    looked_along(&mut bench, first).unwrap();
    for _ in 0..500 {
        bench.tick(&[]);
    }
    let moves = bench.last.unwrap();
    assert!(moves.qd.iter().all(|qd| qd.abs() > 0.1), "{moves:?}");
    bench
}

/// Comes to rest within a second and stays, with the given reason.
fn stops(bench: &mut Bench, mut tick: impl FnMut(&mut Bench) -> StepOutput<6>, reason: StopReason) {
    let last = (0..500).map(|_| tick(bench)).last().unwrap();
    assert_eq!((last.mode, last.stop_reason), (Mode::Stopped, reason));
    assert_eq!(last.command.unwrap().qd, [0.0; 6]);
    assert!(farthest(&bench.last.unwrap().q, &HOME) > 0.1);
}

#[test]
fn whatever_ends_the_way_ends_it_with_a_smooth_stop() {
    let mut bench = underway();
    bench.tick_with(&[], Some(Request::Stop), Budget::default());
    stops(&mut bench, |bench| bench.tick(&[]), StopReason::Requested);
    // From there it continues at the next request.
    let again = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
    looked_along(&mut bench, again).unwrap();

    let mut bench = underway();
    let halt = Some((StopReason::Overruns, StopDetail::default()));
    let input = StepInput { halt, ..StepInput::nothing(bench.now) };
    bench.step(&input, Budget::default());
    stops(&mut bench, |bench| bench.tick(&[]), StopReason::Overruns);

    let mut bench = underway();
    let silent = |bench: &mut Bench| bench.step(&StepInput::nothing(bench.now), Budget::default());
    stops(&mut bench, silent, StopReason::JointStateLost);

    // The arm stands while its commands go on.
    let mut bench = underway();
    let stuck = bench.joints.q;
    let held = move |bench: &mut Bench| {
        (bench.joints.q, bench.joints.qd) = (stuck, [0.0; 6]);
        bench.tick(&[])
    };
    stops(&mut bench, held, StopReason::TrackingError);

    let mut bench = underway();
    bench.tick_with(&[], Some(Request::Disarm), Budget::default());
    for _ in 0..500 {
        bench.tick(&[]);
    }
    assert!(bench.last.is_none());
}

#[test]
fn on_its_way_the_arm_is_neither_armed_nor_led_by_a_pen() {
    let mut bench = underway();
    let pen = bench.pen([0.0; 2]);
    let output = bench.tick_with(&[pen], Some(Request::Arm), Budget::default());
    assert_eq!((output.answer, output.mode), (Some(Err(Refusal::MovesHome)), Mode::Homing));
    let output = bench.tick_with(&[pen], Some(Request::MoveHome), Budget::default());
    assert_eq!((output.answer, output.mode), (Some(Err(Refusal::MovesHome)), Mode::Homing));
    let mut bench = Bench::armed(settings(PredictorKind::HOLD));
    let output = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
    assert_eq!((output.answer, output.mode), (Some(Err(Refusal::DisarmFirst)), Mode::Armed));
}

#[test]
fn what_arming_asks_of_the_arm_the_way_home_asks_too() {
    let refused = |change: &dyn Fn(&mut Bench, &mut FollowerSettings<6>)| {
        let mut settings = settings(PredictorKind::HOLD);
        let mut bench = Bench::new(settings.clone());
        change(&mut bench, &mut settings);
        let joints = bench.joints;
        bench = Bench::new(settings);
        (bench.joints.q, bench.joints.qd, bench.joints.motion_allowed) =
            (joints.q, joints.qd, joints.motion_allowed);
        let output = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
        assert_eq!((output.mode, output.command), (Mode::Idle, None));
        output.answer.unwrap().unwrap_err()
    };
    assert_eq!(refused(&|bench, _| bench.joints.qd[3] = 0.2), Refusal::ArmMoves);
    assert_eq!(refused(&|bench, _| bench.joints.motion_allowed = false), Refusal::MotionNotAllowed);
    assert_eq!(refused(&|bench, _| bench.joints.q[1] = 6.5), Refusal::OutsideJointLimits);
    assert_eq!(refused(&|_, settings| settings.safety.enable_required = true), Refusal::EnableMissing);
    let mut bench = Bench::new(settings(PredictorKind::HOLD));
    let input = StepInput { request: Some(Request::MoveHome), ..StepInput::nothing(bench.now) };
    assert_eq!(bench.step(&input, Budget::default()).answer, Some(Err(Refusal::NoJointState)));
}

#[test]
fn a_dead_man_that_is_let_go_stops_the_way_home() {
    let mut settings = settings(PredictorKind::HOLD);
    settings.safety.enable_required = true;
    let mut bench = Bench::new(settings);
    bench.joints.q = HOME.map(|q| q + 0.5);
    let tick = |bench: &mut Bench, request, stop| {
        bench.joints.stamp = bench.now;
        let joints = bench.joints;
        let enable = Some(EnableReading { stamp: bench.now, stop });
        let input = StepInput { joints: Some(&joints), enable, request, ..StepInput::nothing(bench.now) };
        bench.step(&input, Budget::default())
    };
    assert_eq!(tick(&mut bench, Some(Request::MoveHome), false).answer, Some(Ok(())));
    for _ in 0..500 {
        tick(&mut bench, None, false);
    }
    assert!(bench.last.unwrap().qd[0].abs() > 0.1);
    let last = (0..500).map(|_| tick(&mut bench, None, true)).last().unwrap();
    assert_eq!((last.mode, last.stop_reason), (Mode::Stopped, StopReason::EnableLost));
}

#[test]
fn lost_time_on_the_way_ends_at_home_all_the_same() {
    let start = HOME.map(|q| q + 0.3);
    for lost_periods in [1, 3, 30] {
        let (mut bench, first) = asked(settings(PredictorKind::HOLD), start);
        looked_along(&mut bench, first).unwrap();
        let mut arrived = false;
        for tick in 0..20_000 {
            if tick % 400 == 399 {
                bench.now = bench.now + lost_periods * PERIOD_NS;
            }
            // The arm is where the last command left it; the checker knows the consumer's rule.
            if bench.tick(&[]).mode == Mode::Idle {
                arrived = true;
                break;
            }
        }
        assert!(arrived && farthest(&bench.joints.q, &HOME) < 1e-9, "{lost_periods}");
    }
}

#[test]
fn limits_of_weak_joints_bound_the_way_too() {
    let mut settings = settings(PredictorKind::HOLD);
    // So that no pen is followed, which such joints could not do.
    settings.mpc.unlimited = true;
    let tau = std::f64::consts::TAU;
    settings.limits = JointLimits::new([[-tau, tau]; 6], [0.4; 6], [1.0; 6])
        .unwrap()
        .with_jerk([40.0; 6])
        .unwrap()
        .with_stale_braking(0.01, [0.9; 6])
        .unwrap();
    let start = [HOME[0] - 0.2, HOME[1], HOME[2], HOME[3], HOME[4], HOME[5]];
    let Some((_, turn, seconds)) = settings.way_home(&start) else { panic!("finite") };
    // A quarter of 0.4 rad/s and of 0.9 rad/s²: 0.2 rad at 0.1 rad/s, 0.1/0.225 s to get there, 0.225/2 s to
    // ease.
    assert!((turn - 0.2).abs() < 1e-12 && (seconds - (2.0 + 0.1 / 0.225 + 0.225 / 2.0)).abs() < 1e-9);
    let (mut bench, first) = asked(settings, start);
    looked_along(&mut bench, first).unwrap();
    let (took, _) = followed_home(&mut bench, &start);
    // Then it is held for as long as the arm may be late.
    assert!((took - seconds - 0.2).abs() < 0.02, "{took} {seconds}");
}
