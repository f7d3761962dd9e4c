//! One RTDE connection as the controller sees it: recipes, inputs, answers.
//!
//! Contract: total; what it makes of a package depends on the connection's own state and the inputs others
//! own.

use super::inputs::{Denied, InputVariables, Owner};
use super::options::ControllerOptions;
use super::outputs::OutputSource;
use super::world::World;
use foretrace_ur::primary::MessageContent;
use foretrace_ur::rtde::frames::RtdeWireError;
use foretrace_ur::rtde::recipe::RtdeRecipe;
use foretrace_ur::rtde::value::FieldType;
use foretrace_ur::rtde::wire::{
    ControllerVersion, FieldAnswer, ProtocolVersion, RtdeMessage, RtdeReply, RtdeRequest,
};

/// Longest list of names \[bytes\].
const LONGEST_NAMES: usize = 2048;
/// Recipes of inputs: what their number can say.
const MOST_RECIPES: usize = 255;
/// Longest message that is kept \[bytes\].
const LONGEST_MESSAGE: usize = 255;

/// What a connection wants to be sent.
#[derive(Debug, Default)]
pub struct OutputFeed {
    sources: Vec<OutputSource>,
    /// Times a second; `None` where it was never set up.
    frequency_hz: Option<f64>,
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
        let Some(frequency) = self.frequency_hz.filter(|_| self.started) else { return false };
        let count = |cycle: u64| (cycle as f64 * frequency / self.rate_hz).floor();
        count(cycle) > count(cycle.saturating_sub(1))
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
        self.feed.sources.iter().for_each(|source| source.read(world).put(&mut fields));
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
            RtdeRequest::Start if self.feed.frequency_hz.is_none() => {
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

    fn version(&self) -> (u32, u32) {
        (self.software.major, self.software.minor)
    }

    fn outputs(&mut self, frequency: Option<f64>, names: &[String]) -> Vec<RtdeReply> {
        self.feed.started = false;
        self.feed.frequency_hz = None;
        self.feed.sources.clear();
        let second = self.version == ProtocolVersion::V2;
        if bytes(names) > LONGEST_NAMES {
            let refused = RtdeReply::Outputs { recipe: second.then_some(0), answers: Vec::new() };
            return vec![self.complaint("the list of names is too long".to_owned()), refused];
        }
        let rate = self.feed.rate_hz;
        let frequency = frequency.unwrap_or(rate);
        let sources: Vec<Option<(OutputSource, FieldType)>> =
            names.iter().map(|name| OutputSource::of(name, self.version())).collect();
        let answers: Vec<FieldAnswer> = sources
            .iter()
            .map(|source| source.as_ref().map_or(FieldAnswer::NotFound, |(_, kind)| FieldAnswer::Type(*kind)))
            .collect();
        let whole: Option<Vec<OutputSource>> =
            sources.into_iter().map(|source| source.map(|(s, _)| s)).collect();
        let possible = frequency > 0.0 && frequency <= rate;
        let mut replies = Vec::new();
        if !possible {
            replies.push(self.complaint(format!("{frequency} Hz is not above 0 and at most {rate}")));
        }
        let mut id = 0;
        if let Some(sources) = whole.filter(|sources| possible && !sources.is_empty()) {
            self.feed.sources = sources;
            self.feed.frequency_hz = Some(frequency);
            id = 1;
        }
        replies.push(RtdeReply::Outputs { recipe: second.then_some(id), answers });
        replies
    }

    fn inputs(&mut self, names: &[String], inputs: &mut InputVariables) -> Vec<RtdeReply> {
        if bytes(names) > LONGEST_NAMES || self.recipes.len() >= MOST_RECIPES {
            let refused = RtdeReply::Inputs { recipe: 0, answers: Vec::new() };
            return vec![self.complaint("too many names or recipes".to_owned()), refused];
        }
        let found: Vec<Result<(usize, FieldType), Denied>> =
            names.iter().map(|name| inputs.free(name, self.owner)).collect();
        let answers = found
            .iter()
            .map(|found| match found {
                Ok((_, kind)) => FieldAnswer::Type(*kind),
                Err(Denied::NotFound) => FieldAnswer::NotFound,
                Err(Denied::InUse) => FieldAnswer::InUse,
            })
            .collect();
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

fn bytes(names: &[String]) -> usize {
    names.iter().map(|name| name.len() + 1).sum()
}
