//! Reloading: which changes of a configuration may take effect while the arm follows.

use std::collections::BTreeMap;

use crate::config::Config;
use crate::layers::table;
use crate::schema::{Change, Section};
use crate::settings::Settings;

/// One key whose value differs; values as TOML, `None`: not set.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeyChange {
    pub key: String,
    pub from: Option<String>,
    pub to: Option<String>,
}

/// A change that may be applied to the running daemon.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveChange {
    /// The keys that differ; empty when nothing does.
    pub keys: Vec<KeyChange>,
    /// The settings after the change.
    pub settings: Settings,
}

/// A key that only takes effect when the daemon starts.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "key `{}` takes effect only when the daemon starts (in force: {}, wanted: {}): \
     restart it, or change the key back",
    .0.key, shown(.0.from.as_deref()), shown(.0.to.as_deref())
)]
pub struct StartOnlyKey(pub KeyChange);

impl Config {
    /// The changes from `self`, which is in force, to `new`.
    ///
    /// # Errors
    ///
    /// Every changed key that needs a restart; then nothing may be applied.
    pub fn live_diff(&self, new: &Self) -> Result<LiveChange, Vec<StartOnlyKey>> {
        let (before, after) = (values(self.settings()), values(new.settings()));
        let mut keys = Vec::new();
        let mut refused = Vec::new();
        for key in &table().keys {
            let (from, to) =
                (before.get(&key.path).cloned().flatten(), after.get(&key.path).cloned().flatten());
            if from != to {
                let change = KeyChange { key: key.path.clone(), from, to };
                match key.change {
                    Change::Live => keys.push(change),
                    Change::AtStart => refused.push(StartOnlyKey(change)),
                }
            }
        }
        if refused.is_empty() && self.robot() != new.robot() {
            // The same path, but the file says something else now.
            let path = new.settings().robot.urdf.clone();
            let (from, to) = (Some(format!("{path} as loaded")), Some(format!("{path} as it is now")));
            refused.push(StartOnlyKey(KeyChange { key: "robot.urdf".to_owned(), from, to }));
        }
        if refused.is_empty() && self.models() != new.models() {
            let (from, to) =
                (Some("networks as loaded".to_owned()), Some("their files as they are now".to_owned()));
            refused.push(StartOnlyKey(KeyChange { key: "predictor.lstm".to_owned(), from, to }));
        }
        if refused.is_empty() && self.prior() != new.prior() {
            let (from, to) =
                (Some("weights as loaded".to_owned()), Some("their file as it is now".to_owned()));
            refused.push(StartOnlyKey(KeyChange { key: "predictor.refine.prior".to_owned(), from, to }));
        }
        if refused.is_empty() {
            Ok(LiveChange { keys, settings: new.settings().clone() })
        } else {
            Err(refused)
        }
    }
}

/// Every key with its value as TOML.
pub(crate) fn values(settings: &Settings) -> BTreeMap<String, Option<String>> {
    let mut all = BTreeMap::new();
    settings.write("", &mut |key, value| {
        all.insert(key, value);
    });
    all
}

fn shown(value: Option<&str>) -> &str {
    value.unwrap_or("not set")
}
