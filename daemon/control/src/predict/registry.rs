//! `PredictorKind`: one of the predictors, and its entry in the registry.
//!
//! Contract: [`REGISTRY`] is the only list of predictors. Panel, settings, requests, reports, lab, benches
//! and tests use [`PredictorKind::ALL`] or [`PredictorKind::LIVE`], so that a new predictor needs one line in
//! the registry. Its name is its identity outside of this process and never changes its meaning. Its index is
//! valid for this build only.

use std::fmt;

use super::member::{AnyPredictor, Member, OfflineMember, OnlineMember};
use super::models::REGISTRY;
use super::online::WeightsError;
use super::taught::{Learning, ListedPredictor, OnlinePredictor};
use super::{Models, OnlineWeights, Predictor};
use crate::state::{Blank, Reader, State, StateError, Writer};

/// Bytes of the longest name, for which messages have room.
pub const LONGEST_NAME: usize = 24;

/// What a predictor needs besides the pen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Needs {
    /// Nothing: it can always be chosen.
    Nothing,
    /// A network trained offline.
    Network,
    /// The recorded future: experiments only.
    Recording,
    /// Another process that predicts; a built-in predictor stands in for it.
    Process,
}

/// A predictor that consists of a network.
pub trait NetworkPredictor: Predictor + State + Clone + fmt::Debug + Send + Sync + Sized + 'static {
    /// The predictor with empty memory, if its network was loaded.
    fn of(models: &Models) -> Option<Self>;
}

/// A member with empty memory; `None` if its requirements are missing.
type BuildFn = fn(&Models, &OnlineWeights) -> Result<Option<Box<dyn Member>>, WeightsError>;

/// The learner of a model, as a predictor.
type LearnerFn = fn(&Models, &OnlineWeights) -> Result<Box<dyn AnyPredictor>, WeightsError>;

/// A line of the registry.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    name: &'static str,
    about: &'static str,
    needs: Needs,
    build: BuildFn,
    /// Only for predictors that learn.
    learner: Option<LearnerFn>,
    has: fn(&Models) -> bool,
}

impl Entry {
    /// A predictor that needs the pen only. `name`: lower-case letters, digits and hyphens, at most
    /// [`LONGEST_NAME`] bytes; `about`: half a sentence for the settings' documentation.
    #[must_use]
    pub const fn plain<P>(name: &'static str, about: &'static str) -> Self
    where
        P: Predictor + State + Default + Clone + fmt::Debug + Send + Sync + 'static,
    {
        let build: BuildFn = |_, _| Ok(Some(Box::new(OfflineMember(P::default()))));
        Self { name, about, needs: Needs::Nothing, build, learner: None, has: |_| true }
    }

    /// A predictor that learns online.
    #[must_use]
    pub const fn taught<P: ListedPredictor>(about: &'static str) -> Self {
        let build: BuildFn = |models, weights| {
            let predictor = P::predictor(models, P::part(weights))?;
            Ok(Some(Box::new(OnlineMember(predictor))))
        };
        let learner: LearnerFn =
            |models, weights| Ok(Box::new(Learning(P::learner(models, P::part(weights))?)));
        let needs = Needs::Nothing;
        Self { name: P::NAME, about, needs, build, learner: Some(learner), has: |_| true }
    }

    /// A predictor that consists of a network.
    #[must_use]
    pub const fn trained<P: NetworkPredictor>(name: &'static str, about: &'static str) -> Self {
        let build: BuildFn = |models, _| {
            Ok(P::of(models).map(|predictor| -> Box<dyn Member> { Box::new(OfflineMember(predictor)) }))
        };
        let has = |models: &Models| P::of(models).is_some();
        Self { name, about, needs: Needs::Network, build, learner: None, has }
    }

    /// A predictor that replays a recording, which is loaded later.
    #[must_use]
    pub const fn recorded(name: &'static str, about: &'static str) -> Self {
        Self { name, about, needs: Needs::Recording, build: |_, _| Ok(None), learner: None, has: |_| true }
    }

    /// The predictor of another process. No member of a panel: the previewer asks for it.
    #[must_use]
    pub const fn external(name: &'static str, about: &'static str) -> Self {
        Self { name, about, needs: Needs::Process, build: |_, _| Ok(None), learner: None, has: |_| true }
    }

    /// Builds it as a member of a panel.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit.
    pub(super) fn build(
        &self,
        models: &Models,
        weights: &OnlineWeights,
    ) -> Result<Option<Box<dyn Member>>, WeightsError> {
        (self.build)(models, weights)
    }
}

/// One of the predictors, by its index in [`REGISTRY`].
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct PredictorKind(u8);

impl State for PredictorKind {
    fn save(&self, to: &mut Writer<'_>) {
        to.put(&[self.0]);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        self.0 = from.mark((REGISTRY.len() - 1) as u8)?;
        Ok(())
    }
}

impl Blank for PredictorKind {
    fn blank() -> Self {
        Self::HOLD
    }
}

/// Whether a list of predictors of a running loop has `entry`; `other_process`: those of other processes too.
const fn runs(entry: &Entry, other_process: bool) -> bool {
    match entry.needs {
        Needs::Nothing | Needs::Network => true,
        Needs::Process => other_process,
        Needs::Recording => false,
    }
}

/// How many that are.
const fn running(other_process: bool) -> usize {
    let (mut count, mut rest) = (0, REGISTRY);
    while let [first, others @ ..] = rest {
        count += runs(first, other_process) as usize;
        rest = others;
    }
    count
}

/// All `N` of them, in the order of the registry.
const fn list<const N: usize>(other_process: bool) -> [PredictorKind; N] {
    let mut all = [PredictorKind(0); N];
    let (mut room, mut rest, mut index): (&mut [PredictorKind], _, _) = (&mut all, REGISTRY, 0);
    while let [entry, others @ ..] = rest {
        if runs(entry, other_process)
            && let [first, left @ ..] = room
        {
            first.0 = index;
            room = left;
        }
        index += 1;
        rest = others;
    }
    all
}

const fn names<const N: usize>(mut kinds: &[PredictorKind]) -> [&'static str; N] {
    let mut names = [""; N];
    let mut room: &mut [&str] = &mut names;
    while let ([name, left @ ..], [kind, others @ ..]) = (room, kinds) {
        *name = kind.name();
        (room, kinds) = (left, others);
    }
    names
}

// Constants for predictors that code names; others need none.
impl PredictorKind {
    /// The paper's conservative model, and the fallback of all others.
    pub const HOLD: Self = known("hold");
    /// The baseline of the paper's Table 1.
    pub const CONSTANT_VELOCITY: Self = known("constant-velocity");
    /// The predictor of the paper, a linear DyBM.
    pub const DYBM: Self = known("dybm");
    /// The recorded future, for experiments.
    pub const ORACLE: Self = known("oracle");
    /// The network that was trained offline.
    pub const LSTM: Self = known("lstm");
    /// The paper's predictor with a reservoir.
    pub const DYBM_ESN: Self = known("dybm-esn");
    /// Autoregression by recursive least squares.
    pub const AR_RLS: Self = known("ar-rls");
    /// The predictor of the presets.
    pub const MIXTURE: Self = known("mixture");
    /// The predictor of another process.
    pub const EXTERNAL: Self = known("external");
}

impl PredictorKind {
    /// Every predictor, in the order of the registry.
    pub const ALL: [Self; REGISTRY.len()] = {
        let mut all = [Self(0); REGISTRY.len()];
        let mut rest: &mut [Self] = &mut all;
        let mut index = 0;
        while let [first, others @ ..] = rest {
            first.0 = index;
            index += 1;
            rest = others;
        }
        all
    };

    /// Those available in a running loop: all that need no recording.
    pub const LIVE: [Self; running(true)] = list(true);

    /// Names of [`Self::LIVE`].
    pub const LIVE_NAMES: [&'static str; running(true)] = names(&Self::LIVE);

    /// Those of them that this process runs itself.
    pub const BUILT_IN: [Self; running(false)] = list(false);

    /// Names of [`Self::BUILT_IN`].
    pub const BUILT_IN_NAMES: [&'static str; running(false)] = names(&Self::BUILT_IN);

    /// Index in [`Self::ALL`].
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// Name in settings, requests and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.entry().name
    }

    /// What it does, in half a sentence.
    #[must_use]
    pub const fn about(self) -> &'static str {
        self.entry().about
    }

    /// What it needs besides the pen.
    #[must_use]
    pub const fn needs(self) -> Needs {
        self.entry().needs
    }

    /// Whether it learns online.
    #[must_use]
    pub const fn learns(self) -> bool {
        self.entry().learner.is_some()
    }

    /// The predictor by itself, with empty memory; `None` if its requirements are missing.
    ///
    /// # Errors
    ///
    /// Weights that are invalid or do not fit.
    pub fn predictor(
        self,
        models: &Models,
        weights: &OnlineWeights,
    ) -> Result<Option<Box<dyn AnyPredictor>>, WeightsError> {
        let member = self.entry().build(models, weights)?;
        Ok(member.map(|member| -> Box<dyn AnyPredictor> { member }))
    }

    /// The same, learning from every observation; `None` if it does not learn.
    ///
    /// # Errors
    ///
    /// Settings outside their bounds, or weights that are invalid or do not fit.
    pub fn learner(
        self,
        models: &Models,
        weights: &OnlineWeights,
    ) -> Result<Option<Box<dyn AnyPredictor>>, WeightsError> {
        self.entry().learner.map(|learner| learner(models, weights)).transpose()
    }

    /// Whether `models` have its requirements, apart from a recording.
    #[must_use]
    pub(super) fn is_in(self, models: &Models) -> bool {
        (self.entry().has)(models)
    }

    /// What the predictor or table row that earlier versions called `name` is called now; `None`: it was
    /// never called otherwise.
    #[must_use]
    pub fn current_name(name: &str) -> Option<&'static str> {
        Some(match name {
            "ours" => Self::MIXTURE.name(),
            "zero" => Self::HOLD.name(),
            "dybm-online" => Self::DYBM.name(),
            "dybm-esn-online" => Self::DYBM_ESN.name(),
            "lstm10" => Self::LSTM.name(),
            _ if name.starts_with("ours-") => Self::MIXTURE.name(),
            _ => return None,
        })
    }

    /// Hint for a request with a name of earlier versions; empty for other names.
    #[must_use]
    pub fn renamed(name: &str) -> String {
        Self::current_name(name)
            .map_or_else(String::new, |now| format!(" (what was called {name} is called {now})"))
    }

    /// The predictor of that name.
    #[must_use]
    pub const fn from_name(name: &str) -> Option<Self> {
        let mut rest: &[Entry] = REGISTRY;
        let mut index = 0;
        while let [entry, others @ ..] = rest {
            if same(entry.name.as_bytes(), name.as_bytes()) {
                return Some(Self(index));
            }
            index += 1;
            rest = others;
        }
        None
    }

    const fn entry(self) -> &'static Entry {
        let (mut rest, mut left) = (REGISTRY, self.0);
        while let [entry, others @ ..] = rest {
            if left == 0 {
                return entry;
            }
            left -= 1;
            rest = others;
        }
        // Every kind is made with an index of the registry.
        &super::models::hold::ENTRY
    }
}

impl Default for PredictorKind {
    fn default() -> Self {
        Self::MIXTURE
    }
}

impl fmt::Debug for PredictorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The kind of a model that learns.
#[must_use]
pub const fn kind_of<P: OnlinePredictor>() -> PredictorKind {
    const { known(P::NAME) }
}

/// For constants: an unknown name does not compile.
#[expect(clippy::panic, reason = "runs while the law is compiled")]
const fn known(name: &str) -> PredictorKind {
    match PredictorKind::from_name(name) {
        Some(kind) => kind,
        None => panic!("no predictor of the registry has this name"),
    }
}

const fn same(a: &[u8], b: &[u8]) -> bool {
    let (mut a, mut b) = (a, b);
    while let ([x, rest_a @ ..], [y, rest_b @ ..]) = (a, b) {
        if *x != *y {
            return false;
        }
        (a, b) = (rest_a, rest_b);
    }
    a.is_empty() && b.is_empty()
}

const fn is_name(name: &[u8]) -> bool {
    let mut rest = name;
    while let [letter, others @ ..] = rest {
        if !matches!(letter, b'a'..=b'z' | b'0'..=b'9' | b'-') {
            return false;
        }
        rest = others;
    }
    !name.is_empty() && name.len() <= LONGEST_NAME
}

// Names appear in messages and files; a duplicate would make the second predictor unreachable.
const _: () = {
    assert!(REGISTRY.len() <= u8::MAX as usize, "there are too many predictors");
    let mut rest: &[Entry] = REGISTRY;
    while let [entry, others @ ..] = rest {
        assert!(is_name(entry.name.as_bytes()), "a name has 1 to 24 lower-case letters, digits and hyphens");
        let mut later: &[Entry] = others;
        while let [other, left @ ..] = later {
            assert!(!same(entry.name.as_bytes(), other.name.as_bytes()), "two predictors have the same name");
            later = left;
        }
        rest = others;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_its_place_and_its_name() {
        for (index, kind) in PredictorKind::ALL.into_iter().enumerate() {
            assert_eq!((kind.index(), PredictorKind::from_name(kind.name())), (index, Some(kind)));
            assert_eq!(format!("{kind:?}"), kind.name());
        }
        for nobody in ["", "hol", "holdd", "Hold", "hold\0"] {
            assert_eq!(PredictorKind::from_name(nobody), None, "{nobody:?}");
        }
    }

    #[test]
    fn all_but_the_oracle_are_live() {
        let live: Vec<_> =
            PredictorKind::ALL.into_iter().filter(|kind| kind.needs() != Needs::Recording).collect();
        assert_eq!(PredictorKind::LIVE.to_vec(), live);
        assert_eq!(live.len() + 1, PredictorKind::ALL.len());
    }

    #[test]
    fn names_are_short_words_of_messages_and_files() {
        assert!(is_name(b"ar-rls") && is_name(&[b'a'; LONGEST_NAME]));
        for wrong in [&b""[..], b"Hold", b"a b", b"\xc3\xa9", &[b'a'; LONGEST_NAME + 1]] {
            assert!(!is_name(wrong), "{wrong:?}");
        }
    }
}
