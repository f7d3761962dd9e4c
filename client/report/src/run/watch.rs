//! What a run leaves behind while it lasts: its ticks, its stops, the daemon's last status.

use std::time::Duration;

use foretrace_client::{Foretrace, Mode, Requests, ServiceError, StatusReader, Telemetry};
use foretrace_record::page::LateTicks;

use super::gathered::{Gathered, JointUse, StopNote, TickNote};

/// Longest wait for the last status.
const ANSWER: Duration = Duration::from_secs(2);

/// What is read from the daemon while it runs.
pub struct RunWatch {
    status: StatusReader,
    telemetry: Telemetry,
    pub requests: Requests,
    pub gathered: Gathered,
    /// When the newest stop that is known latched \[ns\].
    stopped_ns: u64,
    lateness: LateTicks,
}

impl RunWatch {
    pub fn open(foretrace: &Foretrace) -> Result<Self, ServiceError> {
        Ok(Self {
            status: foretrace.status()?,
            telemetry: foretrace.telemetry()?,
            requests: foretrace.requests(),
            gathered: Gathered::default(),
            stopped_ns: 0,
            lateness: LateTicks::default(),
        })
    }

    /// Takes in what came since the last look.
    pub fn read(&mut self) {
        let Self { telemetry, gathered, stopped_ns, lateness, .. } = self;
        let Gathered { ticks, stops, joints, .. } = gathered;
        telemetry.drain(|record| {
            ticks.push(TickNote::of(record, lateness));
            joints.see(record);
            if record.stop.at_ns > *stopped_ns {
                *stopped_ns = record.stop.at_ns;
                stops.push(StopNote::of(record.fault, &record.stop));
            }
        });
        self.gathered.status = self.status.latest().copied().or(self.gathered.status);
        // The record of the tick may have been lost; the status repeats its stop.
        if let Some(status) = self.gathered.status.filter(|status| status.stop.at_ns > self.stopped_ns) {
            self.stopped_ns = status.stop.at_ns;
            self.gathered.stops.push(StopNote::of(status.fault, &status.stop));
        }
    }

    /// Discards everything recorded before this moment.
    pub fn begin(&mut self) {
        self.read();
        self.gathered.ticks.clear();
        self.gathered.stops.clear();
        self.gathered.joints = JointUse::default();
    }

    /// The daemon's last status.
    pub fn last_words(mut self) -> Gathered {
        let last = self.status.next_within(ANSWER);
        self.read();
        self.gathered.status = last.or(self.gathered.status);
        self.gathered.ticks_lost = self.telemetry.lost();
        self.gathered
    }

    pub fn mode(&self) -> Option<Mode> {
        self.gathered.status.and_then(|status| Mode::try_from(status.mode).ok())
    }
}
