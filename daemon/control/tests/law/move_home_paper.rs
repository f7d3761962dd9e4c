//! The way home does not lead through the paper, whether or not the settings keep clear of a table.

use crate::support::{Bench, HOME, settings};
use foretrace_control::follower::{Budget, FollowerSettings, Refusal, Request, WayBlocked};
use foretrace_control::predict::PredictorKind;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Keeps clear of nothing; the paper ends the workspace below.
fn flat() -> FollowerSettings<6> {
    let mut settings = settings(PredictorKind::HOLD);
    settings.clearance = None;
    settings.mpc.axes[2].position_m = [-0.0005, 0.1];
    settings
}

/// The lowest of the workspace \[m\].
fn floor(settings: &FollowerSettings<6>) -> f64 {
    settings.mpc.limits()[2].position_m[0]
}

/// Height of the tip over the paper on the way from `q`, where it is over the workspace: at the start, and
/// the lowest \[m\].
fn heights(settings: &FollowerSettings<6>, q: &[f64; 6]) -> (f64, f64) {
    let at = |share: f64| {
        let q = std::array::from_fn(|j| q[j] + share * (HOME[j] - q[j]));
        settings.plane.point_from_base(&settings.chain.forward(&q).position)
    };
    let workspace = settings.mpc.limits().map(|axis| axis.position_m);
    let over = |p: &nalgebra::Vector3<f64>| {
        (0..2).all(|axis| (workspace[axis][0]..=workspace[axis][1]).contains(&p[axis]))
    };
    let lowest = (0..=7000).map(|k| at(f64::from(k) / 7000.0)).filter(over).map(|p| p.z);
    (at(0.0).z, lowest.fold(f64::INFINITY, f64::min))
}

fn way(settings: &FollowerSettings<6>, q: [f64; 6]) -> Result<(), Refusal> {
    let mut bench = Bench::new(settings.clone());
    bench.joints.q = q;
    let mut output = bench.tick_with(&[], Some(Request::MoveHome), Budget::default());
    assert_eq!(output.answer, Some(Ok(())), "{q:?}");
    for _ in 0..300 {
        if let Some(way) = output.way {
            return way;
        }
        output = bench.tick(&[]);
    }
    panic!("the way is never known");
}

#[test]
fn a_way_through_the_paper_is_refused_and_one_over_it_is_not() {
    let settings = flat();
    let mut random = Pcg64::seed_from_u64(5);
    let [mut through, mut over] = [0; 2];
    for _ in 0..2000 {
        let q: [f64; 6] = std::array::from_fn(|j| HOME[j] + random.random_range(-1.4..1.4));
        let (start, lowest) = heights(&settings, &q);
        // Too near the bound for another sampling to decide.
        let floor = floor(&settings);
        if (lowest - floor).abs() < 0.0003 || start < floor {
            continue;
        }
        match way(&settings, q) {
            Ok(()) => {
                assert!(lowest > floor, "{q:?}: {lowest} m over the paper");
                over += 1;
            }
            Err(Refusal::WayBlocked(by)) => {
                assert!(by.pair == WayBlocked::PAPER && lowest < floor, "{by:?} {lowest}");
                assert!(by.distance_um < 0 && by.percent > 0, "{by:?}");
                through += 1;
            }
            Err(other) => panic!("{other:?}"),
        }
        if through >= 6 && over >= 6 {
            return;
        }
    }
    panic!("{through} ways through the paper, {over} over it");
}

/// A tool stopped in the paper may come out of it, but not from under the table.
#[test]
fn an_arm_that_stands_in_the_paper_may_leave_it() {
    let settings = flat();
    let lowered = |by: f64| {
        let target = settings.plane.point_to_base(&[0.02, 0.01, floor(&settings) - by].into());
        let target = foretrace_control::ik::ToolTarget::at_rest(target, settings.plane.tool_axis(), None);
        foretrace_control::ik::solve_pose(&settings.chain, &HOME, &target).unwrap()
    };
    assert_eq!(way(&settings, lowered(0.006)), Ok(()));
    assert!(
        matches!(way(&settings, lowered(0.05)), Err(Refusal::WayBlocked(by)) if by.pair == WayBlocked::PAPER)
    );
}
