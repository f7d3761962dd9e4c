//! Whether the daemon runs with the settings that this process was given.
//!
//! Contract: judged once for each daemon, by its first status; until then nothing is known. A live reload of
//! one daemon changes neither dead-man nor limits and is not judged again.

use foretrace_client::Status;

/// What is known about the daemon's settings.
#[derive(Debug)]
pub(crate) struct Agreement {
    hash: u64,
    /// Statuses stamped before are of an earlier daemon \[ns\].
    since_ns: u64,
    /// The daemon that was judged, and the verdict.
    judged: Option<(u64, bool)>,
    /// Takeovers that the stream of commands has shown.
    takeovers: u64,
}

impl Agreement {
    /// For a process whose settings have this hash.
    pub(crate) const fn new(hash: u64) -> Self {
        Self { hash, since_ns: 0, judged: None, takeovers: 0 }
    }

    /// Another daemon may be there since `now_ns`.
    pub(crate) fn forget(&mut self, now_ns: u64) {
        (self.since_ns, self.judged) = (now_ns, None);
    }

    /// The stream of commands has been taken over `takeovers` times, looked at at `now_ns`.
    pub(crate) fn taken_over(&mut self, takeovers: u64, now_ns: u64) {
        if std::mem::replace(&mut self.takeovers, takeovers) != takeovers {
            self.forget(now_ns);
        }
    }

    /// A status of a daemon.
    pub(crate) fn see(&mut self, status: &Status) {
        let known = self.judged.is_some_and(|(daemon, _)| daemon == status.daemon_id);
        if !known && status.header.stamp_ns >= self.since_ns {
            self.judged = Some((status.daemon_id, status.settings_hash == self.hash));
        }
    }

    /// Whether both have the same settings; `None`: not known yet.
    pub(crate) fn verdict(&self) -> Option<bool> {
        self.judged.map(|(_, agrees)| agrees)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foretrace_config::Config;
    use foretraced::settings_hash;

    fn status(daemon_id: u64, settings_hash: u64, stamp_ns: u64) -> Status {
        let mut status = Status { daemon_id, settings_hash, ..Status::default() };
        status.header.stamp_ns = stamp_ns;
        status
    }

    #[test]
    fn a_dead_man_in_one_of_two_settings_is_a_disagreement() {
        let hash = |text: &str| {
            settings_hash(&Config::parse(&format!("preset = \"ur5\"\n{text}"), "t.toml", ".").unwrap())
        };
        let mut agreement = Agreement::new(hash(""));
        assert_eq!(agreement.verdict(), None);
        agreement.see(&status(1, hash("[safety]\nenable_required = true\n"), 10));
        assert_eq!(agreement.verdict(), Some(false));
        agreement.see(&status(2, hash("[safety]\nenable_required = false\n"), 20));
        assert_eq!(agreement.verdict(), Some(true), "another daemon, with the same settings");
    }

    #[test]
    fn a_daemon_that_took_over_is_judged_by_its_own_status_only() {
        let mut agreement = Agreement::new(7);
        agreement.see(&status(1, 7, 10));
        agreement.taken_over(0, 15);
        assert_eq!(agreement.verdict(), Some(true));
        agreement.taken_over(1, 20);
        assert_eq!(agreement.verdict(), None);
        agreement.see(&status(1, 7, 19));
        assert_eq!(agreement.verdict(), None, "the last words of the old one");
        agreement.see(&status(2, 8, 21));
        assert_eq!(agreement.verdict(), Some(false));
        // A reload of the daemon that was judged is none of ours.
        agreement.forget(30);
        agreement.see(&status(3, 7, 31));
        agreement.see(&status(3, 8, 32));
        assert_eq!(agreement.verdict(), Some(true));
    }
}
