//! The way home in messages and figures: how far it is, and what blocks it.

use foretrace_control::clearance::Clearance;
use foretrace_control::clearance::way::MORE_M;
use foretrace_control::follower::{FollowerSettings, Mode, WayBlocked};
use foretrace_shm::WayHome;

use crate::rt::facts::TickFacts;
use crate::wire::JOINTS;

/// Data of the arm needed for that.
#[derive(Debug)]
pub struct Homeward {
    settings: FollowerSettings<JOINTS>,
    /// Names of the pairs of bodies, by the law's numbers.
    pairs: Vec<String>,
}

impl Homeward {
    /// For the arm of these settings, from which the law was built.
    #[must_use]
    pub fn new(settings: FollowerSettings<JOINTS>) -> Self {
        let period_s = settings.period_ns as f64 * 1e-9;
        let clearance = settings
            .clearance
            .as_ref()
            .and_then(|wanted| Clearance::new(&settings.chain, &settings.limits, period_s, wanted).ok());
        let pairs = clearance.map_or_else(Vec::new, |clearance| clearance.pair_names());
        Self { settings, pairs }
    }

    /// The way from the measured joints, or the rest of it while the arm moves.
    #[must_use]
    pub fn way_home(&self, newest: &TickFacts) -> WayHome {
        let way = newest.measured.and_then(|(_, q)| self.settings.way_home(&q));
        let Some((joint, farthest_rad, left_s)) = way else { return WayHome::UNKNOWN };
        let way = WayHome {
            farthest_rad,
            left_s,
            joint: u32::try_from(joint).unwrap_or(u32::MAX),
            ..WayHome::UNKNOWN
        };
        match newest.output.home.filter(|_| newest.output.mode == Mode::Homing) {
            Some(home) => {
                WayHome { left_s: home.left_s, share: home.share, moving: home.moving.into(), ..way }
            }
            None => way,
        }
    }

    /// What blocks the way, at which distance, and the remedy; fits into an answer.
    #[must_use]
    pub fn obstructed(&self, by: &WayBlocked) -> String {
        if by.pair == WayBlocked::PAPER {
            let (below_mm, percent) = (-1e-3 * f64::from(by.distance_um), by.percent);
            return format!(
                "the pen's tip would be {below_mm:.1} mm below the paper {percent} % of the way on: move it \
                 by hand"
            );
        }
        let pair = self.pairs.get(usize::from(by.pair)).map_or("something", String::as_str);
        let (near_mm, percent) = (f64::from(by.distance_um) * 1e-3, by.percent);
        let margin_m = self.settings.clearance.as_ref().map_or(0.0, |clearance| clearance.margin_m);
        let kept_mm = 1e3 * (margin_m + MORE_M);
        format!(
            "{pair} would be {near_mm:.1} mm apart (wanted: {kept_mm:.1}) {percent} % of the way on: move it \
             by hand"
        )
    }
}
