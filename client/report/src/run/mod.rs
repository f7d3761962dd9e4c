//! A run of the demo: what it left behind, its figures and pictures, what went wrong, its report.
//!
//! In order: `last_words` and `watch` (while it lasts), `gathered` (everything that it left), `figures`,
//! `table`, `verdict`, `drawings`, `page`, `folder`.

mod last_words;
mod gathered;
mod watch;
mod figures;
mod table;
mod verdict;
mod drawings;
mod page;
pub mod folder;

use foretrace_config::Config;
use foretrace_control::extent::ExtentBounds;
use foretrace_failure::Failure;

pub use drawings::Drawings;
pub use figures::{RunFigures, SettingFigures};
pub use gathered::Gathered;
pub use last_words::LastWords;
pub use verdict::RunFinding;
pub use watch::RunWatch;

/// Figures, pictures and findings of a run.
#[derive(Debug)]
pub struct RunReport {
    pub figures: RunFigures,
    pub drawings: Drawings,
    /// The worst first; none for a run as it should be.
    pub findings: Vec<RunFinding>,
}

impl RunReport {
    /// `turn_s`: one repetition of the pen's path \[s\].
    ///
    /// # Errors
    ///
    /// The daemon reported no status.
    pub fn of(
        gathered: &Gathered,
        config: &Config,
        setting: SettingFigures,
        turn_s: f64,
    ) -> Result<Self, Failure> {
        let scored = figures::scored(gathered, config.settings());
        let figures = figures::figures(gathered, scored.as_ref(), config, setting)?;
        let findings = verdict::of(gathered, &figures, &ExtentBounds::of(&config.follower_settings()));
        let drawings = Drawings::of(gathered, &figures, scored.as_ref(), config, turn_s);
        Ok(Self { figures, drawings, findings })
    }

    /// Label and value of each figure.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        table::rows(&self.figures)
    }

    /// The report as one page that needs no file beside it.
    pub fn page(&self) -> String {
        page::page(&self.figures, &self.drawings, &self.findings)
    }
}
