//! Where the measured arm is, and what its process says of it: the part of the status that an operator
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

    /// Takes what the arm's process said since the last look.
    pub fn hear(&mut self, now_ns: u64, notes: &mut Subscriber<ArmNote>) {
        self.note = notes.latest(now_ns).or(self.note);
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
    pub fn tell(&self, status: &mut Status, newest: &TickFacts) {
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
