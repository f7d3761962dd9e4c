//! Which samples of an outside client (a gateway's, a browser's) pass: finite, in range, later than the one
//! before, current, and within the rate.
//!
//! Contract: pure (time is an argument), no allocation, total for every bit pattern. What passes is stamped
//! strictly later than everything that passed before, also from an earlier client, and `rate` and `burst`
//! bound it over any stretch of time.

use foretrace_shm::{PenSample, RejectReason, Rejection, Validate};

/// How far a stamp may lie ahead of this host's clock \[ns\], which a gateway's client reads too and a
/// browser's page estimates.
pub const FUTURE_NS: u64 = 10_000_000;
/// How old a sample may be \[ns\]; the loop has no use for older ones.
pub const AGE_NS: u64 = 1_000_000_000;

/// Why a sample did not pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SampleRefusal {
    /// The sample itself is invalid.
    Wrong(Rejection),
    OverTheRate,
}

impl SampleRefusal {
    /// The reason as a word to count by.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Wrong(rejection) => rejection.reason.label(),
            Self::OverTheRate => "over the rate",
        }
    }
}

/// A token bucket in integers: the cost of a sample and the capacity, as time \[ns\].
#[derive(Debug, Clone, Copy)]
struct TokenBucket {
    cost_ns: u64,
    full_ns: u64,
    saved_ns: u64,
    filled_at_ns: u64,
}

impl TokenBucket {
    /// Full at `now_ns`. `rate`: samples per second; `burst`: samples at once. Both at least 1.
    fn new(rate: u32, burst: u32, now_ns: u64) -> Self {
        let cost_ns = (1_000_000_000 / u64::from(rate.max(1))).max(1);
        let full_ns = cost_ns.saturating_mul(u64::from(burst.max(1)));
        Self { cost_ns, full_ns, saved_ns: full_ns, filled_at_ns: now_ns }
    }

    fn take(&mut self, now_ns: u64) -> bool {
        let since = now_ns.saturating_sub(self.filled_at_ns);
        self.filled_at_ns = self.filled_at_ns.max(now_ns);
        self.saved_ns = self.saved_ns.saturating_add(since).min(self.full_ns);
        let enough = self.saved_ns >= self.cost_ns;
        if enough {
            self.saved_ns -= self.cost_ns;
        }
        enough
    }
}

/// The gateway's judgement of samples and what it remembers.
#[derive(Debug)]
pub struct Admission {
    bucket: TokenBucket,
    last_ns: Option<u64>,
}

impl Admission {
    /// `rate` \[samples/s\] in the long run, up to `burst` samples at once.
    #[must_use]
    pub fn new(rate: u32, burst: u32, now_ns: u64) -> Self {
        Self { bucket: TokenBucket::new(rate, burst, now_ns), last_ns: None }
    }

    /// Passes or refuses `sample` at `now_ns`; wrong samples use up the rate, too.
    ///
    /// # Errors
    ///
    /// Why it is refused.
    pub fn judge(&mut self, sample: &PenSample, now_ns: u64) -> Result<(), SampleRefusal> {
        if !self.bucket.take(now_ns) {
            return Err(SampleRefusal::OverTheRate);
        }
        sample.validate().map_err(SampleRefusal::Wrong)?;
        let stamp = sample.device_stamp_ns;
        let wrong = |reason, ns: u64, bound_ns: u64| {
            let evidence = Rejection::new(reason, "device_stamp_ns");
            Err(SampleRefusal::Wrong(evidence.because(ns as f64 * 1e-9, bound_ns as f64 * 1e-9)))
        };
        let (ahead_ns, age_ns) = (stamp.saturating_sub(now_ns), now_ns.saturating_sub(stamp));
        if ahead_ns > FUTURE_NS {
            return wrong(RejectReason::FromTheFuture, ahead_ns, FUTURE_NS);
        }
        if age_ns > AGE_NS {
            return wrong(RejectReason::TooOld, age_ns, AGE_NS);
        }
        match self.last_ns {
            Some(last) if stamp == last => return wrong(RejectReason::Replayed, 0, 0),
            Some(last) if stamp < last => return wrong(RejectReason::TimeBackwards, last - stamp, 0),
            _ => {}
        }
        self.last_ns = Some(stamp);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{FrameBuffer, Over};
    use foretrace_shm::gateway::{BODY_BYTES, FRAME_BYTES, Frame};

    const NOW: u64 = 5_000_000_000;

    fn sample(stamp_ns: u64) -> PenSample {
        PenSample { device_stamp_ns: stamp_ns, x_m: 0.1, y_m: 0.2, pressure: -1.0, ..Default::default() }
    }

    fn reason(result: Result<(), SampleRefusal>) -> &'static str {
        result.unwrap_err().label()
    }

    #[test]
    fn a_stamp_must_be_of_this_moment_and_later_than_the_last_that_passed() {
        let mut admission = Admission::new(1000, 100, NOW);
        assert_eq!(reason(admission.judge(&sample(NOW + FUTURE_NS + 1), NOW)), "from the future");
        assert_eq!(reason(admission.judge(&sample(NOW - AGE_NS - 1), NOW)), "too old");
        assert_eq!(reason(admission.judge(&sample(u64::MAX), NOW)), "from the future");
        assert_eq!(reason(admission.judge(&sample(0), NOW)), "too old");
        admission.judge(&sample(NOW), NOW).unwrap();
        assert_eq!(reason(admission.judge(&sample(NOW), NOW)), "replayed");
        assert_eq!(reason(admission.judge(&sample(NOW - 1), NOW)), "time backwards");
        admission.judge(&sample(NOW + FUTURE_NS), NOW).unwrap();
        assert_eq!(reason(admission.judge(&sample(NOW + 1), NOW)), "time backwards");
    }

    #[test]
    fn what_a_field_says_is_judged_and_a_refused_sample_leaves_no_stamp_behind() {
        let mut admission = Admission::new(1000, 100, NOW);
        let wrong = [
            (PenSample { x_m: f64::NAN, ..sample(NOW + 9) }, "not finite"),
            (PenSample { y_m: 10.5, ..sample(NOW + 9) }, "out of range"),
            (PenSample { pressure: 2.0, ..sample(NOW + 9) }, "out of range"),
            (PenSample { tilt_x_rad: f32::INFINITY, ..sample(NOW + 9) }, "not finite"),
            (PenSample { flags: 1 << 31, ..sample(NOW + 9) }, "unknown flags"),
        ];
        for (sample, expected) in wrong {
            assert_eq!(reason(admission.judge(&sample, NOW)), expected);
        }
        admission.judge(&sample(NOW), NOW).unwrap();
    }

    #[test]
    fn a_burst_passes_then_the_rate_and_rest_saves_no_more_than_a_burst() {
        let mut admission = Admission::new(1000, 5, NOW);
        let mut stamp = NOW;
        let mut passed = |admission: &mut Admission, now: u64, count: u64| {
            (0..count)
                .filter(|_| {
                    stamp += 1;
                    admission.judge(&sample(stamp), now).is_ok()
                })
                .count()
        };
        assert_eq!(passed(&mut admission, NOW, 20), 5);
        assert_eq!(passed(&mut admission, NOW + 1_000_000, 20), 1);
        assert_eq!(passed(&mut admission, NOW + 1_500_000, 20), 0);
        assert_eq!(passed(&mut admission, NOW + 4_000_000, 20), 3);
        assert_eq!(passed(&mut admission, NOW + 900_000_000, 20), 5);
        // A clock that runs backwards gives nothing.
        assert_eq!(passed(&mut admission, NOW, 20), 0);
    }

    #[test]
    fn whatever_bytes_come_only_sane_samples_pass_in_order_and_within_the_rate() {
        let cases: u32 = std::env::var("FORETRACE_FUZZ_CASES")
            .map_or(300_000, |text| text.parse().expect("a whole number"));
        // xorshift64*: the same bytes in every run.
        let mut state = 0x00c0_ffee_u64;
        let mut dice = || {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            state.wrapping_mul(0x2545_f491_4f6c_dd1d)
        };
        let (mut now, mut passed, mut refused, mut broken) = (NOW, 0_u64, 0_u64, 0_u64);
        let (rate, burst) = (2000, 50);
        let mut admission = Admission::new(rate, burst, now);
        let mut frames = FrameBuffer::new(BODY_BYTES..=BODY_BYTES);
        let mut last = 0;
        for _ in 0..cases {
            now += dice() >> 46;
            let mut bytes = Frame(sample(now - (dice() >> 44))).encode();
            for _ in 0..dice() >> 62 {
                // Mostly the fields of the sample, now and then the envelope.
                let at =
                    if dice() >> 60 == 0 { 0 } else { 16 } + (dice() >> 33) as usize % (FRAME_BYTES - 16);
                bytes[at] = (dice() >> 40) as u8;
            }
            frames.read_once(&mut bytes.as_slice(), FRAME_BYTES).unwrap();
            let frame = match frames.next_frame() {
                Ok(body) => Frame::decode(body.expect("a whole frame was given")).ok(),
                Err(over) => {
                    assert!(matches!(over, Over::Length(length) if length != BODY_BYTES));
                    None
                }
            };
            let Some(frame) = frame else {
                broken += 1;
                frames = FrameBuffer::new(BODY_BYTES..=BODY_BYTES);
                continue;
            };
            match admission.judge(&frame.0, now) {
                Ok(()) => {
                    assert!(frame.0.validate().is_ok());
                    let stamp = frame.0.device_stamp_ns;
                    assert!(stamp > last && stamp <= now + FUTURE_NS && stamp + AGE_NS >= now);
                    last = stamp;
                    passed += 1;
                }
                Err(_) => refused += 1,
            }
            let most = u64::from(burst) + (now - NOW) / (1_000_000_000 / u64::from(rate));
            assert!(passed <= most, "{passed} passed, {most} may");
        }
        let few = u64::from(cases / 300);
        assert!(passed > 10 * few && refused > 10 * few && broken > few, "{passed} {refused} {broken}");
    }
}
