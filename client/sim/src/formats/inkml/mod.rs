//! W3C InkML to [`Recording`]: traces with all three encodings, contexts, and groups as characters.
//!
//! A trace belongs to the nearest group around it that has a label (`annotation` of type `truth` or `label`,
//! or without a type), else to the nearest group; views (`traceView`) count as if the traces were inside
//! them, and take them from groups without a label. A file without groups is one character, labelled by the
//! document's own annotation. Y is turned upwards (InkML's own direction is down). Time: the T channel, from
//! the timestamp of its `respectTo` or context on; else `sampleRate`; else `duration` of the traces; else 100
//! Hz (assumed). Points without T are placed by the others of their trace. Length: the channel's
//! `resolution`, else its `units`. A trace that names no context has the one in force, else the only one that
//! the file defines.
//!
//! Absent: brushes, canvases, mappings, archives of several documents, views of parts of a trace, channels
//! other than X, Y and T. Traces outside every group are left out where there are groups. Source: W3C
//! Recommendation "Ink Markup Language (InkML)", 20 September 2011.

mod context;
mod trace;
mod datetime;
mod document;
mod clock;

use crate::data::{Character, Component, FileError, Quantity, Recording, Remark, decoded, settle};
use clock::{InkClock, contexts};
use context::PointLayout;
use document::{Document, GroupItem, Referent, SyntaxFault, Trace};
use foretrace_config::files::shortened_path;
use std::collections::HashSet;
use std::path::Path;

const POINTS_MAX: usize = 20_000_000;
const COMPONENT_COST: usize = 4;
const RATE_HZ: f64 = 100.0;

/// Reads the bytes of an InkML file.
///
/// # Errors
/// [`FileError`] with line: malformed XML, a dangling reference, a format without X and Y, a value that is
/// not a number or too large, points of the wrong length, several rates or units in one file, no ink.
pub(crate) fn parse_inkml(bytes: &[u8], path: &Path) -> Result<Recording, FileError> {
    let text = decoded(bytes);
    let text = text.trim_start_matches('\u{feff}');
    let refused = |(at, reason): SyntaxFault| {
        let line = 1 + text.as_bytes().iter().take(at).filter(|b| **b == b'\n').count();
        FileError::at(path, line, &reason)
    };
    let document = document::read(text).map_err(refused)?;
    let whole = |why: String| FileError::whole(path, why);
    let scale = InkScale::of(&document).map_err(whole)?;
    let clock = InkClock::of(&document).map_err(whole)?;
    let (mut segments, outside) = characters(&document, &scale, &clock).map_err(refused)?;
    let settled = settle(&mut segments, clock.stated_hz()).map_err(whole)?;
    let mut remarks = document.remarks();
    remarks.extend(Remark::counted(outside, "strokes stand outside every group, and are left out"));
    let rate_hz = match (settled, &document.no_rate) {
        (Some((cadence, of_stamps)), no_rate) => {
            let unused = no_rate.as_ref().map(|(_, why)| Remark::new(format!("{why}; its stamps count")));
            remarks.extend(of_stamps.into_iter().chain(clock.remark()).chain(unused));
            Some(cadence.rate_hz)
        }
        (None, Some(no_rate)) => return Err(refused(no_rate.clone())),
        (None, None) => clock.first_rate_hz(),
    };
    if !segments.iter().any(|c| c.components.iter().any(|c| c.contact)) {
        return Err(FileError::whole(path, "no ink: the file has no trace with points"));
    }
    Ok(Recording {
        source: path.to_path_buf(),
        rate_hz: rate_hz.unwrap_or(RATE_HZ),
        rate_assumed: rate_hz.is_none(),
        damage: None,
        units_per_m: scale.units_per_m,
        quantity: Quantity::Position,
        segments,
        remarks,
    })
}

/// The unit of all points of a file.
struct InkScale {
    units_per_m: Option<[f64; 2]>,
    /// Contexts of several units: points are metres.
    in_metres: bool,
}

impl InkScale {
    fn of(document: &Document) -> Result<Self, String> {
        let mut layouts: Vec<PointLayout> = Vec::new();
        for context in contexts(document) {
            layouts.push(context.layout()?);
        }
        let units_per_m = layouts.first().and_then(|l| l.units_per_m);
        if layouts.iter().all(|l| l.units_per_m == units_per_m) {
            return Ok(Self { units_per_m, in_metres: false });
        }
        if layouts.iter().any(|l| l.units_per_m.is_none()) {
            return Err("traces with a unit of length and traces without one in one file; state units or \
                        resolution for X and Y in every context"
                .to_owned());
        }
        Ok(Self { units_per_m: Some([1.0; 2]), in_metres: true })
    }

    /// Turned upwards, and to one unit.
    fn factors(&self, layout: &PointLayout) -> [f64; 2] {
        match layout.units_per_m.filter(|_| self.in_metres) {
            Some(units) => [0, 1].map(|axis| layout.turn[axis] / units[axis]),
            None => layout.turn,
        }
    }
}

/// With the number of strokes that belong to none of them.
fn characters(
    document: &Document,
    scale: &InkScale,
    clock: &InkClock,
) -> Result<(Vec<Character>, u64), SyntaxFault> {
    let groups = &document.groups;
    let mut budget = POINTS_MAX;
    // Which group each run of ink belongs to; the document itself is group 0.
    let mut owned: Vec<Vec<usize>> = vec![Vec::new(); groups.len()];
    let mut viewed: HashSet<usize> = HashSet::new();
    for (index, group) in groups.iter().enumerate() {
        let owner = owner(document, index);
        let labelled = groups.get(owner).is_some_and(|g| owner != 0 && g.label.is_some());
        for item in &group.items {
            let before = owned.get(owner).map_or(0, Vec::len);
            let Some(list) = owned.get_mut(owner) else { continue };
            match item {
                GroupItem::Trace(trace) => list.push(*trace),
                GroupItem::View(target, at) => {
                    referred(document, target, list, &mut budget).map_err(|why| (*at, why))?;
                    if labelled {
                        viewed.extend(list.iter().skip(before));
                    }
                }
            }
        }
    }
    let grouped = owned.iter().skip(1).any(|traces| !traces.is_empty());
    let inside: HashSet<usize> = owned.iter().skip(usize::from(grouped)).flatten().copied().collect();
    let is_outside = |(index, trace): &(usize, &Trace)| {
        trace.contact && !trace.points.xy.is_empty() && !inside.contains(index)
    };
    let outside = document.traces.iter().enumerate().filter(is_outside).count() as u64;
    let mut characters = Vec::new();
    for (index, traces) in owned.iter().enumerate().skip(usize::from(grouped)) {
        let Some(group) = groups.get(index) else { continue };
        let keeps = |trace: &&usize| (index != 0 && group.label.is_some()) || !viewed.contains(*trace);
        let runs = traces.iter().filter(keeps).filter_map(|t| document.traces.get(*t));
        let components = components(runs, scale, clock, &mut budget).map_err(|why| (0, why))?;
        if components.is_empty() {
            continue;
        }
        characters.push(Character {
            label: group.label.clone().unwrap_or_default(),
            writer: writer(document, index),
            segment_index: characters.len(),
            components,
        });
    }
    Ok((characters, outside))
}

/// The nearest group with a label, the document aside; else the group itself.
fn owner(document: &Document, index: usize) -> usize {
    let mut at = index;
    while let Some(group) = document.groups.get(at).filter(|_| at != 0) {
        if group.label.is_some() {
            return at;
        }
        at = group.parent;
    }
    index
}

fn writer(document: &Document, index: usize) -> String {
    let mut at = index;
    loop {
        match document.groups.get(at) {
            Some(group) if group.writer.is_some() || at == 0 => {
                return group.writer.clone().unwrap_or_default();
            }
            Some(group) => at = group.parent,
            None => return String::new(),
        }
    }
}

/// Adds the traces that a view refers to.
fn referred(
    document: &Document,
    target: &str,
    list: &mut Vec<usize>,
    budget: &mut usize,
) -> Result<(), String> {
    let mut spend = |n: usize| {
        *budget = budget.checked_sub(n).ok_or_else(too_many)?;
        Ok::<(), String>(())
    };
    match document.ids.get(target) {
        Some(Referent::Trace(trace)) => {
            spend(1)?;
            list.push(*trace);
        }
        // Groups below a group come after it, each after its parent.
        Some(Referent::Group(root)) => {
            let mut below: HashSet<usize> = HashSet::from([*root]);
            for (index, group) in document.groups.iter().enumerate().skip(*root) {
                spend(1)?;
                if index == *root || below.contains(&group.parent) {
                    below.insert(index);
                    for item in &group.items {
                        if let GroupItem::Trace(trace) = item {
                            spend(1)?;
                            list.push(*trace);
                        }
                    }
                }
            }
        }
        None => {
            let target = shortened_path(target, 60);
            return Err(format!("traceDataRef {target:?} names no trace or group of this file"));
        }
    }
    Ok(())
}

fn too_many() -> String {
    format!("more than {POINTS_MAX} points together with the views of them")
}

/// The runs of the pen as they are written, stamped where they have a T channel.
fn components<'a>(
    traces: impl Iterator<Item = &'a Trace>,
    scale: &InkScale,
    clock: &InkClock,
    budget: &mut usize,
) -> Result<Vec<Component>, String> {
    let mut components = Vec::new();
    for trace in traces.filter(|trace| !trace.points.xy.is_empty()) {
        let layout = trace.context.layout()?;
        let [x_by, y_by] = scale.factors(&layout);
        *budget = budget.checked_sub(trace.points.xy.len() + COMPONENT_COST).ok_or_else(too_many)?;
        components.push(Component {
            contact: trace.contact,
            points: trace.points.xy.iter().map(|[x, y]| [x * x_by, y * y_by]).collect(),
            stamps_s: clock.stamps_s(trace, &layout),
            ..Component::default()
        });
    }
    Ok(components)
}
