//! Regular and hostile pens that come to rest at the end.

use rand::RngExt;
use rand_pcg::Pcg64;

/// Where the pen is in the plane's frame \[m\] and whether it touches; `None`: silent.
pub(crate) type Pen = Box<dyn Fn(f64) -> Option<([f64; 2], bool)>>;

/// A pen that moves as its name says until `until` \[s\], and then rests or falls silent.
pub(crate) fn pen(random: &mut Pcg64, workspace: [[f64; 2]; 2], until: f64) -> (String, Pen) {
    let half = workspace.map(|[low, high]| 0.5 * (high - low));
    let middle = workspace.map(|[low, high]| 0.5 * (high + low));
    let place = move |x: f64, y: f64| [middle[0] + x * half[0], middle[1] + y * half[1]];
    let (rate, phase) = (random.random_range(4.0..18.0), random.random_range(0.0..6.0));
    let wide = random.random_range(0.2..2.5);
    let strokes = random.random_range(0.06..0.6);
    let stays: Vec<(f64, [f64; 2])> = {
        let mut at = 0.0;
        let longest = [0.05, 0.2, 0.6][random.random_range(0..3)];
        (0..400)
            .map(|_| {
                at += random.random_range(0.01..longest);
                (at, place(random.random_range(-wide..wide), random.random_range(-wide..wide)))
            })
            .collect()
    };
    let corners = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    let names = ["writing", "leaps", "corners", "sweeps", "tremor", "toggling", "silences"];
    let name = names[random.random_range(0..names.len())];
    let path = move |t: f64| match name {
        "writing" => [
            middle[0] + 0.015 * (rate * t + phase).sin() + 0.01 * t,
            middle[1] + 0.012 * (1.6 * rate * t).cos(),
        ],
        "leaps" | "silences" => stays.iter().find(|(until, _)| t < *until).map_or(middle, |(_, at)| *at),
        "corners" => {
            let (x, y) = corners[(t / (strokes + 0.2)) as usize % 4];
            place(wide * x, wide * y)
        }
        "sweeps" => place(wide * (rate * t).sin(), wide * (0.3 * rate * t + phase).sin()),
        "tremor" => {
            let shake = 0.003 * wide * (std::f64::consts::TAU * 2.0 * rate * t).sin();
            [middle[0] + shake + 0.02 * t, middle[1] - shake]
        }
        _ => [middle[0] + 0.01 * (t / strokes).floor() % 0.03, middle[1]],
    };
    let rests_silent = random.random_bool(0.3);
    let down = random.random_bool(0.6);
    let rest = if random.random_bool(0.3) {
        place(random.random_range(-1.2..1.2), random.random_range(-1.2..1.2))
    } else {
        path(until)
    };
    let pen = move |t: f64| {
        if t >= until {
            return (!rests_silent || t < until + 0.05).then_some((rest, down));
        }
        if name == "silences" && !((t / 0.3) as u64).is_multiple_of(2) {
            return None;
        }
        Some((path(t), ((t / strokes) as u64).is_multiple_of(2)))
    };
    (format!("{name}{}", if rests_silent { ", silent" } else { "" }), Box::new(pen))
}
