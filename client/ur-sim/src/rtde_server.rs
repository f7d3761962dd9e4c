//! One RTDE connection as the controller sees it: recipes, inputs, answers.
//!
//! Contract: total; what it makes of a package depends on the connection's own state and the inputs others
//! own.

use std::collections::HashMap;

use super::inputs::{Denied, InputVariables, Owner};
use super::options::ControllerOptions;
use super::outputs::OutputSource;
use super::world::World;
use foretrace_ur::primary::MessageContent;
use foretrace_ur::rtde::frames::{HEADER, LARGEST, RtdeWireError};
use foretrace_ur::rtde::recipe::RtdeRecipe;
use foretrace_ur::rtde::value::{FieldType, RtdeValue};
use foretrace_ur::rtde::wire::{
    ControllerVersion, FieldAnswer, ProtocolVersion, RtdeMessage, RtdeReply, RtdeRequest,
};

/// Recipes of inputs: what their number can say.
const MOST_RECIPES: usize = 255;
/// Fields of a recipe: an answer has at least five bytes for each.
const MOST_FIELDS: usize = LARGEST / 5;
/// Longest message that is kept \[bytes\].
const LONGEST_MESSAGE: usize = 255;

/// What a connection wants to be sent.
#[derive(Debug, Default)]
pub struct OutputFeed {
    /// What is read for a package, each once.
    sources: Vec<OutputSource>,
    /// Which of them each field is: a client may ask for one a thousand times.
    fields: Vec<usize>,
    /// A package is due every so many cycles; `None` where it was never set up.
    every: Option<u64>,
    started: bool,
    rate_hz: f64,
}

#[derive(Debug)]
pub struct RtdeSession {
    owner: Owner,
    software: ControllerVersion,
    version: ProtocolVersion,
    recipes: Vec<ClaimedInputs>,
    /// What it wants to be sent.
    pub feed: OutputFeed,
}

#[derive(Debug)]
struct ClaimedInputs {
    recipe: RtdeRecipe,
    slots: Vec<usize>,
}

impl OutputFeed {
    /// Whether a package is due in `cycle`.
    #[must_use]
    pub fn due(&self, cycle: u64) -> bool {
        self.started && self.every.is_some_and(|every| cycle.is_multiple_of(every))
    }
}

impl RtdeSession {
    /// A new connection, in version 1 of the protocol.
    #[must_use]
    pub fn new(owner: Owner, options: &ControllerOptions) -> Self {
        let rate_hz = f64::from(options.series.rate_hz());
        let feed = OutputFeed { rate_hz, ..OutputFeed::default() };
        Self { owner, software: options.version, version: ProtocolVersion::V1, recipes: Vec::new(), feed }
    }

    /// The package for this cycle, if one is due.
    #[must_use]
    pub fn package(&self, world: &World) -> Option<Vec<u8>> {
        if !self.feed.due(world.robot.cycle) {
            return None;
        }
        let mut fields = Vec::new();
        let values: Vec<RtdeValue> = self.feed.sources.iter().map(|source| source.read(world)).collect();
        for value in self.feed.fields.iter().filter_map(|field| values.get(*field)) {
            value.put(&mut fields);
        }
        let recipe = (self.version == ProtocolVersion::V2).then_some(1);
        RtdeReply::Data { recipe, fields }.encode(self.version).ok()
    }

    pub fn answer(&mut self, kind: u8, payload: &[u8], world: &mut World) -> Vec<Vec<u8>> {
        let version = self.version;
        let replies = match RtdeRequest::decode(kind, payload, version) {
            Ok(request) => self.reply(request, world),
            Err(RtdeWireError::Type(kind)) => vec![self.complaint(format!("unknown package type {kind}"))],
            Err(error) => vec![self.complaint(error.to_string())],
        };
        replies.iter().filter_map(|reply| reply.encode(version).ok()).collect()
    }

    fn complaint(&self, text: String) -> RtdeReply {
        RtdeReply::Message(RtdeMessage { level: 1, text, source: "RTDE".to_owned() })
    }

    fn reply(&mut self, request: RtdeRequest, world: &mut World) -> Vec<RtdeReply> {
        match request {
            RtdeRequest::Protocol(number) => {
                let version = ProtocolVersion::from_number(number);
                self.version = version.unwrap_or(self.version);
                vec![RtdeReply::Protocol(version.is_some())]
            }
            RtdeRequest::ControllerVersion => vec![RtdeReply::ControllerVersion(self.software)],
            RtdeRequest::Message(message) => {
                let text: String = message.text.chars().take(LONGEST_MESSAGE).collect();
                world.say(MessageContent::Text(text));
                Vec::new()
            }
            RtdeRequest::Outputs { frequency, names } => self.outputs(frequency, &names),
            RtdeRequest::Inputs { names } => self.inputs(&names, &mut world.inputs),
            RtdeRequest::Start if self.feed.every.is_none() => {
                vec![self.complaint("no outputs are set up".to_owned()), RtdeReply::Start(false)]
            }
            RtdeRequest::Start => {
                self.feed.started = true;
                vec![RtdeReply::Start(true)]
            }
            RtdeRequest::Pause => {
                self.feed.started = false;
                vec![RtdeReply::Pause(true)]
            }
            RtdeRequest::Data { recipe, fields } => self.data(recipe, &fields, world),
        }
    }

    const fn version(&self) -> (u32, u32, u32) {
        (self.software.major, self.software.minor, self.software.bugfix)
    }

    /// A recipe with a field that is not there is none, but says of each field what it is. A rate that the
    /// series does not do, or more than a package holds, is refused as a whole.
    fn outputs(&mut self, frequency: Option<f64>, names: &[String]) -> Vec<RtdeReply> {
        self.feed = OutputFeed { rate_hz: self.feed.rate_hz, ..OutputFeed::default() };
        let second = self.version == ProtocolVersion::V2;
        let refused = |session: &Self, why: String| {
            let none = RtdeReply::Outputs { recipe: second.then_some(0), answers: Vec::new() };
            vec![session.complaint(why), none]
        };
        let rate = self.feed.rate_hz;
        let frequency = frequency.unwrap_or(rate);
        if !(1.0..=rate).contains(&frequency) {
            return refused(self, format!("{frequency} Hz is not from 1 to {rate}"));
        }
        if names.len() > MOST_FIELDS {
            return refused(self, format!("more than {MOST_FIELDS} fields"));
        }
        let sources: Vec<Option<(OutputSource, FieldType)>> =
            names.iter().map(|name| OutputSource::of(name, self.version())).collect();
        let answers: Vec<FieldAnswer> = sources
            .iter()
            .map(|source| source.as_ref().map_or(FieldAnswer::NotFound, |(_, kind)| FieldAnswer::Type(*kind)))
            .collect();
        let bytes: usize = sources.iter().flatten().map(|(_, kind)| kind.size()).sum();
        if !fits(&answers) || bytes + HEADER + 1 > LARGEST {
            return refused(self, format!("the answer or the package has more than {LARGEST} bytes"));
        }
        let mut id = 0;
        if !sources.is_empty() && sources.iter().all(Option::is_some) {
            let mut known: HashMap<&str, usize> = HashMap::new();
            for (name, (source, _)) in names.iter().zip(sources.into_iter().flatten()) {
                let next = self.feed.sources.len();
                let field = *known.entry(name).or_insert(next);
                if field == next {
                    self.feed.sources.push(source);
                }
                self.feed.fields.push(field);
            }
            // Whole cycles, as the guide has it: no rate is missed, but one that divides none is exceeded.
            self.feed.every = Some((rate / frequency).floor() as u64);
            id = 1;
        }
        vec![RtdeReply::Outputs { recipe: second.then_some(id), answers }]
    }

    fn inputs(&mut self, names: &[String], inputs: &mut InputVariables) -> Vec<RtdeReply> {
        let refused = |why: &str| {
            vec![self.complaint(why.to_owned()), RtdeReply::Inputs { recipe: 0, answers: Vec::new() }]
        };
        if self.recipes.len() >= MOST_RECIPES {
            return refused("a connection has at most 255 recipes");
        }
        if names.len() > MOST_FIELDS {
            return refused("more fields than an answer holds");
        }
        let found: Vec<Result<(usize, FieldType), Denied>> =
            names.iter().map(|name| inputs.free(name, self.owner)).collect();
        let answers: Vec<FieldAnswer> = found
            .iter()
            .map(|found| match found {
                Ok((_, kind)) => FieldAnswer::Type(*kind),
                Err(Denied::NotFound) => FieldAnswer::NotFound,
                Err(Denied::InUse) => FieldAnswer::InUse,
            })
            .collect();
        if !fits(&answers) {
            return refused("the answer is longer than a package");
        }
        let mut id = 0;
        let whole = found.into_iter().collect::<Result<Vec<_>, _>>().ok().filter(|whole| !whole.is_empty());
        if let Some(whole) = whole {
            id = u8::try_from(self.recipes.len() + 1).unwrap_or(0);
            let (slots, types): (Vec<usize>, Vec<FieldType>) = whole.into_iter().unzip();
            inputs.claim(&slots, self.owner);
            self.recipes.push(ClaimedInputs { recipe: RtdeRecipe { id, types }, slots });
        }
        vec![RtdeReply::Inputs { recipe: id, answers }]
    }

    fn data(&mut self, id: u8, fields: &[u8], world: &mut World) -> Vec<RtdeReply> {
        let index = usize::from(id).checked_sub(1);
        let Some(known) = index.and_then(|index| self.recipes.get(index)) else {
            return vec![self.complaint(format!("there is no input recipe {id}"))];
        };
        let values = match known.recipe.read(fields) {
            Ok(values) => values,
            Err(misfit) => return vec![self.complaint(misfit.to_string())],
        };
        let cycle = world.robot.cycle;
        for (slot, value) in known.slots.iter().zip(values) {
            world.inputs.set(*slot, value, cycle);
        }
        for slot in &known.slots {
            if let Some((name, ..)) = foretrace_ur::rtde::fields::INPUTS.get(*slot) {
                world.apply_input(name);
            }
        }
        Vec::new()
    }
}

/// Whether an answer with these words fits into a package, with a recipe's number and commas between them.
fn fits(answers: &[FieldAnswer]) -> bool {
    let words: usize = answers.iter().map(|answer| answer.word().len() + 1).sum();
    words + HEADER < LARGEST
}
