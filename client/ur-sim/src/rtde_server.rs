//! One RTDE connection as the controller sees it: recipes, inputs, answers.
//!
//! Contract: total; what it makes of a package depends on the connection's own state and the inputs others
//! own.

use super::inputs::{Denied, Inputs, Owner};
use super::options::Options;
use super::outputs::Source;
use super::world::World;
use foretrace_ur::primary::Said;
use foretrace_ur::rtde::frames::WireError;
use foretrace_ur::rtde::recipe::Recipe;
use foretrace_ur::rtde::value::FieldType;
use foretrace_ur::rtde::wire::{Answer, ControllerVersion, Message, ProtocolVersion, Reply, Request};

/// Longest list of names \[bytes\].
const LONGEST_NAMES: usize = 2048;
/// Recipes of inputs: what their number can say.
const MOST_RECIPES: usize = 255;
/// Longest message that is kept \[bytes\].
const LONGEST_MESSAGE: usize = 255;

/// What a connection wants to be sent.
#[derive(Debug, Default)]
pub struct Feed {
    sources: Vec<Source>,
    /// Times a second; `None` where it was never set up.
    frequency_hz: Option<f64>,
    started: bool,
    rate_hz: f64,
}

/// A connection.
#[derive(Debug)]
pub struct Session {
    owner: Owner,
    software: ControllerVersion,
    version: ProtocolVersion,
    recipes: Vec<InputRecipe>,
    /// What it wants to be sent.
    pub feed: Feed,
}

#[derive(Debug)]
struct InputRecipe {
    recipe: Recipe,
    slots: Vec<usize>,
}

impl Feed {
    /// Whether a package is due in `cycle`.
    #[must_use]
    pub fn due(&self, cycle: u64) -> bool {
        let Some(frequency) = self.frequency_hz.filter(|_| self.started) else { return false };
        let count = |cycle: u64| (cycle as f64 * frequency / self.rate_hz).floor();
        count(cycle) > count(cycle.saturating_sub(1))
    }
}

impl Session {
    /// A new connection, in version 1 of the protocol.
    #[must_use]
    pub fn new(owner: Owner, options: &Options) -> Self {
        let rate_hz = f64::from(options.series.rate_hz());
        let feed = Feed { rate_hz, ..Feed::default() };
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
        Reply::Data { recipe, fields }.encode(self.version).ok()
    }

    /// Answers one package.
    pub fn answer(&mut self, kind: u8, payload: &[u8], world: &mut World) -> Vec<Vec<u8>> {
        let version = self.version;
        let replies = match Request::decode(kind, payload, version) {
            Ok(request) => self.reply(request, world),
            Err(WireError::Type(kind)) => vec![self.complaint(format!("unknown package type {kind}"))],
            Err(error) => vec![self.complaint(error.to_string())],
        };
        replies.iter().filter_map(|reply| reply.encode(version).ok()).collect()
    }

    fn complaint(&self, text: String) -> Reply {
        Reply::Message(Message { level: 1, text, source: "RTDE".to_owned() })
    }

    fn reply(&mut self, request: Request, world: &mut World) -> Vec<Reply> {
        match request {
            Request::Protocol(number) => {
                let version = ProtocolVersion::from_number(number);
                self.version = version.unwrap_or(self.version);
                vec![Reply::Protocol(version.is_some())]
            }
            Request::ControllerVersion => vec![Reply::ControllerVersion(self.software)],
            Request::Message(message) => {
                let text: String = message.text.chars().take(LONGEST_MESSAGE).collect();
                world.say(Said::Text(text));
                Vec::new()
            }
            Request::Outputs { frequency, names } => self.outputs(frequency, &names),
            Request::Inputs { names } => self.inputs(&names, &mut world.inputs),
            Request::Start if self.feed.frequency_hz.is_none() => {
                vec![self.complaint("no outputs are set up".to_owned()), Reply::Start(false)]
            }
            Request::Start => {
                self.feed.started = true;
                vec![Reply::Start(true)]
            }
            Request::Pause => {
                self.feed.started = false;
                vec![Reply::Pause(true)]
            }
            Request::Data { recipe, fields } => self.data(recipe, &fields, world),
        }
    }

    fn version(&self) -> (u32, u32) {
        (self.software.major, self.software.minor)
    }

    fn outputs(&mut self, frequency: Option<f64>, names: &[String]) -> Vec<Reply> {
        self.feed.started = false;
        self.feed.frequency_hz = None;
        self.feed.sources.clear();
        let second = self.version == ProtocolVersion::V2;
        if bytes(names) > LONGEST_NAMES {
            let refused = Reply::Outputs { recipe: second.then_some(0), answers: Vec::new() };
            return vec![self.complaint("the list of names is too long".to_owned()), refused];
        }
        let rate = self.feed.rate_hz;
        let frequency = frequency.unwrap_or(rate);
        let sources: Vec<Option<(Source, FieldType)>> =
            names.iter().map(|name| Source::of(name, self.version())).collect();
        let answers: Vec<Answer> = sources
            .iter()
            .map(|source| source.as_ref().map_or(Answer::NotFound, |(_, kind)| Answer::Type(*kind)))
            .collect();
        let whole: Option<Vec<Source>> = sources.into_iter().map(|source| source.map(|(s, _)| s)).collect();
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
        replies.push(Reply::Outputs { recipe: second.then_some(id), answers });
        replies
    }

    fn inputs(&mut self, names: &[String], inputs: &mut Inputs) -> Vec<Reply> {
        if bytes(names) > LONGEST_NAMES || self.recipes.len() >= MOST_RECIPES {
            let refused = Reply::Inputs { recipe: 0, answers: Vec::new() };
            return vec![self.complaint("too many names or recipes".to_owned()), refused];
        }
        let found: Vec<Result<(usize, FieldType), Denied>> =
            names.iter().map(|name| inputs.free(name, self.owner)).collect();
        let answers = found
            .iter()
            .map(|found| match found {
                Ok((_, kind)) => Answer::Type(*kind),
                Err(Denied::NotFound) => Answer::NotFound,
                Err(Denied::InUse) => Answer::InUse,
            })
            .collect();
        let mut id = 0;
        let whole = found.into_iter().collect::<Result<Vec<_>, _>>().ok().filter(|whole| !whole.is_empty());
        if let Some(whole) = whole {
            id = u8::try_from(self.recipes.len() + 1).unwrap_or(0);
            let (slots, types): (Vec<usize>, Vec<FieldType>) = whole.into_iter().unzip();
            inputs.claim(&slots, self.owner);
            self.recipes.push(InputRecipe { recipe: Recipe { id, types }, slots });
        }
        vec![Reply::Inputs { recipe: id, answers }]
    }

    fn data(&mut self, id: u8, fields: &[u8], world: &mut World) -> Vec<Reply> {
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
