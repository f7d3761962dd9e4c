//! The text of a `<trace>`: points between commas, values explicit (`!`), first (`'`) or second (`"`)
//! differences.
//!
//! A prefix holds for its channel until the next one. `*` repeats the last number of the channel, `?` is a
//! value that was not reported: a difference behind it counts from the last one that was. Values need no
//! space between them where a sign or prefix tells them apart.
//! Source: W3C Recommendation "Ink Markup Language (InkML)", 20 September 2011, section 3.3.1.

use super::context::PointLayout;

const VALUE_MAX: f64 = 1e9;
// Milliseconds since 1970 are of the order of 1e12, nanoseconds of 1e18.
const TIME_MAX: f64 = 1e19;

/// Decoded points of one trace.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Points {
    /// As written, y not turned yet.
    pub(super) xy: Vec<[f64; 2]>,
    /// In the unit of the T channel; empty without one, else as long as `xy`. NaN where it was not reported.
    pub(super) times: Vec<f64>,
}

/// What is wrong and how far into the text.
pub(super) type SyntaxFault = (usize, String);

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Encoding {
    #[default]
    Explicit,
    First,
    Second,
}

/// What a channel remembers from point to point.
#[derive(Debug, Clone, Copy, Default)]
struct ChannelState {
    encoding: Encoding,
    /// The last number written, whatever its encoding.
    written: Option<f64>,
    value: Option<f64>,
    /// The last value, of whatever point, that was no `?`.
    reported: Option<f64>,
    step: f64,
}

/// A value as written.
#[derive(Debug, Clone, Copy, PartialEq)]
enum TraceToken {
    Comma,
    Number(Option<Encoding>, f64),
    Repeat,
    Unknown,
}

/// Decodes the text of a trace whose channels lie as `layout` says.
pub(super) fn decode(text: &str, layout: &PointLayout) -> Result<Points, SyntaxFault> {
    let mut points = Points::default();
    let mut channels = vec![ChannelState::default(); layout.channels];
    let mut tokens = TraceTokens { text, at: 0 };
    let mut filled = 0;
    loop {
        let at = tokens.at;
        match tokens.next()? {
            Some(TraceToken::Comma) => points.close(&channels, &mut filled, layout, at)?,
            Some(token) => {
                let count = channels.len();
                let channel = channels.get_mut(filled).ok_or_else(|| {
                    (at, format!("a point has more than the {count} values of its traceFormat"))
                })?;
                channel.take(token).map_err(|why| (at, why))?;
                filled += 1;
            }
            None => {
                // A comma after the last point is allowed.
                if filled > 0 {
                    points.close(&channels, &mut filled, layout, at)?;
                }
                return Ok(points);
            }
        }
    }
}

impl Points {
    fn close(
        &mut self,
        channels: &[ChannelState],
        filled: &mut usize,
        layout: &PointLayout,
        at: usize,
    ) -> Result<(), SyntaxFault> {
        if *filled < layout.required {
            return Err((at, format!("a point has {filled} of {} values", layout.required)));
        }
        let value_of = |index: usize| channels.get(index).filter(|_| index < *filled).and_then(|c| c.value);
        let read = |index: usize, name: &str, limit: f64| {
            let value = value_of(index).ok_or_else(|| (at, format!("a point without a value for {name}")))?;
            if value.abs() <= limit {
                Ok(value)
            } else {
                Err((at, format!("{name} {value} is outside [-{limit:e}, {limit:e}]")))
            }
        };
        self.xy.push([read(layout.x, "X", VALUE_MAX)?, read(layout.y, "Y", VALUE_MAX)?]);
        if let Some(t) = layout.t {
            let reported = value_of(t).is_some();
            self.times.push(if reported { read(t, "T", TIME_MAX)? } else { f64::NAN });
        }
        *filled = 0;
        Ok(())
    }
}

impl Points {
    /// Adds those of a trace that goes on with this one: as `other` lays them out, where these are as
    /// `layout` does. Channels may differ, units are converted.
    ///
    /// # Errors
    /// Only one of both has a unit of length.
    pub(super) fn go_on(
        &mut self,
        next: Self,
        layout: &PointLayout,
        other: &PointLayout,
    ) -> Result<(), String> {
        let units = match (layout.units_per_m, other.units_per_m) {
            (Some(here), Some(there)) => [0, 1].map(|axis| here[axis] / there[axis]),
            (None, None) => [1.0; 2],
            _ => {
                return Err(
                    "a trace goes on in a context where X and Y have a unit of length, and begins in \
                            one where they have none, or the other way; state it in both"
                        .to_owned(),
                );
            }
        };
        let by = [0, 1].map(|axis| units[axis] * other.turn[axis] / layout.turn[axis]);
        let begins = self.xy.len();
        self.xy.extend(next.xy.iter().map(|[x, y]| [x * by[0], y * by[1]]));
        if self.times.is_empty() && next.times.is_empty() {
            return Ok(());
        }
        // What has no time of its own is placed by the rest.
        self.times.resize(begins, f64::NAN);
        let later = (other.t_begin_ms - layout.t_begin_ms) * 1e-3 / layout.t_unit_s;
        let t_by = other.t_unit_s / layout.t_unit_s;
        self.times.extend(next.times.iter().map(|t| later + t * t_by));
        self.times.resize(self.xy.len(), f64::NAN);
        Ok(())
    }

    /// Gives points without a time one in line with those beside them, at the ends in their usual step, and
    /// returns how many. Fewer than two known times are no clock: then all go.
    pub(super) fn place_in_time(&mut self) -> usize {
        let known: Vec<(usize, f64)> =
            self.times.iter().copied().enumerate().filter(|(_, t)| !t.is_nan()).collect();
        let missing = self.times.len() - known.len();
        let (Some(first), Some(last)) = (known.first(), known.last()) else {
            self.times.clear();
            return missing;
        };
        if missing == 0 {
            return 0;
        }
        let slope = |a: &(usize, f64), b: &(usize, f64)| (b.1 - a.1) / (b.0 - a.0) as f64;
        let mut steps: Vec<f64> = known.windows(2).map(|w| slope(&w[0], &w[1])).collect();
        steps.sort_by(f64::total_cmp);
        let Some(usual) = steps.get(steps.len() / 2) else {
            self.times.clear();
            return missing;
        };
        let mut behind = known.iter().peekable();
        let mut before: Option<&(usize, f64)> = None;
        for (index, time) in self.times.iter_mut().enumerate() {
            if let Some(here) = behind.next_if(|(at, _)| *at == index) {
                before = Some(here);
                continue;
            }
            *time = match (before, behind.peek()) {
                (Some(a), Some(b)) => a.1 + slope(a, b) * (index - a.0) as f64,
                (Some(_), None) => last.1 + usual * (index - last.0) as f64,
                (None, _) => first.1 - usual * (first.0 - index) as f64,
            };
        }
        missing
    }
}

impl ChannelState {
    fn take(&mut self, token: TraceToken) -> Result<(), String> {
        let number = match token {
            TraceToken::Comma => return Ok(()),
            TraceToken::Unknown => {
                self.value = None;
                return Ok(());
            }
            TraceToken::Repeat => self.written.ok_or("* with no value before it")?,
            TraceToken::Number(encoding, number) => {
                self.encoding = encoding.unwrap_or(self.encoding);
                number
            }
        };
        self.written = Some(number);
        let before = self.reported;
        if self.encoding == Encoding::Explicit {
            self.step = before.map_or(0.0, |before| number - before);
            (self.value, self.reported) = (Some(number), Some(number));
            return Ok(());
        }
        let before =
            before.ok_or("a difference with no value before it; the first point must be explicit")?;
        self.step = if self.encoding == Encoding::First { number } else { self.step + number };
        (self.value, self.reported) = (Some(before + self.step), Some(before + self.step));
        Ok(())
    }
}

struct TraceTokens<'t> {
    text: &'t str,
    at: usize,
}

impl TraceTokens<'_> {
    fn peek(&self) -> Option<u8> {
        self.text.as_bytes().get(self.at).copied()
    }

    fn blanks(&mut self) {
        while self.peek().is_some_and(|b| b.is_ascii_whitespace()) {
            self.at += 1;
        }
    }

    fn next(&mut self) -> Result<Option<TraceToken>, SyntaxFault> {
        self.blanks();
        let Some(first) = self.peek() else { return Ok(None) };
        let (encoding, simple) = match first {
            b',' => (None, Some(TraceToken::Comma)),
            b'*' => (None, Some(TraceToken::Repeat)),
            b'?' => (None, Some(TraceToken::Unknown)),
            b'T' => (None, Some(TraceToken::Number(None, 1.0))),
            b'F' => (None, Some(TraceToken::Number(None, 0.0))),
            b'!' => (Some(Encoding::Explicit), None),
            b'\'' => (Some(Encoding::First), None),
            b'"' => (Some(Encoding::Second), None),
            _ => (None, None),
        };
        self.at += usize::from(encoding.is_some() || simple.is_some());
        if simple.is_some() {
            return Ok(simple);
        }
        self.blanks();
        self.number().map(|number| Some(TraceToken::Number(encoding, number)))
    }

    fn number(&mut self) -> Result<f64, SyntaxFault> {
        let start = self.at;
        let mut negative = false;
        if let Some(sign @ (b'-' | b'+')) = self.peek() {
            negative = sign == b'-';
            self.at += 1;
            self.blanks();
        }
        let digits = self.at;
        let hexadecimal = self.peek() == Some(b'#');
        self.at += usize::from(hexadecimal);
        while let Some(byte) = self.peek() {
            let before = self.text.as_bytes().get(self.at.wrapping_sub(1)).map(u8::to_ascii_lowercase);
            let exponent_sign = matches!(byte, b'-' | b'+') && before == Some(b'e') && self.at > digits;
            let part = if hexadecimal {
                byte.is_ascii_hexdigit()
            } else {
                byte.is_ascii_digit() || matches!(byte, b'.' | b'e' | b'E') || exponent_sign
            };
            if !part {
                break;
            }
            self.at += 1;
        }
        let word = self.text.get(digits..self.at).unwrap_or_default();
        let number = match word.strip_prefix('#') {
            Some(hex) => u64::from_str_radix(hex, 16).ok().map(|n| n as f64),
            None => word.parse::<f64>().ok(),
        };
        match number.filter(|n| n.is_finite()) {
            Some(number) => Ok(if negative { -number } else { number }),
            None => {
                let rest = self.text.get(start..).unwrap_or_default();
                let word: String =
                    rest.chars().take_while(|c| !c.is_whitespace() && *c != ',').take(40).collect();
                Err((start, format!("{word:?} is not a number")))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn xy(text: &str) -> Result<Vec<[f64; 2]>, SyntaxFault> {
        decode(text, &PointLayout::plain()).map(|points| points.xy)
    }

    #[test]
    fn differences_add_up_as_in_the_recommendation() {
        let points = xy("1125 18432,'23'43,\"7\"-8,3-5,7 -3,6 2,6 8,3 6,2 4,*6,3*").unwrap();
        let x = [1125, 1148, 1178, 1211, 1251, 1297, 1349, 1404, 1461, 1520, 1582];
        let y = [18432, 18475, 18510, 18540, 18567, 18596, 18633, 18676, 18723, 18776, 18835];
        let wanted: Vec<[f64; 2]> = x.iter().zip(y).map(|(x, y)| [f64::from(*x), f64::from(y)]).collect();
        assert_eq!(points, wanted);
    }

    #[test]
    fn values_may_touch_and_return_to_explicit() {
        assert_eq!(xy("0 0,'1-2,!7!-8,9+3,").unwrap(), [[0.0, 0.0], [1.0, -2.0], [7.0, -8.0], [9.0, 3.0]]);
        assert_eq!(xy("1.5e1-2E-1,#1F * ").unwrap(), [[15.0, -0.2], [31.0, -0.2]]);
        assert_eq!(xy(" \n").unwrap(), Vec::<[f64; 2]>::new());
    }

    #[test]
    fn points_without_a_time_stand_in_line_with_those_beside_them() {
        let layout = PointLayout { channels: 3, required: 3, t: Some(2), ..PointLayout::plain() };
        for (times, wanted, missing) in [
            ("0 5 ? 15 20", vec![0.0, 5.0, 10.0, 15.0, 20.0], 1),
            ("? ? 10 15 20 ?", vec![0.0, 5.0, 10.0, 15.0, 20.0, 25.0], 3),
            ("? 7 ?", vec![], 2),
            ("? ?", vec![], 2),
            ("3", vec![3.0], 0),
            // A difference counts from the last time that was reported.
            ("0 '5 ? '10 '5", vec![0.0, 5.0, 10.0, 15.0, 20.0], 1),
        ] {
            let text: Vec<String> = times.split(' ').map(|t| format!("1 2 {t}")).collect();
            let mut points = decode(&text.join(","), &layout).unwrap();
            let found = (points.place_in_time(), points.xy.len(), points.times);
            assert_eq!(found, (missing, text.len(), wanted), "{times}");
        }
    }

    #[test]
    fn what_does_not_fit_is_named_with_its_position() {
        for (text, at, why) in [
            ("1 2,3 x", 6, "\"x\" is not a number"),
            ("1 2,3", 5, "a point has 1 of 2 values"),
            ("1 2,,3 4", 4, "a point has 0 of 2 values"),
            ("1 2 3", 3, "a point has more than the 2 values of its traceFormat"),
            ("'1 2", 0, "a difference with no value before it; the first point must be explicit"),
            ("* 2", 0, "* with no value before it"),
            ("? 2", 3, "a point without a value for X"),
            ("1 1e300", 7, "Y 1000000000000000000000000000000000000000000000000000"),
            ("1 NaN", 2, "\"NaN\" is not a number"),
        ] {
            let (found_at, found) = xy(text).unwrap_err();
            assert!(found.starts_with(why) && found_at == at, "{text}: {found_at} {found}");
        }
    }
}
