//! The replay in a page: pen, arm and ghost in true time, and the arm from the side, as frames for a script.
//!
//! Contract: the page gets numbers and nothing else, rounded: hundredths of a millimetre in the writing
//! plane, millimetres in space. The arm's joints are the forward kinematics of the measured angles. A run
//! that is too long is cut to the stretch in which the pen wrote most, and the page says so.

use foretrace_control::arm::Chain;
use foretrace_control::plane::Plane;
use foretrace_shm::JOINTS;
use nalgebra::Vector3;
use serde::Serialize;

use super::drawings::{GAP_S, View};
use super::run::RunTraces;

/// The longest replay \[s\]; keeps a page far below a megabyte.
pub(super) const LONGEST_S: f64 = 60.0;
/// Frames per second in the plane: the pen goes a millimetre or two in between.
const HZ: u32 = 100;
/// Frames per second of the arm, which is seen from afar.
const JOINTS_HZ: u32 = 50;
/// What touches the paper is nearer to it than this share of the height to which the tool lifts.
const TOUCHES: f64 = 0.1;
/// The joints' origins and the tip.
const POINTS: usize = JOINTS + 1;
/// Farther away is no place of an arm \[m\].
pub(super) const FARTHEST_M: f64 = 100.0;

const SCRIPT: &str = include_str!("moving.js");

/// What the arm is, and where it writes.
#[derive(Debug, Clone, Copy)]
pub struct DeskGeometry<'a> {
    pub chain: &'a Chain<JOINTS>,
    pub plane: &'a Plane,
    /// The paper in that plane: range of x and of y \[m\].
    pub paper_m: [[f64; 2]; 2],
}

/// A path in the plane, a frame each.
#[derive(Debug, Default, PartialEq, Serialize)]
struct PlaneTrack {
    /// Hundredths of a millimetre; null: not known.
    x: Vec<Option<i32>>,
    y: Vec<Option<i32>>,
    /// A letter per frame, 1: it touches the paper.
    down: String,
}

impl PlaneTrack {
    fn push(&mut self, at: Option<([f64; 2], bool)>) {
        let ([x, y], down) =
            at.map_or(([None; 2], false), |(desk, down)| (desk.map(|m| rounded(m, 1e5)), down));
        self.x.push(x);
        self.y.push(y);
        self.down.push(if down { '1' } else { '0' });
    }
}

/// The arm, a frame each.
#[derive(Debug, PartialEq, Serialize)]
struct Links {
    hz: u32,
    each: usize,
    /// x, y and z of the joints' origins and of the tip in the base's frame \[mm\]; null: not known.
    at: Vec<Option<i32>>,
}

#[derive(Debug, PartialEq, Serialize)]
pub struct ReplayFrames {
    hz: u32,
    /// What the clock shows at the first frame \[s\].
    from: f64,
    /// The frame that is shown to who wants no motion.
    still: usize,
    pen: PlaneTrack,
    arm: PlaneTrack,
    ghost: Option<PlaneTrack>,
    /// The plane's origin \[mm\], and its x and y in the base's frame.
    paper: [[f64; 3]; 3],
    /// Left, right, lower and upper edge of the paper in the plane \[mm\].
    sheet: [Option<i32>; 4],
    arm_joints: Links,
    /// What was left out, in words; empty if nothing was.
    #[serde(skip)]
    left_out: String,
}

impl ReplayFrames {
    /// The replay of what `view` shows of `run`; the clock is 0 at `zero_s`. `None`: there is too little.
    #[must_use]
    pub fn of(run: &RunTraces, view: &View<'_>, desk: &DeskGeometry<'_>, zero_s: f64) -> Option<Self> {
        let whole = view.span();
        let (from, to) = if whole.1 - whole.0 > LONGEST_S {
            view.liveliest(LONGEST_S).unwrap_or((whole.1 - LONGEST_S, whole.1))
        } else {
            whole
        };
        // A stretch that ends with a silent pen is longer. What is compared with NaN is false.
        let to = to.min(from + LONGEST_S);
        let count = if to - from > 0.1 { ((to - from) * f64::from(HZ)) as usize + 1 } else { return None };
        let left_out = if whole.1 - whole.0 > LONGEST_S {
            format!(
                "Of {:.0} s the {LONGEST_S:.0} s are shown in which the pen wrote most.",
                whole.1 - whole.0
            )
        } else {
            String::new()
        };
        let pen_rows: Vec<_> =
            run.pen.iter().map(|s| (s.t_s, [s.x_m, s.y_m, f64::from(s.contact)])).collect();
        let ghost_rows: Vec<_> = run.ghost.iter().map(|s| (s.t_s, s.at_m)).collect();
        let (mut pen, mut ghost) = (Along::new(&pen_rows), Along::new(&ghost_rows));
        let mut joints = Along::new(&run.joints);
        let touches = TOUCHES * desk.plane.lift_height;
        let mut moving = Self {
            hz: HZ,
            from: ((from - zero_s) * 1e2).round() / 1e2,
            still: 0,
            pen: PlaneTrack::default(),
            arm: PlaneTrack::default(),
            ghost: None,
            paper: paper(desk.plane),
            sheet: {
                let [[x0, x1], [y0, y1]] = desk.paper_m;
                [x0, x1, y0, y1].map(|m| rounded(m, 1e3))
            },
            arm_joints: Links { hz: JOINTS_HZ, each: 3 * POINTS, at: Vec::new() },
            left_out,
        };
        let (mut behind, mut farthest) = (PlaneTrack::default(), 0.0);
        for frame in 0..count {
            let t_s = from + frame as f64 / f64::from(HZ);
            let hand = pen.at(t_s);
            let unpredicted = ghost.at(t_s);
            // Contact does not become half a contact between two samples.
            moving.pen.push(hand.map(|[x, y, contact]| ([x, y], contact >= 1.0)));
            behind.push(unpredicted.map(|[x, y, z]| ([x, y], z <= touches)));
            if let (Some([x, y, contact]), Some([u, v, _])) = (hand, unpredicted) {
                let apart = (x - u).hypot(y - v);
                if contact >= 1.0 && apart > farthest {
                    (moving.still, farthest) = (frame, apart);
                }
            }
            let points = joints.at(t_s).map(|q| points(desk.chain, &q));
            let tip = points.and_then(|points| points.last().copied());
            moving.arm.push(tip.map(|tip| {
                let at = desk.plane.point_from_base(&tip);
                ([at.x, at.y], at.z <= touches)
            }));
            if frame.is_multiple_of((HZ / JOINTS_HZ) as usize) {
                let known = points.unwrap_or([Vector3::repeat(f64::NAN); POINTS]);
                let numbers = known.iter().flat_map(|point| <[f64; 3]>::from(*point));
                moving.arm_joints.at.extend(numbers.map(|m| rounded(m, 1e3)));
            }
        }
        if farthest == 0.0 {
            moving.still = count / 2;
        }
        moving.ghost = behind.x.iter().any(Option::is_some).then_some(behind);
        let seen = moving.pen.x.iter().chain(&moving.arm.x).any(Option::is_some);
        seen.then_some(moving)
    }

    /// The replay as a section of a page.
    #[must_use]
    pub fn section(&self) -> String {
        // Integers, nulls and finite floats: serialising them cannot fail, nor can they end the element.
        let data = serde_json::to_string(self).unwrap_or_else(|_| "null".to_owned());
        let left_out = &self.left_out;
        let gap = if left_out.is_empty() { "" } else { " " };
        let ghost = if self.ghost.is_some() {
            "<span><i class=\"ghost\"></i>without prediction: <b data-name=\"ghost\"></b></span>"
        } else {
            ""
        };
        let (arm, words) = if self.ghost.is_some() {
            (
                "the arm, with prediction",
                "The pen, the arm, and the arm as it would be without prediction (the ghost, computed beside it).",
            )
        } else {
            ("the arm", "The pen, and the arm that follows it.")
        };
        format!(
            "<section class=\"moving\" id=\"moving\">\n<h2>Pen and arm in true time</h2>\n\
             <p>{words}{gap}{left_out}</p>\n\
             <div class=\"keys gap\"><span><i class=\"pen\"></i>the pen</span><span><i class=\"arm\"></i>{arm}: \
             <b data-name=\"arm\"></b></span>{ghost}</div>\n\
             <div class=\"views\"><canvas role=\"img\" aria-label=\"What pen and arm write, and below it the desk \
             around the pen enlarged\"></canvas><canvas role=\"img\" aria-label=\"The arm from its \
             side\"></canvas></div>\n\
             <div class=\"bar\"><button type=\"button\">Play</button><input type=\"range\" min=\"0\" max=\"1\" \
             step=\"0.01\" value=\"0\" aria-label=\"Time in the replay\"/><output></output>\
             <button type=\"button\" aria-pressed=\"false\">Slow</button></div>\n\
             <noscript><p>The replay needs JavaScript; the pictures below do not.</p></noscript>\n\
             <script type=\"application/json\" id=\"moved\">{data}</script>\n<script>\n{SCRIPT}</script>\n</section>\n"
        )
    }
}

/// Origins of the joints and the tip, in the base's frame \[m\].
fn points(chain: &Chain<JOINTS>, q: &[f64; JOINTS]) -> [Vector3<f64>; POINTS] {
    let pose = chain.forward(q);
    let mut points = [pose.position; POINTS];
    for (point, origin) in points.iter_mut().zip(pose.origins.column_iter()) {
        *point = origin.into_owned();
    }
    points
}

fn paper(plane: &Plane) -> [[f64; 3]; 3] {
    let along = |axis: Vector3<f64>| -> [f64; 3] {
        <[f64; 3]>::from(plane.vector_to_base(&axis)).map(|share| (share * 1e5).round() / 1e5)
    };
    let origin = <[f64; 3]>::from(plane.origin).map(|m| (m * 1e3).round());
    [origin, along(Vector3::x()), along(Vector3::y())]
}

/// In units of which there are `per_m` in a metre; `None`: no place of an arm.
fn rounded(m: f64, per_m: f64) -> Option<i32> {
    (m.abs() <= FARTHEST_M).then(|| (m * per_m).round() as i32)
}

/// Rows (when [s], values) in order of time, asked for at rising times; linear in between, nothing in gaps.
struct Along<'a, const N: usize> {
    rest: &'a [(f64, [f64; N])],
    gap_s: f64,
}

impl<'a, const N: usize> Along<'a, N> {
    /// Where there are few rows, because few were recorded, what lies between two of them is not a gap.
    fn new(rows: &'a [(f64, [f64; N])]) -> Self {
        let mut steps: Vec<f64> = rows.iter().zip(rows.iter().skip(1)).map(|(a, b)| b.0 - a.0).collect();
        steps.sort_by(f64::total_cmp);
        let usual = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        Self { rest: rows, gap_s: GAP_S.max(3.0 * usual) }
    }

    fn at(&mut self, t_s: f64) -> Option<[f64; N]> {
        while let [_, next, ..] = self.rest
            && next.0 <= t_s
        {
            self.rest = self.rest.get(1..)?;
        }
        let (begin, from) = *self.rest.first().filter(|row| row.0 <= t_s)?;
        let Some(&(end, to)) = self.rest.get(1) else {
            return (t_s - begin < 1.0 / f64::from(HZ)).then_some(from);
        };
        let share = (t_s - begin) / (end - begin);
        let mut values = from;
        values.iter_mut().zip(to).for_each(|(value, to)| *value += (to - *value) * share);
        (end - begin <= self.gap_s && values.iter().all(|value| value.is_finite())).then_some(values)
    }
}

#[cfg(test)]
mod tests {
    use super::super::run::GhostSample;
    use super::*;
    use foretrace_config::Config;
    use foretrace_sim::path::PathSample;

    /// Two seconds at 500 Hz: the pen along x, the joints about home, a ghost 10 mm behind.
    fn run(config: &Config, ghost: bool) -> RunTraces {
        let times = || (0..1000).map(|k| 5.0 + f64::from(k) * 0.002);
        let mut run = RunTraces::default();
        for t_s in times() {
            let x_m = 0.05 * (t_s - 5.0);
            run.pen.push(PathSample { t_s, x_m, y_m: 0.01, contact: !(6.0..6.5).contains(&t_s) });
            let mut q = config.robot().home;
            q[0] += 0.1 * (t_s - 5.0);
            q[2] -= 0.05 * (t_s - 5.0).sin();
            run.joints.push((t_s, q));
            let plane = config.follower_settings().plane;
            let position = config.robot().chain.forward(&q).position;
            let (tool, height) = super::super::run::tool_at(t_s, &position, &plane);
            run.tool.push(tool);
            run.heights.push(height);
            if ghost {
                run.ghost.push(GhostSample { t_s, at_m: [x_m - 0.01, 0.01, 0.0] });
            }
        }
        run
    }

    fn moving(ghost: bool) -> (Config, RunTraces, ReplayFrames) {
        let config = Config::preset("ur5").unwrap();
        let run = run(&config, ghost);
        let plane = config.follower_settings().plane;
        let desk = DeskGeometry {
            chain: &config.robot().chain,
            plane: &plane,
            paper_m: [[-0.1, 0.1], [-0.05, 0.05]],
        };
        let moving = ReplayFrames::of(&run, &View::of(&run), &desk, 5.0).unwrap();
        (config, run, moving)
    }

    #[test]
    fn a_frame_of_the_arm_is_the_forward_kinematics_of_the_measured_joints() {
        let (config, run, moving) = moving(true);
        assert_eq!((moving.arm_joints.hz, moving.arm_joints.each), (50, 21));
        for frame in [0, 13, 40] {
            // Frames begin where the view does, and a frame lies at every tenth measurement.
            let (_, q) = run.joints[10 * frame];
            let pose = config.robot().chain.forward(&q);
            let wanted = pose.origins.column_iter().map(|c| c.into_owned()).chain([pose.position]);
            let wanted: Vec<i32> =
                wanted.flat_map(|p| [p.x, p.y, p.z]).map(|m| (1e3 * m).round() as i32).collect();
            let told: Vec<i32> =
                moving.arm_joints.at[21 * frame..21 * (frame + 1)].iter().map(|mm| mm.unwrap()).collect();
            let far = told.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).max().unwrap();
            assert!(far <= 1, "frame {frame}: {told:?} and not {wanted:?}");
        }
        let [first, last] = [&moving.arm_joints.at[..21], &moving.arm_joints.at[21 * 40..21 * 41]];
        assert_ne!(first, last, "the arm moves");
    }

    #[test]
    fn pen_arm_and_ghost_stand_in_hundredths_of_a_millimetre_at_one_time() {
        let (_, run, moving) = moving(true);
        let ghost = moving.ghost.as_ref().unwrap();
        assert_eq!((moving.pen.x[50], moving.pen.y[50], ghost.x[50]), (Some(2500), Some(1000), Some(1500)));
        let tool = run.tool[250];
        assert!((f64::from(moving.arm.x[50].unwrap()) - 1e5 * tool.x_m).abs() <= 1.0, "{tool:?}");
        assert_eq!(&moving.pen.down[98..102], "1100");
        assert!(moving.pen.x.len() == moving.arm.x.len() && moving.pen.x.len() == ghost.x.len());
        assert_eq!(moving.from, 0.0);
    }

    #[test]
    fn a_gap_and_what_is_no_place_are_not_drawn() {
        let rows = [(0.0, [0.0]), (0.01, [1.0]), (0.02, [2.0]), (0.5, [9.0]), (0.51, [f64::NAN])];
        let mut along = Along::new(&rows);
        let told = [-0.1, 0.0, 0.005, 0.02, 0.3, 0.505, 0.9].map(|t_s| along.at(t_s));
        assert_eq!(told, [None, Some([0.0]), Some([0.5]), None, None, None, None]);
        assert_eq!([rounded(f64::NAN, 1e5), rounded(1e9, 1e5), rounded(-0.01, 1e3)], [None, None, Some(-10)]);
    }

    #[test]
    fn a_long_run_is_cut_to_where_the_pen_wrote_most_and_says_so() {
        let config = Config::preset("ur5").unwrap();
        let mut run = RunTraces::default();
        for k in 0..30_000_u32 {
            let t_s = f64::from(k) * 0.01;
            // It writes fast from 150 s on for 60 s, and slowly otherwise.
            let fast = if (150.0..210.0).contains(&t_s) { 5.0 } else { 0.2 };
            run.pen.push(PathSample { t_s, x_m: 0.02 * (fast * t_s).sin(), y_m: 0.0, contact: true });
            run.joints.push((t_s, config.robot().home));
            run.tool.push(foretrace_sim::metrics::ToolSample { t_s, x_m: 0.0, y_m: 0.0 });
        }
        let plane = config.follower_settings().plane;
        let desk = DeskGeometry { chain: &config.robot().chain, plane: &plane, paper_m: [[-0.1, 0.1]; 2] };
        let moving = ReplayFrames::of(&run, &View::of(&run), &desk, 0.0).unwrap();
        assert!((moving.from - 150.0).abs() < 2.0 && moving.pen.x.len() <= 6002, "{}", moving.from);
        let page = moving.section();
        assert!(
            page.contains("Of 300 s the 60 s are shown in which the pen wrote most."),
            "{}",
            &page[..400]
        );
        assert!(page.len() < 1_000_000, "{} bytes", page.len());
    }

    #[test]
    fn without_a_ghost_nothing_is_drawn_in_its_place() {
        let (_, _, moving) = moving(false);
        assert_eq!(moving.ghost, None);
        let page = moving.section();
        assert!(!page.contains("without prediction:") && page.contains("\"ghost\":null"));
    }
}
