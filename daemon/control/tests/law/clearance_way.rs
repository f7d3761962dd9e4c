//! Checking a path: the smallest distance allowed at its beginning, on the way and at its end.

use crate::support::reaching::*;
use foretrace_control::arm::Chain;
use foretrace_control::clearance::way::MORE_M;
use foretrace_control::clearance::{Clearance, ClearanceSettings, Obstacle, Way, WayCheck};
use std::sync::LazyLock;

static ARM: LazyLock<Chain<6>> = LazyLock::new(|| chain(UR5));

const MARGIN_M: f64 = 0.01;
/// Nearer than the margin by less is rounding.
const ROUNDING_M: f64 = 1e-6;

/// `UR5_HOME` with its base turned.
fn turned(by: f64) -> [f64; 6] {
    let [_, b, c, d, e, f] = UR5_HOME;
    [by, b, c, d, e, f]
}

fn away(kept: &Clearance<6>, by: f64) -> f64 {
    kept.nearest(&ARM.forward(&turned(by))).unwrap().distance_m
}

fn wall(far: f64) -> Clearance<6> {
    let obstacles = vec![Obstacle::plane([-far, 0.0, 0.0], [1.0, 0.0, 0.0]).unwrap()];
    let settings = ClearanceSettings { margin_m: MARGIN_M, itself: false, obstacles };
    Clearance::new(&ARM, &limits(&ARM, 40.0), TICK_S, &settings).unwrap()
}

/// A wall that the arm turned by `by` is `distance_m` from.
fn wall_from(by: f64, distance_m: f64) -> Clearance<6> {
    let kept = wall(2.0 - away(&wall(2.0), by) + distance_m);
    assert!((away(&kept, by) - distance_m).abs() < 1e-12);
    kept
}

/// Where the arm turned about its base is nearest to such a wall; it approaches over the half radian before.
fn facing() -> f64 {
    let (far, all) = (wall(2.0), (-314..314).map(|k| f64::from(k) * 0.01));
    let nearest = all.min_by(|a, b| away(&far, *a).total_cmp(&away(&far, *b))).unwrap();
    let fine = (-100..100).map(|k| nearest + f64::from(k) * 1e-4);
    let nearest = fine.min_by(|a, b| away(&far, *a).total_cmp(&away(&far, *b))).unwrap();
    assert!((0..50).map(|k| nearest - 0.5 + f64::from(k) * 0.01).is_sorted_by_key(|by| -away(&far, by)));
    nearest
}

fn looked(kept: &Clearance<6>, from: f64, to: f64) -> WayCheck {
    let mut way = Way::new(Some(kept));
    way.begin(turned(from), turned(to));
    // At most a thousand checks, and one at the end.
    let found = (0..1002).map(|_| kept.look_along(&ARM, &mut way)).find(|found| *found != WayCheck::SoFar);
    found.expect("it was looked along to the end")
}

#[test]
fn an_end_that_keeps_the_margin_is_as_good_as_any() {
    let facing = facing();
    let (from, to) = (facing - 0.5, facing - 0.1);
    for (more, fine) in [(0.0, true), (-0.5, true), (-2.0, false), (500.0, true), (2000.0, true)] {
        let kept = wall_from(to, MARGIN_M + more * ROUNDING_M);
        assert_eq!(looked(&kept, from, to) == WayCheck::Clear, fine, "{more} µm");
        // A path that begins there is allowed.
        assert_eq!(looked(&kept, to, from), WayCheck::Clear, "{more} µm");
    }
    let WayCheck::Blocked(by) = looked(&wall_from(to, 0.5 * MARGIN_M), from, to) else {
        panic!("it ends in the margin")
    };
    assert!(by.distance_m < MARGIN_M && by.distance_m >= 0.5 * MARGIN_M && by.share > 0.8, "{by:?}");
}

#[test]
fn on_the_way_a_millimetre_more_than_the_margin_is_kept() {
    let nearest = facing();
    for (more, fine) in [(1.05, true), (0.9, false), (0.1, false), (-0.5, false)] {
        let kept = wall_from(nearest, MARGIN_M + more * MORE_M);
        match looked(&kept, nearest - 0.6, nearest + 0.6) {
            WayCheck::Blocked(by) => {
                assert!(!fine && (by.share - 0.5).abs() < 0.1, "{more} mm: {by:?}");
                assert!((by.distance_m - MARGIN_M).abs() < MORE_M, "{by:?}");
            }
            found => assert!(fine && found == WayCheck::Clear, "{more} mm"),
        }
    }
}

#[test]
fn who_begins_in_the_margin_may_leave_it_and_not_come_nearer() {
    let facing = facing();
    let kept = wall_from(facing - 0.2, 0.4 * MARGIN_M);
    assert_eq!(looked(&kept, facing - 0.2, facing - 0.5), WayCheck::Clear);
    for to in [facing - 0.199, facing - 0.15] {
        assert!(matches!(looked(&kept, facing - 0.2, to), WayCheck::Blocked(_)), "{to}");
    }
}
