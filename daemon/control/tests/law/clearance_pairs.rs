//! Which capsules of the arm are checked against each other, against postures tried one by one.

use crate::support::reaching;

use reaching::*;

use foretrace_control::arm::{Capsule, Chain, Kinematics};
use foretrace_control::clearance::{Clearance, ClearanceSettings};
use foretrace_control::geometry::{Segment, segment_segment};
use nalgebra::Vector3;

fn clearance(chain: &Chain<6>) -> Clearance<6> {
    let itself = ClearanceSettings { margin_m: 0.01, itself: true, obstacles: Vec::new() };
    Clearance::new(chain, &limits(chain, 40.0), TICK_S, &itself).unwrap()
}

fn placed(at: &Kinematics<6>, capsule: &Capsule) -> Segment {
    let Some(joint) = capsule.link.checked_sub(1) else { return capsule.segment };
    let put = |point: Vector3<f64>| at.frames[joint] * point + at.origins.column(joint);
    Segment { from: put(capsule.segment.from), to: put(capsule.segment.to) }
}

fn apart(at: &Kinematics<6>, first: &Capsule, second: &Capsule) -> f64 {
    let distance = segment_segment(&placed(at, first), &placed(at, second)).distance;
    distance - first.radius - second.radius
}

/// Distances of two capsules over the turns of the two joints between them.
fn over_all_turns(chain: &Chain<6>, first: &Capsule, second: &Capsule) -> Vec<f64> {
    let turns =
        || (0..90).map(|k| (f64::from(k) + 0.3) * std::f64::consts::TAU / 90.0 - std::f64::consts::PI);
    let mut all = Vec::new();
    for inner in turns() {
        for outer in turns() {
            let mut q = [0.0; 6];
            (q[first.link], q[first.link + 1]) = (inner, outer);
            all.push(apart(&chain.forward(&q), first, second));
        }
    }
    all
}

#[test]
fn a_pair_that_is_left_out_never_meets_or_is_a_neighbour() {
    for text in [UR5, UR5E] {
        let chain = chain(text);
        let kept = clearance(&chain);
        let at_home = chain.forward(&UR5_HOME);
        let checked: Vec<[&Capsule; 2]> = kept.distances_within(&at_home).map(|(pair, _)| pair).collect();
        let (mut out, mut beside) = (0, 0);
        for first in chain.capsules() {
            for second in chain.capsules().iter().filter(|second| second.link > first.link + 1) {
                if checked.contains(&[first, second]) {
                    continue;
                }
                assert_eq!(second.link, first.link + 2, "{} and {}", first.name, second.name);
                let distances = over_all_turns(&chain, first, second);
                let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
                let farthest = distances.iter().copied().fold(f64::NEG_INFINITY, f64::max);
                let reach = second.segment.from.xy().norm().max(second.segment.to.xy().norm());
                let in_place = reach < 0.3 * second.radius && farthest < 2.1 * second.radius;
                assert!(nearest > 0.0 || in_place, "{} and {}: {nearest}", first.name, second.name);
                out += 1;
                beside += usize::from(nearest <= 0.0);
            }
        }
        assert!(out > 10 && beside < out / 2, "{out} {beside}");
    }
}

/// Two balls of 5 mm, one on the shoulder and one on the forearm, that meet at one posture of the two joints
/// between them and are apart a few degrees beside it.
#[test]
fn a_pair_that_meets_in_one_place_only_is_found() {
    let links = ["base_link", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"];
    let text = links.iter().fold(UR5.to_owned(), |text, link| {
        let (before, rest) = text.split_once(&format!("<link name=\"{link}\">")).unwrap();
        let (_, after) = rest.split_once("</link>").unwrap();
        let shape = match *link {
            "shoulder" => "SHOULDER",
            "forearm" => "FOREARM",
            _ => "",
        };
        format!("{before}<link name=\"{link}\">{shape}</link>{after}")
    });
    let ball = |xyz: [f64; 3]| {
        let [x, y, z] = xyz;
        format!(
            "<collision><origin xyz=\"{x} {y} {z}\"/><geometry><sphere radius=\"0.005\"/></geometry></collision>"
        )
    };
    for [lift, elbow] in [[0.71, 1.234], [-1.01, -0.777], [2.05, 1.9]] {
        let on_forearm = Vector3::new(-0.2, 0.01, 0.02);
        let bare =
            Chain::<6>::from_urdf(&text.replace("SHOULDER", "").replace("FOREARM", ""), None, None).unwrap();
        let at = bare.forward(&[0.0, lift, elbow, 0.0, 0.0, 0.0]);
        let point = at.frames[2] * on_forearm + at.origins.column(2);
        let on_shoulder = at.frames[0].transpose() * (point - at.origins.column(0));
        let text = text.replace("SHOULDER", &ball(on_shoulder.into()));
        let text = text.replace("FOREARM", &ball(on_forearm.into()));
        let chain = Chain::<6>::from_urdf(&text, None, None).unwrap();
        let kept = clearance(&chain);
        assert_eq!(kept.distances_within(&at).count(), 1, "{lift} {elbow}");
        let met = kept.distances_within(&at).next().unwrap().1;
        let beside = chain.forward(&[0.0, lift + 0.07, elbow, 0.0, 0.0, 0.0]);
        assert!(met < 0.0 && kept.distances_within(&beside).next().unwrap().1 > 0.0);
    }
}
