//! Names of columns: what stands in each, and in which unit.
//!
//! Contract: a name is words, whatever joins them (`t_ms`, `timeStamp`, `Pos X [mm]`), in letters of any
//! case; a last word that is a unit is the unit. Names of these exports are known: foretrace, Wacom's Wintab
//! packets (`pkX`, `pkTime`) and STU pads, MotionEvent of Android, PointerEvent of browsers.

use super::events::EventColumn;
use super::units::{Unit, unit};
use std::fmt;

/// Words before the unit; nearer ones first.
const TIMES: [&str; 31] = [
    "t",
    "time",
    "timestamp",
    "time stamp",
    "event time",
    "pk time",
    "time count",
    "ts",
    "device time",
    "device timestamp",
    "pen time",
    "sample time",
    "elapsed",
    "elapsed time",
    "relative time",
    "rel time",
    "system time",
    "sys time",
    "unix time",
    "epoch",
    "clock",
    "stamp",
    "time stamps",
    "event timestamp",
    "system timestamp",
    "sensor timestamp",
    "host time",
    "unix",
    "unix timestamp",
    "epoch time",
    "utc",
];
/// The same of x; of y with that letter.
const PLACES: [&str; 23] = [
    "x",
    "pos x",
    "x pos",
    "position x",
    "x position",
    "pen x",
    "tip x",
    "stylus x",
    "point x",
    "pk x",
    "axis x",
    "get x",
    "client x",
    "page x",
    "offset x",
    "screen x",
    "raw x",
    "coord x",
    "x coord",
    "x coordinate",
    "loc x",
    "location x",
    "abs x",
];
/// Those of screens, whose y grows downwards.
const OF_SCREENS: [&str; 6] = ["client x", "page x", "offset x", "screen x", "axis x", "get x"];
const CONTACTS: [&str; 21] = [
    "contact",
    "pen contact",
    "in contact",
    "is contact",
    "touch",
    "touching",
    "is touching",
    "pen down",
    "pendown",
    "is down",
    "down",
    "tip",
    "tip switch",
    "tip down",
    "sw",
    "switch",
    "pen status",
    "pen state",
    "writing",
    "on paper",
    "ink",
];
const HOVERS: [&str; 6] = ["hover", "hovering", "is hover", "in air", "pen up", "penup"];
/// Words beside one that tells a contact: whose it is.
const OF_CONTACTS: [&str; 16] = [
    "pen", "stylus", "tip", "nib", "finger", "mouse", "pointer", "surface", "paper", "screen", "is", "in",
    "on", "has", "state", "flag",
];
const CONTACT_WORDS: [&str; 5] = ["contact", "touch", "touching", "touched", "down"];
const EVENTS: [(&str, EventColumn); 10] = [
    ("type", EventColumn::Words),
    ("event", EventColumn::Words),
    ("event type", EventColumn::Words),
    ("event name", EventColumn::Words),
    ("action", EventColumn::Motion),
    ("action masked", EventColumn::Motion),
    ("motion event", EventColumn::Motion),
    ("phase", EventColumn::Phase),
    ("touch phase", EventColumn::Phase),
    ("state", EventColumn::State),
];
const BUTTONS: [&str; 3] = ["buttons", "pk buttons", "button state"];
const PRESSURE_WORDS: [&str; 3] = ["pressure", "force", "p"];
/// Words beside one that tells a pressure: whose it is, how it is written, and its unit.
const OF_PRESSURES: [&str; 31] = [
    "pen",
    "stylus",
    "tip",
    "nib",
    "touch",
    "contact",
    "pointer",
    "pk",
    "axis",
    "get",
    "axial",
    "normal",
    "norm",
    "normalized",
    "normalised",
    "raw",
    "scaled",
    "relative",
    "value",
    "level",
    "n",
    "newton",
    "newtons",
    "mn",
    "g",
    "gf",
    "pct",
    "percent",
    "pa",
    "hpa",
    "kpa",
];
const POINTER_TYPES: [&str; 3] = ["pointer type", "tool type", "input type"];
const POINTER_IDS: [&str; 3] = ["pointer id", "identifier", "touch id"];
const PRIMARIES: [&str; 2] = ["is primary", "primary"];

/// Where what stands in a row; columns from 0.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Columns {
    pub(super) count: usize,
    pub(super) t: usize,
    /// \[s\]; `None`: the name has none.
    pub(super) t_unit_s: Option<f64>,
    pub(super) place: [usize; 2],
    /// Metres per unit of x and y; `None`: the names have none.
    pub(super) place_m: Option<[f64; 2]>,
    /// The file's y grows downwards.
    pub(super) y_down: bool,
    pub(super) contact: Option<usize>,
    pub(super) hover: Option<usize>,
    /// And what its numbers are about.
    pub(super) event: Option<(usize, EventColumn)>,
    pub(super) buttons: Option<usize>,
    pub(super) pressure: Option<usize>,
    pub(super) pointer_type: Option<usize>,
    pub(super) pointer_id: Option<usize>,
    pub(super) primary: Option<usize>,
    /// As the header writes them.
    pub(super) names: Vec<String>,
}

/// What a header lacks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Lacking {
    Time,
    Place,
}

impl fmt::Display for Lacking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Time => "a column of time (t_s, t_ms, timestamp_us, ...)",
            Self::Place => "columns of x and y (x_m and y_m, x_mm and y_mm, clientX and clientY, ...)",
        })
    }
}

/// A column's name, taken apart.
struct Name {
    words: String,
    unit: Option<Unit>,
}

impl Columns {
    /// From the cells of a header.
    pub(super) fn of(cells: &[&str]) -> Result<Self, Lacking> {
        let names: Vec<Name> = cells.iter().map(|cell| parsed(cell)).collect();
        let (t, t_unit_s) = time(&names).ok_or(Lacking::Time)?;
        let (place, place_m, y_down) = place(&names).ok_or(Lacking::Place)?;
        let one = |list: &[&str]| {
            let of =
                |wanted: &&str| names.iter().position(|name| name.words == **wanted && name.unit.is_none());
            list.iter().find_map(of).filter(|at| *at != t && !place.contains(at))
        };
        let beside = |heads: &[&str], others: &[&str]| {
            let tells = |name: &Name| name.unit.is_none() && name.is_about(heads, others);
            let rank = |name: &Name| heads.iter().position(|head| name.words.split(' ').any(|w| w == *head));
            names
                .iter()
                .enumerate()
                .filter(|(at, name)| *at != t && !place.contains(at) && tells(name))
                .min_by_key(|(_, name)| (rank(name), name.words.len()))
                .map(|(at, _)| at)
        };
        let event = EVENTS.iter().find_map(|(name, kind)| Some((one(&[name])?, *kind)));
        Ok(Self {
            count: cells.len(),
            t,
            t_unit_s,
            place,
            place_m,
            y_down,
            contact: one(&CONTACTS).or_else(|| beside(&CONTACT_WORDS, &OF_CONTACTS)),
            hover: one(&HOVERS),
            event,
            buttons: one(&BUTTONS),
            pressure: beside(&PRESSURE_WORDS, &OF_PRESSURES),
            pointer_type: one(&POINTER_TYPES),
            pointer_id: one(&POINTER_IDS),
            primary: one(&PRIMARIES),
            names: cells.iter().map(|cell| (*cell).to_owned()).collect(),
        })
    }
}

impl Name {
    /// One of its words is of `heads`, the others of either list.
    fn is_about(&self, heads: &[&str], others: &[&str]) -> bool {
        let mut words = self.words.split(' ');
        words.clone().any(|word| heads.contains(&word))
            && words.all(|word| heads.contains(&word) || others.contains(&word))
    }
}

/// The nearest name of a time; one with a unit goes before those without.
fn time(names: &[Name]) -> Option<(usize, Option<f64>)> {
    let of = |(at, name): (usize, &Name)| {
        let unit = match name.unit {
            Some(Unit::Time(seconds)) => Some(seconds),
            None => None,
            Some(Unit::Length(_)) => return None,
        };
        // `millis` alone is a time too.
        let rank = if name.words.is_empty() && unit.is_some() {
            3
        } else {
            TIMES.iter().position(|t| *t == name.words)?
        };
        Some(((unit.is_none(), rank), (at, unit)))
    };
    names.iter().enumerate().filter_map(of).min_by_key(|(rank, _)| *rank).map(|(_, found)| found)
}

/// The nearest pair of x and y in one form and unit; metric ones go before others.
#[allow(clippy::type_complexity)]
fn place(names: &[Name]) -> Option<([usize; 2], Option<[f64; 2]>, bool)> {
    let mut best = None;
    for (rank, form) in PLACES.iter().enumerate() {
        let y_form = form.replace('x', "y").replace("ayis", "axis");
        for (x, x_name) in names.iter().enumerate().filter(|(_, name)| name.words == *form) {
            for (y, y_name) in names.iter().enumerate().filter(|(_, name)| name.words == y_form) {
                let length = |name: &Name| match name.unit {
                    Some(Unit::Length(metres)) => Some(metres),
                    None => Some(None),
                    Some(Unit::Time(_)) => None,
                };
                let (Some(x_m), Some(y_m)) = (length(x_name), length(y_name)) else { continue };
                let metric = x_m.zip(y_m).map(|(x, y)| [x, y]);
                if metric.is_none() && x_name.unit != y_name.unit {
                    continue;
                }
                let y_down = x_name.unit == Some(Unit::Length(None)) || OF_SCREENS.contains(form);
                let key = (metric.is_none(), x_name.unit != y_name.unit, rank, x, y);
                if best.as_ref().is_none_or(|(found, _)| key < *found) {
                    best = Some((key, ([x, y], metric, y_down)));
                }
            }
        }
    }
    best.map(|(_, found)| found)
}

/// Lower-case words, joined by blanks, and the unit behind them or in brackets.
fn parsed(cell: &str) -> Name {
    let (bare, bracketed) = match cell.split_once(['[', '(']) {
        Some((bare, rest)) => {
            (bare, Some(rest.trim_end().trim_end_matches([']', ')']).trim().to_lowercase()))
        }
        None => (cell, None),
    };
    let mut words: Vec<String> = Vec::new();
    let mut before = ' ';
    for c in bare.chars() {
        if !c.is_alphanumeric() {
            before = ' ';
            continue;
        }
        // `clientX` and `pkX` are two words; `UTC` and `X1` are one.
        let begins = before == ' ' || (c.is_uppercase() && before.is_lowercase());
        if begins {
            words.push(String::new());
        }
        if let Some(word) = words.last_mut() {
            word.extend(c.to_lowercase());
        }
        before = c;
    }
    let mut unit_of = bracketed.as_deref().and_then(unit);
    if unit_of.is_none() && bracketed.is_none()
        && let Some(found) = words.last().and_then(|word| unit(word))
        // `x in m` has both words; `t` and `s` alone are a name and a unit.
        && (words.len() > 1 || matches!(found, Unit::Time(_)))
    {
        unit_of = Some(found);
        words.pop();
        if words.last().is_some_and(|word| word == "in") {
            words.pop();
        }
    }
    Name { words: words.join(" "), unit: unit_of }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(header: &str) -> Columns {
        Columns::of(&header.split(',').collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn names_and_units_are_found_however_they_are_written() {
        // Header; column and unit of time; columns and unit of places; whether y grows downwards.
        type Case = (&'static str, usize, Option<f64>, [usize; 2], Option<f64>, bool);
        let cases: [Case; 12] = [
            ("t_s,x_m,y_m,contact", 0, Some(1.0), [1, 2], Some(1.0), false),
            ("contact,y_mm,x_mm,t_ms", 3, Some(1e-3), [2, 1], Some(1e-3), false),
            ("timestamp_us,x_um,y_um", 0, Some(1e-6), [1, 2], Some(1e-6), false),
            ("Time (ms),Pos X [mm],Pos Y [mm],Pressure [0..1]", 0, Some(1e-3), [1, 2], Some(1e-3), false),
            ("timeStamp,clientX,clientY,pressure,pointerType,type", 0, None, [1, 2], None, true),
            ("eventTimeNanos,x,y,action", 0, Some(1e-9), [1, 2], None, false),
            ("pkTime,pkX,pkY,pkNormalPressure", 0, None, [1, 2], None, false),
            ("x,y,tilt_x,tilt_y,dx,timeCount,sw", 5, None, [0, 1], None, false),
            ("x_px,y_px,x_mm,y_mm,time_s", 4, Some(1.0), [2, 3], Some(1e-3), false),
            ("downTime,eventTime,X,Y", 1, None, [2, 3], None, false),
            ("Time,time_s,x_px,y_px", 1, Some(1.0), [2, 3], None, true),
            ("millis,x in mm,y in mm", 0, Some(1e-3), [1, 2], Some(1e-3), false),
        ];
        for (header, t, t_unit_s, place, place_m, y_down) in cases {
            let found = columns(header);
            let seen = (found.t, found.t_unit_s, found.place, found.place_m, found.y_down);
            assert_eq!(seen, (t, t_unit_s, place, place_m.map(|m| [m; 2]), y_down), "{header}");
        }
        assert_eq!(columns("t,x_mm,y_um").place_m, Some([1e-3, 1e-6]));
        assert_eq!(columns("t,x,y,Pen Down").contact, Some(3));
        assert_eq!(columns("t,x,y,penUp").hover, Some(3));
        for (name, seconds) in [
            ("stamp_ns", 1e-9),
            ("unix_ms", 1e-3),
            ("t_msecs", 1e-3),
            ("t_millisec", 1e-3),
            ("stampUsecs", 1e-6),
        ] {
            assert_eq!(columns(&format!("{name},x,y")).t_unit_s, Some(seconds), "{name}");
        }
    }

    #[test]
    fn contact_and_pressure_are_found_by_their_main_word() {
        for name in
            ["tip_contact", "stylus_down", "isInContact", "Pen touch", "touching", "finger-down", "pen_state"]
        {
            assert_eq!(columns(&format!("t,x,y,{name}")).contact, Some(3), "{name}");
        }
        let pressures = [
            "tip_pressure",
            "pressure_raw",
            "normalizedPressure",
            "force_n",
            "pressure_n",
            "Force (N)",
            "pkNormalPressure",
            "Pressure [0..1]",
            "p",
            "Pressure (%)",
        ];
        for name in pressures {
            assert_eq!(columns(&format!("t,x,y,{name}")).pressure, Some(3), "{name}");
        }
        // Others of these words are not about the tip, or no flag.
        for name in [
            "touch_id",
            "down_time",
            "grip_force",
            "air_pressure",
            "force_x",
            "pressure_time",
            "contact_area",
        ] {
            let found = columns(&format!("t,x,y,{name}"));
            assert_eq!((found.contact, found.pressure), (None, None), "{name}");
        }
    }

    #[test]
    fn what_a_header_lacks_is_said() {
        let lacking = |header: &str| Columns::of(&header.split(',').collect::<Vec<_>>()).unwrap_err();
        assert_eq!(lacking("x,y,contact"), Lacking::Time);
        assert_eq!(lacking("t,x,contact"), Lacking::Place);
        assert_eq!(lacking("t_mm,x,y"), Lacking::Time);
        assert_eq!(lacking("t,x_mm,y"), Lacking::Place);
        assert_eq!(lacking("t_s,velocity_x,velocity_y"), Lacking::Place);
    }
}
