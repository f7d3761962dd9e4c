//! What a page may say, and how it is read.
//!
//! Contract: pure and total: any text gives a message or a reason. Numbers are finite and lists bounded.

use foretrace_client::PenSample;
use foretrace_client::wire::{ORDER_AHEAD_NS, pen_flags};
use serde::Deserialize;

/// Largest message \[bytes\].
pub(crate) const MESSAGE_BYTES: usize = 32 * 1024;
/// Most pen samples in one message: more than a second's of any pen.
const SAMPLES: usize = 256;
/// Largest text to be written [characters].
const TEXT_CHARACTERS: usize = 60;

/// A hold-to-run button that was not heard of for this long is let go \[ns\].
pub(crate) const HOLD_LASTS_NS: u64 = 150_000_000;

/// A message of a page.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum PageMessage {
    /// To measure the clock: it comes back.
    Ping(f64),
    Control(String),
    /// Gives the control back.
    Release(bool),
    /// Stop the arm; from anybody.
    Stop(bool),
    /// Pen samples: time [µs on the monotonic clock], x and y \[m\], flags, pressure, tilts \[rad\].
    Pen(Vec<[f64; 7]>),
    /// The hold-to-run button is held (again and again) or let go; when [µs on the monotonic clock].
    Hold(bool, f64),
    /// An operator's request; when it was asked for [µs on the monotonic clock].
    Ask(OperatorRequest, f64),
    /// A text for the built-in writer; when it was asked for [µs on the monotonic clock].
    Write(String, f64),
    /// Ask whoever holds the pen to give way.
    TakePen(bool),
    /// Begin a recording, or end it.
    Record(bool),
}

/// What an operator asks for.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum OperatorRequest {
    Arm(bool),
    Disarm(bool),
    Home(bool),
    TrustAuto(bool),
    FreezeTrust(bool),
    Trust(f64),
    Predictor(String),
    Reload(bool),
}

impl PageMessage {
    /// Reads one.
    ///
    /// # Errors
    ///
    /// A word for the count of refusals.
    pub(crate) fn read(text: &str) -> Result<Self, &'static str> {
        if text.len() > MESSAGE_BYTES {
            return Err("message too long");
        }
        let message: Self = serde_json::from_str(text).map_err(|_| "message not understood")?;
        match &message {
            Self::Pen(samples) if samples.len() > SAMPLES => Err("too many samples at once"),
            Self::Write(text, _) if text.chars().count() > TEXT_CHARACTERS => Err("text too long"),
            Self::Ping(at) | Self::Hold(_, at) | Self::Ask(_, at) | Self::Write(_, at) if !at.is_finite() => {
                Err("number not finite")
            }
            Self::Ask(OperatorRequest::Trust(trust), _) if !trust.is_finite() => Err("number not finite"),
            _ => Ok(message),
        }
    }

    /// Only the page that controls may say it.
    pub(crate) const fn needs_control(&self) -> bool {
        matches!(
            self,
            Self::Pen(_)
                | Self::Hold(..)
                | Self::Ask(..)
                | Self::Write(..)
                | Self::TakePen(_)
                | Self::Record(_)
        )
    }
}

/// When a page decided something, by its account of the daemon's clock \[ns\]; never later than `now_ns`.
///
/// # Errors
///
/// It is dated ahead by more than a clock that is measured every second can be wrong.
fn told_at(at_us: f64, now_ns: u64, ahead: &'static str) -> Result<u64, &'static str> {
    // A cast of a number out of range saturates.
    let at_ns = (at_us * 1e3) as u64;
    if at_ns.saturating_sub(now_ns) > ORDER_AHEAD_NS { Err(ahead) } else { Ok(at_ns.min(now_ns)) }
}

/// When an order was asked for that a page tells of \[ns\]; never later than `now_ns`.
///
/// # Errors
///
/// It is dated ahead.
pub(crate) fn asked_at(at_us: f64, now_ns: u64) -> Result<u64, &'static str> {
    told_at(at_us, now_ns, "order dated ahead")
}

/// When a button was held that a page tells of \[ns\]; never later than `now_ns`.
///
/// # Errors
///
/// The message was under way for so long that the button may have been let go, or is dated ahead; a release
/// counts whatever its date.
pub(crate) fn held_at(held: bool, at_us: f64, now_ns: u64) -> Result<u64, &'static str> {
    let at_ns = match told_at(at_us, now_ns, "hold dated ahead") {
        Err(_) if !held => now_ns,
        told => told?,
    };
    if held && now_ns - at_ns >= HOLD_LASTS_NS { Err("hold came too late") } else { Ok(at_ns) }
}

/// A sample of a message; its admission is the gateway's.
pub(crate) fn sample([at_us, x_m, y_m, flags, pressure, tilt_x, tilt_y]: [f64; 7]) -> PenSample {
    // Casts of numbers out of range saturate, and NaN becomes 0: both are refused by their age.
    PenSample {
        device_stamp_ns: (at_us * 1e3) as u64,
        x_m,
        y_m,
        flags: flags as u32 & pen_flags::ALL,
        pressure: pressure as f32,
        tilt_x_rad: tilt_x as f32,
        tilt_y_rad: tilt_y as f32,
        ..PenSample::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_is_read_and_only_watching_and_stopping_need_no_control() {
        let free = [r#"{"ping":12.5}"#, r#"{"control":"abc"}"#, r#"{"release":true}"#, r#"{"stop":true}"#];
        let bound = [
            r#"{"pen":[[1,0.1,0.2,3,0.5,0,0]]}"#,
            r#"{"hold":[true,12.5]}"#,
            r#"{"ask":[{"arm":true},12.5]}"#,
            r#"{"ask":[{"trust":0.5},12.5]}"#,
            r#"{"ask":[{"predictor":"hold"},12.5]}"#,
            r#"{"write":["Hello",12.5]}"#,
            r#"{"take_pen":true}"#,
            r#"{"record":true}"#,
        ];
        assert!(free.iter().all(|text| !PageMessage::read(text).unwrap().needs_control()));
        assert!(bound.iter().all(|text| PageMessage::read(text).unwrap().needs_control()));
    }

    #[test]
    fn a_hold_is_as_old_as_its_page_says_and_a_late_one_is_refused() {
        let now = 10_000_000_000;
        assert_eq!(held_at(true, 9_900_000.0, now), Ok(9_900_000_000));
        assert_eq!(held_at(true, 9_850_000.0, now), Err("hold came too late"));
        // Clocks that differ a little are no reason; a hold that would last longer than its page is one.
        assert_eq!(held_at(true, 10_100_000.0, now), Ok(now));
        for ahead in [10_100_001.0, 15_000_000.0, 1e300] {
            assert_eq!(held_at(true, ahead, now), Err("hold dated ahead"), "{ahead}");
            assert_eq!(asked_at(ahead, now), Err("order dated ahead"), "{ahead}");
        }
        for (stamp, ns) in [(10_100_000.0, now), (9_000_000.0, 9_000_000_000), (-1.0, 0)] {
            assert_eq!(asked_at(stamp, now), Ok(ns));
        }
        for (stamp, ns) in [(9_000_000.0, 9_000_000_000), (1e300, now), (-1.0, 0)] {
            assert_eq!(held_at(false, stamp, now), Ok(ns));
        }
    }

    #[test]
    fn what_is_too_much_or_unknown_is_refused_with_a_word() {
        let many = format!(r#"{{"pen":[{}]}}"#, vec!["[1,2,3,4,5,6,7]"; 300].join(","));
        for (text, reason) in [
            ("", "message not understood"),
            (r#"{"pen":[[1,2]]}"#, "message not understood"),
            (r#"{"arm":true}"#, "message not understood"),
            (r#"{"ask":{"arm":true}}"#, "message not understood"),
            (r#"{"stop":true,"ping":1}"#, "message not understood"),
            (&many, "too many samples at once"),
            (&format!(r#"{{"write":["{}",1]}}"#, "a".repeat(61)), "text too long"),
            (&" ".repeat(MESSAGE_BYTES + 1), "message too long"),
        ] {
            assert_eq!(PageMessage::read(text), Err(reason), "{text:.60}");
        }
    }

    #[test]
    fn any_bytes_and_any_damage_give_a_message_or_a_reason() {
        let cases: u32 = std::env::var("FORETRACE_FUZZ_CASES")
            .map_or(50_000, |text| text.parse().expect("a whole number"));
        // xorshift64*: the same bytes in every run.
        let mut state = 0x0000_c045_01e0_u64;
        let mut dice = || {
            state ^= state >> 12;
            state ^= state << 25;
            state ^= state >> 27;
            state.wrapping_mul(0x2545_f491_4f6c_dd1d)
        };
        let good = r#"{"pen":[[1e9,0.1,-0.2,3,0.5,0.1,-0.1],[2e9,0.1,-0.2,3,0.5,0.1,-0.1]]}"#;
        let (mut read, mut refused) = (0, 0);
        for _ in 0..cases {
            let mut bytes = good.as_bytes().to_vec();
            for _ in 0..=dice() >> 62 {
                if bytes.len() < 2 {
                    break;
                }
                let at = (dice() >> 33) as usize % bytes.len();
                match dice() >> 62 {
                    0 => bytes[at] = (dice() >> 56) as u8,
                    1 => drop(bytes.remove(at)),
                    2 => bytes.insert(at, b"0123456789.-e[]{},:\""[(dice() >> 33) as usize % 20]),
                    _ => bytes.truncate(at.max(1)),
                }
            }
            match PageMessage::read(&String::from_utf8_lossy(&bytes)) {
                Ok(PageMessage::Pen(samples)) => {
                    read += 1;
                    for raw in samples {
                        assert_eq!(sample(raw).flags & !pen_flags::ALL, 0);
                    }
                }
                Ok(_) => read += 1,
                Err(_) => refused += 1,
            }
        }
        assert!(read > cases / 100 && refused > cases / 10, "{read} {refused}");
    }
}
