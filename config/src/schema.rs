//! The table of keys: each key is declared once; reading, checking, showing and documentation follow from it.
//!
//! Contract: a `section!` declares a struct of settings *as meant* together with the rule for each key *as
//! written* (legal range, needed or not, live or only at start, a good starting point). The unit is the
//! suffix of the name.

use std::collections::BTreeMap;

use crate::nearest::unit_of;
use crate::problem::{Problem, ProblemKind};
use crate::value::SettingValue;
use crate::written::{Node, SettingOrigin};

/// What a key accepts; for a list, what each element accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Legal {
    /// A finite number from the first to the second, both included.
    Between(f64, f64),
    /// One of these numbers.
    OneOf(&'static [f64]),
    /// One of these words.
    Words(&'static [&'static str]),
    /// `true` or `false`.
    Flag,
    /// Any text that is not empty.
    Text,
}

/// Whether a key must be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Presence {
    /// By the file or its preset: what has to be tuned per installation has no default.
    Required,
    /// Otherwise this value (as TOML).
    Default(&'static str),
    /// May be absent; the meaning says what happens then.
    Optional,
}

/// When a new value takes effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// On reload, while the arm follows.
    Live,
    /// Only when the daemon starts.
    AtStart,
}

/// One key of a section, relative to it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KeySpec {
    pub(crate) name: &'static str,
    pub(crate) meaning: &'static str,
    pub(crate) legal: Legal,
    pub(crate) presence: Presence,
    pub(crate) change: Change,
    pub(crate) start_with: &'static str,
}

/// One key of a settings file.
#[derive(Debug, Clone)]
pub struct Key {
    /// Section, for example `mpc.limits.x`.
    pub section: String,
    /// Full name, for example `mpc.limits.x.jerk_mps3`.
    pub path: String,
    pub meaning: String,
    /// Unit, or nothing for a plain number.
    pub unit: &'static str,
    pub legal: Legal,
    /// Shape and range in words, for example `3 numbers, -10 to 10 m`.
    pub legal_text: String,
    /// Whether it must be written.
    pub presence: Presence,
    /// When a change takes effect.
    pub change: Change,
    /// A good starting point, and why.
    pub start_with: &'static str,
}

/// A section as meant: made by `section!`.
pub(crate) trait Section: Sized {
    /// Reads every key under `at`; `None` when one of them is a problem (which is then in `reader`).
    fn read(reader: &mut SectionReader<'_>, at: &str) -> Option<Self>;
    /// Calls `entry` with every key under `at` and its value as TOML (`None`: not set), in the order of
    /// declaration.
    fn write(&self, at: &str, entry: &mut dyn FnMut(String, Option<String>));
    /// Pushes the section under `at` with its title, then its keys, then its subsections.
    fn describe(at: &str, table: &mut Table);
}

/// All sections and keys.
#[derive(Debug, Clone, Default)]
pub(crate) struct Table {
    /// Name and title, in the order of declaration.
    pub(crate) sections: Vec<(String, String)>,
    pub(crate) keys: Vec<Key>,
}

impl Table {
    pub(crate) fn section(&mut self, at: &str, title: &str) {
        self.sections.push((at.to_owned(), plain(title)));
    }

    pub(crate) fn key<V: SettingValue>(&mut self, at: &str, field: &KeySpec) {
        let unit = unit_of(field.name);
        self.keys.push(Key {
            section: at.to_owned(),
            path: joined(at, field.name),
            meaning: plain(field.meaning) + &V::explained(),
            unit,
            legal: field.legal,
            legal_text: V::shape(&field.legal.text(unit)),
            presence: field.presence,
            change: field.change,
            start_with: field.start_with,
        });
    }

    pub(crate) fn find(&self, path: &str) -> Option<&Key> {
        self.keys.iter().find(|key| key.path == path)
    }
}

impl Legal {
    /// In words, with the unit.
    #[must_use]
    pub fn text(&self, unit: &str) -> String {
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        match self {
            Self::Between(min, max) => format!("{} to {}{unit}", short(*min), short(*max)),
            Self::OneOf(numbers) => {
                let all: Vec<String> = numbers.iter().map(ToString::to_string).collect();
                format!("{}{unit}", all.join(", "))
            }
            Self::Words(words) => words.iter().map(|word| format!("{word:?}")).collect::<Vec<_>>().join(", "),
            Self::Flag => "true or false".to_owned(),
            Self::Text => "text".to_owned(),
        }
    }
}

/// Very small and very large numbers are shown with an exponent.
fn short(number: f64) -> String {
    let size = number.abs();
    if size != 0.0 && !(1e-4..1e6).contains(&size) { format!("{number:e}") } else { number.to_string() }
}

/// `section.name`, or `name` at the root.
pub(crate) fn joined(section: &str, name: &str) -> String {
    if section.is_empty() { name.to_owned() } else { format!("{section}.{name}") }
}

/// A doc comment as one paragraph.
fn plain(doc: &str) -> String {
    doc.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The values to read from, and the problems found so far.
pub(crate) struct SectionReader<'a> {
    pub(crate) found: &'a BTreeMap<String, Node>,
    /// The file as a whole, for what is missing in it.
    pub(crate) whole: &'a SettingOrigin,
    pub(crate) problems: &'a mut Vec<Problem>,
}

impl SectionReader<'_> {
    /// Reads one key and checks it by its rule.
    pub(crate) fn key<V: SettingValue>(&mut self, at: &str, field: &KeySpec) -> Option<V> {
        let path = joined(at, field.name);
        let rule =
            ValueRule { key: &path, legal: field.legal, unit: unit_of(field.name), advice: field.start_with };
        if let Some(node) = self.found.get(&path) {
            return V::read(node, &rule, self.problems);
        }
        if let Some(absent) = V::absent() {
            return Some(absent);
        }
        let kind = ProblemKind::Missing {
            key: path.clone(),
            section: at.to_owned(),
            example: format!("`{} = ...`", field.name),
            legal: format!("{}; start with {}", V::shape(&field.legal.text(rule.unit)), field.start_with),
        };
        self.problems.push(Problem::new(self.whole, kind));
        None
    }
}

/// How to check one value.
#[derive(Clone, Copy)]
pub(crate) struct ValueRule<'a> {
    pub(crate) key: &'a str,
    pub(crate) legal: Legal,
    pub(crate) unit: &'static str,
    pub(crate) advice: &'static str,
}

/// Declares a struct of settings with the rules of its keys; `sections { .. }` nests others under it.
macro_rules! section {
    (
        $(#[doc = $title:literal])+
        pub struct $Name:ident {
            $(
                $(#[doc = $meaning:literal])+
                $field:ident : $Type:ty = $legal:expr, $presence:expr, $change:ident, $start:literal;
            )*
        }
        $( sections { $( $(#[doc = $about:literal])+ $sub:ident @ $at:literal : $Sub:ty; )* } )?
    ) => {
        $(#[doc = $title])+
        #[derive(Debug, Clone, PartialEq)]
        pub struct $Name {
            $( $(#[doc = $meaning])+ pub $field: $Type, )*
            $($( $(#[doc = $about])+ pub $sub: $Sub, )*)?
        }

        impl $crate::schema::Section for $Name {
            #[allow(unused_variables)]
            fn read(reader: &mut $crate::schema::SectionReader<'_>, at: &str) -> Option<Self> {
                // Every key is read before the first `?`, so that all problems are reported at once.
                $( let $field = reader.key::<$Type>(at, &$crate::schema::KeySpec {
                    name: stringify!($field), meaning: concat!($($meaning),+), legal: $legal,
                        presence: $presence,
                    change: $crate::schema::Change::$change, start_with: $start,
                }); )*
                $($( let $sub = <$Sub as $crate::schema::Section>::read(reader, &$crate::schema::joined(at,
                    $at)); )*)?
                Some(Self { $( $field: $field?, )* $($( $sub: $sub?, )*)? })
            }

            #[allow(unused_variables)]
            fn write(&self, at: &str, entry: &mut dyn FnMut(String, Option<String>)) {
                $( entry(
                    $crate::schema::joined(at, stringify!($field)),
                    $crate::value::SettingValue::write(&self.$field),
                ); )*
                $($( $crate::schema::Section::write(&self.$sub, &$crate::schema::joined(at, $at), entry); )*)?
            }

            #[allow(unused_variables)]
            fn describe(at: &str, table: &mut $crate::schema::Table) {
                table.section(at, concat!($($title),+));
                $( table.key::<$Type>(at, &$crate::schema::KeySpec {
                    name: stringify!($field), meaning: concat!($($meaning),+), legal: $legal,
                        presence: $presence,
                    change: $crate::schema::Change::$change, start_with: $start,
                }); )*
                $($( <$Sub as $crate::schema::Section>::describe(&$crate::schema::joined(at, $at),
                    table); )*)?
            }
        }
    };
}

/// Declares an enum whose variants are words in the file.
macro_rules! words {
    (
        $(#[doc = $title:literal])+
        pub enum $Name:ident { $( $(#[doc = $meaning:literal])+ $Variant:ident = $word:literal, )+ }
    ) => {
        $(#[doc = $title])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $Name { $( $(#[doc = $meaning])+ $Variant, )+ }

        impl $Name {
            /// The words in the file, in the order of the variants.
            pub const WORDS: &'static [&'static str] = &[$($word),+];

            /// The word in the file.
            #[must_use]
            pub const fn word(self) -> &'static str {
                match self { $( Self::$Variant => $word, )+ }
            }
        }

        impl $crate::value::SettingValue for $Name {
            fn read(
                node: &$crate::written::Node, rule: &$crate::schema::ValueRule<'_>,
                problems: &mut Vec<$crate::problem::Problem>,
            ) -> Option<Self> {
                match $crate::value::word(node, rule, problems)? {
                    $( $word => Some(Self::$Variant), )+
                    _ => None,
                }
            }
            fn write(&self) -> Option<String> { Some(format!("{:?}", self.word())) }
        }
    };
}

pub(crate) use {section, words};
