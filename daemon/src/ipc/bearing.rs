//! Where the measured arm is, and the note of its process about it: the part of the status that an operator
//! compares with the arm.

use foretrace_control::arm::Chain;
use foretrace_control::follower::FollowerSettings;
use foretrace_control::plane::Plane;
use foretrace_shm::{ArmNote, Status, Subscriber};

use crate::rt::facts::TickFacts;
use crate::wire::JOINTS;

/// The arm's geometry, and the newest note about it.
#[derive(Debug)]
pub struct Bearing {
    chain: Chain<JOINTS>,
    plane: Plane,
    note: Option<ArmNote>,
}

impl Bearing {
    /// For the arm of these settings.
    #[must_use]
    pub fn new(settings: &FollowerSettings<JOINTS>) -> Self {
        Self { chain: settings.chain.clone(), plane: settings.plane, note: None }
    }

    /// Takes the notes of the arm's process since the last look.
    pub fn take_notes(&mut self, notes: &mut Subscriber<ArmNote>) {
        self.note = notes.latest().or(self.note);
    }

    /// The note that is in force as of `newest`: the one that the newest joint state names, or one that came
    /// after it, from an arm's process without joint states.
    #[must_use]
    pub fn in_force(&self, newest: &TickFacts) -> Option<&ArmNote> {
        let since = |note: &&ArmNote| newest.measured.is_none_or(|(stamp, _)| note.since_ns > stamp.0);
        let named = |note: &&ArmNote| note.number == newest.ports.arm_note;
        self.note.as_ref().filter(|note| note.number != 0 && (named(note) || since(note)))
    }

    /// Fills in the status.
    pub fn fill(&self, status: &mut Status, newest: &TickFacts) {
        if let Some((_, q)) = newest.measured {
            let tool = self.chain.forward(&q);
            let over = self.plane.point_from_base(&tool.position);
            (status.joints_q, status.tool_base, status.tool_plane_m) = (q, tool.pose(), over.into());
        }
        if let Some(note) = self.in_force(newest) {
            (status.note_since_ns, status.note) = (note.since_ns.max(1), note.words);
        }
    }
}

#[cfg(test)]
mod tests {
    use foretrace_control::units::Stamp;
    use foretrace_shm::NoteWords;

    use super::*;
    use crate::ipc::tests::facts;
    use crate::testing::config;

    #[test]
    fn a_note_is_in_force_while_the_newest_state_names_it_or_none_came_since() {
        let mut bearing = Bearing::new(&config().follower_settings());
        let mut newest = facts(7);
        newest.measured = Some((Stamp(1000), config().robot().home));
        assert!(bearing.in_force(&newest).is_none());
        bearing.note = Some(ArmNote { since_ns: 900, number: 5, ..ArmNote::default() });
        assert!(bearing.in_force(&newest).is_none(), "a later state names none");
        newest.ports.arm_note = 5;
        assert!(bearing.in_force(&newest).is_some());
        newest.ports.arm_note = 0;
        bearing.note = Some(ArmNote { since_ns: 1001, number: 7, ..ArmNote::default() });
        assert!(bearing.in_force(&newest).is_some(), "an arm's process without joint states");
        bearing.note = Some(ArmNote { since_ns: 1001, number: 0, ..ArmNote::default() });
        assert!(bearing.in_force(&newest).is_none());
    }

    #[test]
    fn the_status_has_the_angles_the_pose_and_the_words() {
        let config = config();
        let mut bearing = Bearing::new(&config.follower_settings());
        let mut newest = facts(7);
        let mut status = Status::default();
        bearing.fill(&mut status, &newest);
        assert_eq!(status, Status::default());
        let home = config.robot().home;
        (newest.measured, newest.ports.arm_note) = (Some((Stamp(1000), home)), 5);
        let words = NoteWords::new("paused", "press play");
        bearing.note = Some(ArmNote { since_ns: 900, number: 5, words, ..ArmNote::default() });
        bearing.fill(&mut status, &newest);
        assert_eq!((status.joints_q, status.note, status.note_since_ns), (home, words, 900));
        let tool = config.robot().chain.forward(&home);
        let [x, y, z] = tool.position.into();
        assert_eq!(status.tool_base[..3], [x, y, z]);
        // The pen points down: half a turn about a level axis.
        let [rx, ry, rz] = [3, 4, 5].map(|k| status.tool_base[k]);
        let turn = (rx * rx + ry * ry + rz * rz).sqrt();
        assert!((turn - std::f64::consts::PI).abs() < 0.05 && rz.abs() < 0.05, "{:?}", status.tool_base);
        let [low, high] = config.settings().plane.workspace_m[2];
        assert!((low - 0.02..high + 0.02).contains(&status.tool_plane_m[2]), "{:?}", status.tool_plane_m);
    }
}
