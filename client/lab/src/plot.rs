//! The picture that only an experiment needs: a ramp of trust (figure 3).

use std::path::Path;

use foretrace_sim::plot::{ChartPanel, Line, Mark, PlotError, panels};

/// What happened around a ramp of trust, per grid step.
#[derive(Debug, Clone, Copy)]
pub struct Rampup<'a> {
    /// (step, trust in \[0, 1\]).
    pub trust: &'a [(f64, f64)],
    /// (step, error \[m\]).
    pub error_m: &'a [(f64, f64)],
    /// (step, size of the jerk \[m/s³\]).
    pub jerk_mps3: &'a [(f64, f64)],
    /// First and last step of the ramp.
    pub ramp: (f64, f64),
}

/// Draws a ramp of trust with the error and the jerk around it, the ramp shaded.
///
/// # Errors
/// [`PlotError`]: no finite point, or the file cannot be written.
pub fn trust_ramp(file: &Path, title: &str, subtitle: &str, data: Rampup<'_>) -> Result<(), PlotError> {
    let error_mm: Vec<(f64, f64)> = data.error_m.iter().map(|(s, e)| (*s, e * 1e3)).collect();
    let line = |label, points| [Line { label, points, mark: Mark::Solid }];
    let (error, jerk, trust) =
        (line("error", &error_mm[..]), line("jerk", data.jerk_mps3), line("trust", data.trust));
    let stacked = [
        ChartPanel { y_label: "error [mm]", y_range: None, lines: &error },
        ChartPanel { y_label: "jerk [m/s³]", y_range: None, lines: &jerk },
        ChartPanel { y_label: "trust α", y_range: Some((0.0, 1.05)), lines: &trust },
    ];
    panels(file, title, subtitle, "step", &stacked, Some(data.ramp))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_whole_svg_with_its_title() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("ramp.svg");
        let points: Vec<(f64, f64)> = (0..100).map(|i| (f64::from(i), f64::from(i % 13))).collect();
        let ramp = Rampup { trust: &points, error_m: &points, jerk_mps3: &points, ramp: (30.0, 40.0) };
        trust_ramp(&file, "Title & co", "", ramp).unwrap();
        let svg = std::fs::read_to_string(&file).unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(
            svg.contains("<title>Title &amp; co</title>") && !svg.contains("NaN") && !svg.contains("inf")
        );
    }
}
