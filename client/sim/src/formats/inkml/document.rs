//! An InkML document from top to bottom: contexts as they come into force, traces, groups with their
//! annotations.

use super::context::{InkContext, InkSource, TraceFormat};
use super::datetime;
use super::trace::{Points, decode};
use crate::data::Remark;
use quick_xml::events::{BytesStart, Event};
use quick_xml::reader::Reader;
use std::collections::HashMap;
use std::rc::Rc;

const DEPTH_MAX: usize = 64;
const TRACES_MAX: usize = 1_000_000;
const LABEL_MAX: usize = 1000;
/// Milliseconds since 1970 are of the order of 1e12.
const TIME_MAX_MS: f64 = 1e15;

/// What is wrong and at which byte.
pub(super) type SyntaxFault = (usize, String);

/// Everything with ink, and its annotations.
#[derive(Debug, Default)]
pub(super) struct Document {
    pub(super) traces: Vec<Trace>,
    /// The first is the document itself.
    pub(super) groups: Vec<TraceGroup>,
    pub(super) ids: HashMap<String, Referent>,
    /// The first `sampleRate` that is none, and where.
    pub(super) no_rate: Option<SyntaxFault>,
    /// Points that the T channel has no value for.
    timeless: u64,
    /// Timestamps in no form that is read.
    odd_timestamps: u64,
}

impl Document {
    /// What of it was not taken as it stands.
    pub(super) fn remarks(&self) -> Vec<Remark> {
        let timeless = "points have no T; they are placed in time by those beside them in their trace, or by \
                        the rate";
        let odd = "timestamps have a timeString that is no xsd:dateTime, and are not used";
        let remarks = [Remark::counted(self.timeless, timeless), Remark::counted(self.odd_timestamps, odd)];
        remarks.into_iter().flatten().collect()
    }
}

/// One run of the pen.
#[derive(Debug)]
pub(super) struct Trace {
    pub(super) contact: bool,
    pub(super) points: Points,
    pub(super) context: Rc<InkContext>,
    /// Begin \[ms\] and length \[s\] as its attributes state them.
    pub(super) offset_ms: Option<f64>,
    pub(super) duration_s: Option<f64>,
}

/// A `<traceGroup>`, or a `<traceView>` with contents.
#[derive(Debug, Default)]
pub(super) struct TraceGroup {
    /// Index of the group around it; of the first, its own.
    pub(super) parent: usize,
    pub(super) label: Option<String>,
    pub(super) writer: Option<String>,
    pub(super) items: Vec<GroupItem>,
}

#[derive(Debug)]
pub(super) enum GroupItem {
    Trace(usize),
    /// What it refers to, and at which byte.
    View(String, usize),
}

#[derive(Debug, Clone, Copy)]
pub(super) enum Referent {
    Trace(usize),
    Group(usize),
}

pub(super) fn read(text: &str) -> Result<Document, SyntaxFault> {
    let mut reader = Reader::from_str(text);
    let mut builder = Builder::default();
    builder.document.groups.push(TraceGroup::default());
    loop {
        let at = reader.buffer_position() as usize;
        let event = reader
            .read_event()
            .map_err(|e| (reader.error_position() as usize, format!("malformed XML: {e}")))?;
        let after = reader.buffer_position() as usize;
        match event {
            Event::Start(element) => builder.start(&element, at, after)?,
            Event::Empty(element) => {
                builder.start(&element, at, after)?;
                builder.end(at)?;
            }
            Event::End(_) => builder.end(at)?,
            Event::Text(piece) => builder.text.push_str(&piece.decode().map_err(|e| (at, e.to_string()))?),
            Event::CData(piece) => builder.text.push_str(&piece.decode().map_err(|e| (at, e.to_string()))?),
            Event::GeneralRef(name) => {
                let code = name.resolve_char_ref().map_err(|e| (at, e.to_string()))?;
                let name = name.decode().map_err(|e| (at, e.to_string()))?;
                match (code, quick_xml::escape::resolve_predefined_entity(&name)) {
                    (Some(c), _) => builder.text.push(c),
                    (None, Some(known)) => builder.text.push_str(known),
                    (None, None) => return Err((at, format!("unknown entity &{};", cut(&name, 40)))),
                }
            }
            Event::Eof => return builder.finish(at),
            Event::Comment(_) | Event::Decl(_) | Event::PI(_) | Event::DocType(_) => {}
        }
    }
}

#[derive(Default)]
struct Builder {
    document: Document,
    open: Vec<OpenElement>,
    /// Text since the newest start tag.
    text: String,
    /// Where that text begins.
    text_at: usize,
    /// In force for traces that name no other; one per enclosing group.
    current: Vec<Rc<InkContext>>,
    formats: HashMap<String, Rc<TraceFormat>>,
    sources: HashMap<String, Rc<InkSource>>,
    contexts: HashMap<String, Rc<InkContext>>,
    timestamps: HashMap<String, Rc<f64>>,
    /// Contexts below `<definitions>`, and formats and devices there: for traces that name none, where there
    /// is no other.
    defined: [Vec<Rc<InkContext>>; 2],
    format: TraceFormat,
    source: InkSource,
    context: InkContext,
    group: usize,
}

/// An element that is open, with what its end needs.
struct OpenElement {
    name: String,
    id: Option<String>,
    kind: ElementKind,
}

enum ElementKind {
    /// Its contents are ignored.
    Ignored,
    Other,
    /// With its `type`.
    Annotation(String),
    Trace {
        contact: bool,
        context: Rc<InkContext>,
        prior: Option<Option<String>>,
        offset_ms: Option<f64>,
        duration_s: Option<f64>,
    },
    Group,
}

impl Builder {
    fn inside(&self, name: &str) -> bool {
        self.open.iter().any(|o| o.name == name)
    }

    fn start(&mut self, element: &BytesStart<'_>, at: usize, after: usize) -> Result<(), SyntaxFault> {
        if self.open.len() >= DEPTH_MAX {
            return Err((at, format!("elements nested deeper than {DEPTH_MAX}")));
        }
        let name = String::from_utf8_lossy(element.local_name().as_ref()).into_owned();
        if self.open.is_empty() && name != "ink" {
            return Err((at, format!("the document is <{}>; expected <ink>", cut(&name, 40))));
        }
        if self.open.last().is_some_and(|o| matches!(o.kind, ElementKind::Trace { .. })) {
            return Err((at, format!("<{}> inside a trace, which holds points only", cut(&name, 40))));
        }
        let attributes = Attributes::of(element).map_err(|why| (at, why))?;
        let ignored = self.open.last().is_some_and(|o| matches!(o.kind, ElementKind::Ignored));
        let kind = if ignored { Ok(ElementKind::Ignored) } else { self.opened(&name, &attributes, at) };
        self.open.push(OpenElement { name, id: attributes.get("id"), kind: kind.map_err(|why| (at, why))? });
        self.text.clear();
        self.text_at = after;
        Ok(())
    }

    fn opened(&mut self, name: &str, a: &Attributes, at: usize) -> Result<ElementKind, String> {
        match name {
            "annotationXML" | "brush" | "canvas" | "canvasTransform" | "mapping" => {
                return Ok(ElementKind::Ignored);
            }
            "annotation" => {
                return Ok(ElementKind::Annotation(a.get("type").unwrap_or_default().to_ascii_lowercase()));
            }
            "traceFormat" => self.format = TraceFormat::default(),
            "channel" => {
                let intermittent = self.inside("intermittentChannels");
                let begin_ms = self.referred(a, "respectTo", |b| &b.timestamps).ok().flatten().map(|ms| *ms);
                let (name, units) = (a.get("name"), a.get("units"));
                self.format.add(name, units, a.get("orientation"), begin_ms, intermittent)?;
            }
            "inkSource" => self.source = InkSource::default(),
            // Where stamps tell the time no rate is needed.
            "sampleRate" => {
                if let Err(why) = self.source.state_rate(a.get("value")) {
                    self.document.no_rate.get_or_insert((at, why));
                }
            }
            "channelProperty" if a.get("name").as_deref() == Some("resolution") => {
                let channel = a.get("channel").unwrap_or_default();
                self.source.state_resolution(&channel, a.get("value"), a.get("units"));
            }
            "context" => {
                self.context =
                    (*self.referred(a, "contextRef", |b| &b.contexts)?.unwrap_or_else(|| self.now())).clone();
                if let Some(format) = self.referred(a, "traceFormatRef", |b| &b.formats)? {
                    self.context.format = Some(format);
                }
                if let Some(source) = self.referred(a, "inkSourceRef", |b| &b.sources)? {
                    self.context.source = Some(source);
                }
                if let Some(begin_ms) = self.referred(a, "timestampRef", |b| &b.timestamps)? {
                    self.context.begin_ms = Some(*begin_ms);
                }
            }
            "timestamp" => {
                let from_ms = self.referred(a, "timestampRef", |b| &b.timestamps)?.map(|ms| *ms);
                let dated_ms = a.get("timeString").map(|text| datetime::milliseconds(&text));
                self.document.odd_timestamps += u64::from(dated_ms == Some(None));
                let base_ms = milliseconds(a, "time").or(dated_ms.flatten()).or(from_ms);
                let begin_ms =
                    base_ms.unwrap_or_default() + milliseconds(a, "timeOffset").unwrap_or_default();
                self.timestamps.extend(a.get("id").map(|id| (id, Rc::new(begin_ms))));
                if self.open.last().is_some_and(|o| o.name == "context") {
                    self.context.begin_ms = Some(begin_ms);
                }
            }
            "trace" => {
                let context =
                    self.referred(a, "contextRef", |b| &b.contexts)?.unwrap_or_else(|| self.usual());
                let contact = match a.get("type").as_deref() {
                    None | Some("penDown" | "indeterminate") => true,
                    Some("penUp") => false,
                    Some(other) => {
                        return Err(format!("trace type {other:?}; legal: penDown, penUp, indeterminate"));
                    }
                };
                let continues = matches!(a.get("continuation").as_deref(), Some("middle" | "end"));
                return Ok(ElementKind::Trace {
                    contact,
                    context,
                    prior: continues.then(|| a.get("priorRef")),
                    offset_ms: milliseconds(a, "timeOffset"),
                    duration_s: milliseconds(a, "duration").map(|ms| ms * 1e-3).filter(|s| *s > 0.0),
                });
            }
            "traceGroup" | "traceView" => {
                let context = self.referred(a, "contextRef", |b| &b.contexts)?.unwrap_or_else(|| self.now());
                self.current.push(context);
                let parent = std::mem::replace(&mut self.group, self.document.groups.len());
                self.document.groups.push(TraceGroup { parent, ..TraceGroup::default() });
                self.limit()?;
                if let Some(target) = a.get("traceDataRef") {
                    if a.get("from").is_some() || a.get("to").is_some() {
                        return Err("a traceView of part of a trace (from, to) is not read".to_owned());
                    }
                    self.item(GroupItem::View(target.trim_start_matches('#').to_owned(), at));
                }
                return Ok(ElementKind::Group);
            }
            _ => {}
        }
        Ok(ElementKind::Other)
    }

    fn end(&mut self, at: usize) -> Result<(), SyntaxFault> {
        let Some(closed) = self.open.pop() else { return Ok(()) };
        let text = std::mem::take(&mut self.text);
        let parent = self.open.last().map_or(String::new(), |o| o.name.clone());
        match closed.kind {
            ElementKind::Annotation(what) => self.annotate(&what, text.trim()),
            ElementKind::Trace { contact, context, prior, offset_ms, duration_s } => {
                let layout = context.layout().map_err(|why| (at, why))?;
                let points = decode(&text, &layout).map_err(|(offset, why)| (self.text_at + offset, why))?;
                let trace = Trace { contact, points, context, offset_ms, duration_s };
                self.trace(trace, closed.id, prior).map_err(|why| (at, why))?;
            }
            ElementKind::Group => {
                self.current.pop();
                self.name(closed.id, Referent::Group(self.group));
                self.group = self.document.groups.get(self.group).map_or(0, |g| g.parent);
            }
            ElementKind::Other => match closed.name.as_str() {
                "traceFormat" => {
                    let format = Rc::new(std::mem::take(&mut self.format));
                    self.place_format(&format, &parent);
                    self.formats.extend(closed.id.map(|id| (id, format)));
                }
                "inkSource" => {
                    let source = Rc::new(std::mem::take(&mut self.source));
                    match parent.as_str() {
                        "context" => self.context.source = Some(source.clone()),
                        "ink" => {
                            self.switch(InkContext { source: Some(source.clone()), ..(*self.now()).clone() })
                        }
                        "definitions" => {
                            let source = Some(source.clone());
                            self.defined[1].push(Rc::new(InkContext { source, ..InkContext::default() }));
                        }
                        _ => {}
                    }
                    self.sources.extend(closed.id.map(|id| (id, source)));
                }
                "context" => {
                    let context = Rc::new(std::mem::take(&mut self.context));
                    match parent.as_str() {
                        "definitions" => self.defined[0].push(context.clone()),
                        _ => self.switch((*context).clone()),
                    }
                    self.contexts.extend(closed.id.map(|id| (id, context)));
                }
                _ => {}
            },
            ElementKind::Ignored => {}
        }
        Ok(())
    }

    fn place_format(&mut self, format: &Rc<TraceFormat>, parent: &str) {
        match parent {
            "inkSource" => self.source.format = Some(format.clone()),
            "context" => self.context.format = Some(format.clone()),
            // Many writers of the format put it straight into the document.
            "ink" => self.switch(InkContext { format: Some(format.clone()), ..(*self.now()).clone() }),
            "definitions" => {
                self.defined[1]
                    .push(Rc::new(InkContext { format: Some(format.clone()), ..InkContext::default() }));
            }
            _ => {}
        }
    }

    fn now(&self) -> Rc<InkContext> {
        self.current.last().cloned().unwrap_or_default()
    }

    /// The context of a trace that names none. Many writers define a single one and never refer to it.
    fn usual(&self) -> Rc<InkContext> {
        let now = self.now();
        let [contexts, parts] = &self.defined;
        match (&contexts[..], &parts[..]) {
            _ if *now != InkContext::default() => now,
            ([only], _) | ([], [only]) => only.clone(),
            _ => now,
        }
    }

    fn switch(&mut self, context: InkContext) {
        self.current.pop();
        self.current.push(Rc::new(context));
    }

    /// What a `…Ref` attribute names; `None` without one and for the predefined `#Default…`.
    fn referred<T: Default>(
        &self,
        attributes: &Attributes,
        attribute: &str,
        known: impl Fn(&Self) -> &HashMap<String, Rc<T>>,
    ) -> Result<Option<Rc<T>>, String> {
        let Some(reference) = attributes.get(attribute) else { return Ok(None) };
        match reference.strip_prefix('#') {
            Some(id) if known(self).contains_key(id) => Ok(known(self).get(id).cloned()),
            Some(id) if id.starts_with("Default") => Ok(Some(Rc::default())),
            _ => Err(format!("{attribute} {:?} names nothing above it in this file", cut(&reference, 60))),
        }
    }

    fn item(&mut self, item: GroupItem) {
        if let Some(group) = self.document.groups.get_mut(self.group) {
            group.items.push(item);
        }
    }

    fn name(&mut self, id: Option<String>, named: Referent) {
        self.document.ids.extend(id.map(|id| (id, named)));
    }

    fn annotate(&mut self, what: &str, text: &str) {
        let Some(group) = self.document.groups.get_mut(self.group) else { return };
        // An annotation of another element, for example a trace, does not apply to the group.
        if !matches!(self.open.last().map(|o| o.name.as_str()), Some("ink" | "traceGroup" | "traceView")) {
            return;
        }
        match what {
            "truth" => group.label = Some(cut(text, LABEL_MAX)),
            "label" | "" if group.label.is_none() => group.label = Some(cut(text, LABEL_MAX)),
            "writer" | "writerid" | "writer-id" | "writer_id" => group.writer = Some(cut(text, 100)),
            _ => {}
        }
    }

    fn limit(&self) -> Result<(), String> {
        if self.document.traces.len() + self.document.groups.len() > TRACES_MAX {
            return Err(format!("more than {TRACES_MAX} traces and groups"));
        }
        Ok(())
    }

    fn trace(
        &mut self,
        trace: Trace,
        id: Option<String>,
        prior: Option<Option<String>>,
    ) -> Result<(), String> {
        self.limit()?;
        if let Some(prior) = prior {
            let found = match prior.as_deref().map(|p| p.trim_start_matches('#')) {
                Some(prior) => self.document.ids.get(prior).copied(),
                None => self.document.traces.len().checked_sub(1).map(Referent::Trace),
            };
            let Some(Referent::Trace(index)) = found else {
                return Err("a continued trace whose priorRef names no trace above it".to_owned());
            };
            if let Some(begun) = self.document.traces.get_mut(index) {
                let (layout, other) = (begun.context.layout()?, trace.context.layout()?);
                begun.points.go_on(trace.points, &layout, &other)?;
            }
            self.name(id, Referent::Trace(index));
            return Ok(());
        }
        let index = self.document.traces.len();
        self.document.traces.push(trace);
        self.item(GroupItem::Trace(index));
        self.name(id, Referent::Trace(index));
        Ok(())
    }

    fn finish(mut self, at: usize) -> Result<Document, SyntaxFault> {
        if let Some(open) = self.open.last() {
            return Err((at, format!("the file ends inside <{}>", cut(&open.name, 40))));
        }
        for trace in &mut self.document.traces {
            self.document.timeless += trace.points.place_in_time() as u64;
        }
        Ok(self.document)
    }
}

/// InkML knows about a dozen attributes. Comparing each with all before it takes quadratic time
/// (RUSTSEC-2026-0194), so a tag with very many must not be read to its end.
const MOST_ATTRIBUTES: usize = 256;

/// Attributes by local name, so that `xml:id` and `id` are one.
struct Attributes(Vec<(String, String)>);

impl Attributes {
    fn of(element: &BytesStart<'_>) -> Result<Self, String> {
        let mut all = Vec::new();
        for attribute in element.attributes() {
            if all.len() == MOST_ATTRIBUTES {
                return Err(format!("a tag with more than {MOST_ATTRIBUTES} attributes"));
            }
            let attribute = attribute.map_err(|e| format!("malformed attribute: {e}"))?;
            let value = attribute.unescape_value().map_err(|e| format!("malformed attribute: {e}"))?;
            let name = String::from_utf8_lossy(attribute.key.local_name().as_ref()).into_owned();
            all.push((name, value.into_owned()));
        }
        Ok(Self(all))
    }

    fn get(&self, name: &str) -> Option<String> {
        self.0.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone())
    }
}

/// An attribute in milliseconds.
fn milliseconds(attributes: &Attributes, name: &str) -> Option<f64> {
    let number = attributes.get(name)?.trim().parse::<f64>().ok()?;
    Some(number).filter(|ms| ms.abs() <= TIME_MAX_MS)
}

fn cut(text: &str, limit: usize) -> String {
    text.chars().take(limit).collect()
}
