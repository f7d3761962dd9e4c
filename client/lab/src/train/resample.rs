//! The same stroke as a device of another rate would have seen it.
//!
//! A step across two strokes stays one step: no point is made up between strokes. Positions count from the
//! first point; the pen rests where the last one lies.

use super::corpus::Strokes;

/// Every `factor`-th point from point `phase` on; the last steps may be fewer than `factor` samples.
pub(super) fn decimated(strokes: &Strokes, factor: usize, phase: usize) -> Strokes {
    let (mut v, mut jump) = (Vec::new(), Vec::new());
    let mut from = phase;
    while from < strokes.moving() {
        let to = (from + factor).min(strokes.moving());
        v.push(strokes.v[from..to].iter().fold([0.0; 2], |[a, b], [x, y]| [a + x, b + y]));
        jump.push((from..to).any(|t| strokes.jumps(t)));
        from = to;
    }
    Strokes::at_rest(v, jump)
}

/// Points every `ratio` samples from `start` (in [0, 1) samples) on, by cubic interpolation inside each
/// stroke.
pub(super) fn resampled(strokes: &Strokes, ratio: f64, start: f64) -> Strokes {
    let points = positions(strokes);
    let last = points.len() - 1;
    let count = ((last as f64 - start) / ratio).floor().max(0.0) as usize;
    // (point, the index of the last sample at or before it); times inside a jump move to its nearer end.
    let at = |k: usize| {
        let time = start + k as f64 * ratio;
        let index = (time.floor() as usize).min(last);
        let share = time - index as f64;
        if index == last || share == 0.0 {
            return (points[index], index);
        }
        if strokes.jumps(index) {
            return if share < 0.5 { (points[index], index) } else { (points[index + 1], index + 1) };
        }
        (between(strokes, &points, index, share), index)
    };
    let (mut v, mut jump) = (Vec::new(), Vec::new());
    let mut before = at(0);
    for k in 1..=count {
        let now = at(k);
        v.push([now.0[0] - before.0[0], now.0[1] - before.0[1]]);
        jump.push((before.1..now.1).any(|t| strokes.jumps(t)));
        before = now;
    }
    Strokes::at_rest(v, jump)
}

/// Catmull-Rom between samples `index` and `index + 1`; neighbours beyond a jump or an end are continued
/// straight.
fn between(strokes: &Strokes, points: &[[f64; 2]], index: usize, share: f64) -> [f64; 2] {
    let (p1, p2) = (points[index], points[index + 1]);
    let p0 = if index > 0 && !strokes.jumps(index - 1) { Some(points[index - 1]) } else { None };
    let p3 = if strokes.jumps(index + 1) { None } else { points.get(index + 2).copied() };
    std::array::from_fn(|axis| {
        let (b, c) = (p1[axis], p2[axis]);
        let a = p0.map_or(2.0 * b - c, |p| p[axis]);
        let d = p3.map_or(2.0 * c - b, |p| p[axis]);
        let s = share;
        b + 0.5 * s * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))
    })
}

/// Positions from the origin, the rest at the end left out: moving steps + 1.
pub(super) fn positions(strokes: &Strokes) -> Vec<[f64; 2]> {
    let mut at = [0.0; 2];
    let mut points = vec![at];
    for [x, y] in strokes.v.iter().take(strokes.moving()) {
        at = [at[0] + x, at[1] + y];
        points.push(at);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_strokes() -> Strokes {
        let v = [[1.0, 0.0], [2.0, 1.0], [30.0, -9.0], [1.0, 1.0], [2.0, 0.0], [3.0, 0.0]];
        Strokes::at_rest(v.to_vec(), vec![false, false, true, false, false, false])
    }

    #[test]
    fn both_phases_together_see_every_sample_and_end_where_the_pen_ends() {
        let even = decimated(&two_strokes(), 2, 0);
        let odd = decimated(&two_strokes(), 2, 1);
        assert_eq!(even.v[..3], [[3.0, 1.0], [31.0, -8.0], [5.0, 0.0]]);
        assert_eq!(odd.v[..3], [[32.0, -8.0], [3.0, 1.0], [3.0, 0.0]]);
        assert_eq!((&even.jump[..3], &odd.jump[..3]), (&[false, true, false][..], &[true, false, false][..]));
        assert_eq!((even.v.len(), odd.v.len()), (8, 8));
    }

    #[test]
    fn resampling_by_one_changes_nothing_and_a_straight_line_stays_straight() {
        let same = resampled(&two_strokes(), 1.0, 0.0);
        assert_eq!(same, two_strokes());
        let line = Strokes::at_rest(vec![[2.0, -1.0]; 20], vec![false; 20]);
        for v in &resampled(&line, 0.7, 0.3).v[..27] {
            assert!((v[0] - 1.4).abs() < 1e-12 && (v[1] + 0.7).abs() < 1e-12);
        }
    }

    #[test]
    fn a_parabola_is_met_exactly_inside_and_jumps_stay_single_steps() {
        let parabola = |t: f64| [t, 0.1 * t * t];
        let v = (0..30).map(|t| {
            let (a, b) = (parabola(f64::from(t)), parabola(f64::from(t + 1)));
            [b[0] - a[0], b[1] - a[1]]
        });
        let stroke = Strokes::at_rest(v.collect(), vec![false; 30]);
        let resampled_stroke = resampled(&stroke, 1.3, 0.0);
        for k in 1..20 {
            let (a, b) = (parabola(1.3 * f64::from(k)), parabola(1.3 * f64::from(k + 1)));
            let v = resampled_stroke.v[k as usize];
            assert!((v[0] - (b[0] - a[0])).abs() < 1e-9 && (v[1] - (b[1] - a[1])).abs() < 1e-9, "{k} {v:?}");
        }
        for ratio in [0.6, 0.9, 1.4, 2.3] {
            let changed = resampled(&two_strokes(), ratio, 0.2);
            assert_eq!(changed.jump.iter().filter(|j| **j).count(), 1, "{ratio}");
            let long = (0..changed.v.len()).filter(|&t| changed.length(t) > 12.0).count();
            assert_eq!(long, 1, "{ratio}: {:?}", changed.v);
        }
    }
}
