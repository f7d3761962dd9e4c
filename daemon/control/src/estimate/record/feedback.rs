//! The tool under feedback alone: at the position that the pen had one lag ago.

use crate::state::state;

/// Longest lag of feedback that is modelled \[steps\].
const LONGEST_LAG: usize = 8;

/// The delay line, see the module.
#[derive(Debug, Clone)]
pub(super) struct Feedback {
    /// Lag of feedback behind the samples \[steps\].
    lag: f64,
    /// Grid points, newest first \[m\], and how many of them are known.
    grid: [[f64; 2]; LONGEST_LAG + 2],
    seen: usize,
}

state! { [] Feedback { lag, grid, seen } }

impl Feedback {
    /// Lag `steps`, at most [`LONGEST_LAG`]; 0 if NaN.
    pub(super) fn new(steps: f64) -> Self {
        let lag = if steps.is_finite() { steps.clamp(0.0, LONGEST_LAG as f64) } else { 0.0 };
        Self { lag, grid: [[0.0; 2]; LONGEST_LAG + 2], seen: 0 }
    }

    pub(super) fn forget(&mut self) {
        self.seen = 0;
    }

    /// A grid point at `position` \[m\].
    pub(super) fn close(&mut self, position: [f64; 2]) {
        self.grid.rotate_right(1);
        let [newest, ..] = &mut self.grid;
        *newest = position;
        self.seen = (self.seen + 1).min(self.grid.len());
    }

    /// The tool under feedback alone \[m\] when the newest sample is at `newest` \[m\], `phase` of a step
    /// after the newest grid point.
    pub(super) fn tool(&self, newest: [f64; 2], phase: f64) -> [f64; 2] {
        let point = |index: usize| {
            let known = index.min(self.seen.saturating_sub(1));
            self.grid.get(known).copied().filter(|_| self.seen > 0).unwrap_or(newest)
        };
        let phase = phase.clamp(0.0, 1.0);
        let back = self.lag - phase;
        if back > 0.0 {
            let index = back as usize;
            between(point(index), point(index + 1), back - index as f64)
        } else {
            between(newest, point(0), if phase > 0.0 { self.lag / phase } else { 0.0 })
        }
    }
}

fn between([nx, ny]: [f64; 2], [fx, fy]: [f64; 2], part: f64) -> [f64; 2] {
    [nx + part * (fx - nx), ny + part * (fy - ny)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tool_is_where_the_pen_was() {
        for lag in [0.0, 0.3, 1.0, 2.7, 7.9] {
            let mut feedback = Feedback::new(lag);
            for k in 0..20 {
                feedback.close([f64::from(k), -2.0 * f64::from(k)]);
            }
            for phase in [0.0, 0.25, 0.9] {
                let [x, y] = feedback.tool([19.0 + phase, -38.0 - 2.0 * phase], phase);
                let expected = 19.0 + phase - lag;
                assert!(
                    (x - expected).abs() < 1e-12 && (y + 2.0 * expected).abs() < 1e-12,
                    "{lag} {phase}: {x} {y}"
                );
            }
        }
    }

    #[test]
    fn before_there_is_a_past_it_is_at_the_oldest_point() {
        let mut feedback = Feedback::new(3.0);
        assert_eq!(feedback.tool([5.0, 6.0], 0.5), [5.0, 6.0]);
        feedback.close([1.0, 2.0]);
        feedback.close([2.0, 2.0]);
        assert_eq!(feedback.tool([2.5, 2.0], 0.5), [1.0, 2.0]);
        feedback.forget();
        assert_eq!(feedback.tool([5.0, 6.0], 0.5), [5.0, 6.0]);
        for steps in [f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(Feedback::new(steps).tool([5.0, 6.0], 0.2), [5.0, 6.0]);
        }
    }
}
