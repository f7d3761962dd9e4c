//! W3C InkML to [`Recording`]: traces with all three encodings, contexts, and groups as characters.
//!
//! A trace belongs to the nearest group around it that has a label (`annotation` of type `truth` or `label`,
//! or without a type), else to the nearest group; views (`traceView`) count as if the traces were inside
//! them, and take them from groups without a label. A file without groups is one character, labelled by the
//! document's own annotation. Y is turned upwards (InkML's own direction is down). Rate: `sampleRate`, else
//! the median step of the T channel, else 100 Hz (assumed). Steps of T longer than four periods, and those
//! between traces, are gaps.
//!
//! Absent: brushes, canvases, mappings, archives of several documents, views of parts of a trace, channels
//! other than X, Y and T. Traces outside every group are left out where there are groups. Source: W3C
//! Recommendation "Ink Markup Language (InkML)", 20 September 2011.

mod context;
mod trace;
mod document;

use crate::data::{Character, Component, FileError, GAP_PERIODS, Quantity, Recording, decoded};
use context::{InkContext, PointLayout};
use document::{Document, GroupItem, Referent, SyntaxFault, Trace};
use foretrace_config::files::shortened_path;
use std::collections::HashSet;
use std::path::Path;
use std::rc::Rc;

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
    let timing = InkTiming::of(&document).map_err(|why| FileError::whole(path, why))?;
    let segments = characters(&document, &timing).map_err(refused)?;
    if !segments.iter().any(|c| c.components.iter().any(|c| c.contact)) {
        return Err(FileError::whole(path, "no ink: the file has no trace with points"));
    }
    Ok(Recording {
        source: path.to_path_buf(),
        rate_hz: timing.rate_hz,
        rate_assumed: timing.assumed,
        notes: Vec::new(),
        units_per_m: timing.units_per_m,
        quantity: Quantity::Position,
        segments,
    })
}

/// What all traces of a file have in common.
struct InkTiming {
    rate_hz: f64,
    assumed: bool,
    units_per_m: Option<[f64; 2]>,
}

impl InkTiming {
    fn of(document: &Document) -> Result<Self, String> {
        let mut contexts: Vec<&Rc<InkContext>> = Vec::new();
        for trace in document.traces.iter().filter(|t| !t.points.xy.is_empty()) {
            if contexts.last().is_none_or(|last| !Rc::ptr_eq(last, &trace.context)) {
                contexts.push(&trace.context);
            }
        }
        let rates: Vec<f64> = contexts.iter().filter_map(|c| c.rate_hz()).collect();
        if let [first, others @ ..] = &rates[..]
            && let Some(other) = others.iter().find(|other| *other != first)
        {
            return Err(format!(
                "traces of {first} Hz and of {other} Hz in one file; keep one rate per file"
            ));
        }
        let layouts: Vec<PointLayout> = contexts.iter().map(|c| c.layout()).collect::<Result<_, _>>()?;
        let units_per_m = layouts.first().and_then(|l| l.units_per_m);
        if layouts.iter().any(|l| l.units_per_m != units_per_m) {
            return Err("traces of different units in one file; keep one unit per file".to_owned());
        }
        let stated = rates.first().copied().or_else(|| timed_rate(document));
        let rate_hz = stated.unwrap_or(RATE_HZ);
        if !(1e-3..=1e6).contains(&rate_hz) {
            return Err(format!("the T channel gives a rate of {rate_hz} Hz; legal: 0.001 to 1000000"));
        }
        Ok(Self { rate_hz, assumed: stated.is_none(), units_per_m })
    }
}

/// One over the median step of T.
fn timed_rate(document: &Document) -> Option<f64> {
    let mut steps: Vec<f64> = Vec::new();
    for trace in document.traces.iter().filter(|t| !t.points.times.is_empty()) {
        let unit_s = trace.context.layout().ok()?.t_unit_s;
        let times = &trace.points.times;
        steps.extend(
            times.iter().zip(times.iter().skip(1)).map(|(a, b)| (b - a) * unit_s).filter(|s| *s > 0.0),
        );
    }
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map(|step| 1.0 / step)
}

fn characters(document: &Document, timing: &InkTiming) -> Result<Vec<Character>, SyntaxFault> {
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
    let mut characters = Vec::new();
    for (index, traces) in owned.iter().enumerate().skip(usize::from(grouped)) {
        let Some(group) = groups.get(index) else { continue };
        let keeps = |trace: &&usize| (index != 0 && group.label.is_some()) || !viewed.contains(*trace);
        let runs = traces.iter().filter(keeps).filter_map(|t| document.traces.get(*t));
        let components = components(runs, timing, &mut budget).map_err(|why| (0, why))?;
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
    Ok(characters)
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

fn components<'a>(
    traces: impl Iterator<Item = &'a Trace>,
    timing: &InkTiming,
    budget: &mut usize,
) -> Result<Vec<Component>, String> {
    let period_s = 1.0 / timing.rate_hz;
    let mut components: Vec<Component> = Vec::new();
    let mut last_s: Option<f64> = None;
    for trace in traces {
        let layout = trace.context.layout()?;
        let [turn_x, turn_y] = layout.turn;
        *budget = budget.checked_sub(trace.points.xy.len() + COMPONENT_COST).ok_or_else(too_many)?;
        for (index, [x, y]) in trace.points.xy.iter().enumerate() {
            let now_s = trace.points.times.get(index).map(|t| t * layout.t_unit_s);
            let elapsed_s = now_s.zip(last_s).map(|(now, last)| now - last);
            let longest_s = if index == 0 { 1.5 * period_s } else { GAP_PERIODS * period_s };
            let gap_s = elapsed_s.filter(|elapsed| *elapsed > longest_s);
            let point = [x * turn_x, y * turn_y];
            match components.last_mut() {
                Some(open) if index > 0 && gap_s.is_none() => open.points.push(point),
                _ => components.push(Component {
                    contact: trace.contact,
                    points: vec![point],
                    dt_before_s: gap_s,
                }),
            }
            last_s = now_s;
        }
    }
    Ok(components)
}
