//! Values of keys: one reader and one writer per Rust type.
//!
//! Contract: `read` checks by the rule of the key and pushes one problem per wrong element; what `write`
//! gives reads back as the same value, bit for bit.

use crate::nearest::{nearest, unit_slip};
use crate::problem::{Problem, ValueFlaw};
use crate::schema::{Legal, ValueRule};
use crate::written::{Node, Raw};

pub(crate) trait SettingValue: Sized {
    /// The value of `node`, if it is legal.
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self>;
    /// As TOML; `None` for an optional key that is not set.
    fn write(&self) -> Option<String>;
    /// The value of a key that is not written, where that is legal.
    fn absent() -> Option<Self> {
        None
    }
    /// What follows the meaning of the key: every legal word in turn, where the words are not the key's own.
    fn explained() -> String {
        String::new()
    }
    /// Range and shape in words.
    fn shape(range: &str) -> String {
        range.to_owned()
    }
}

impl SettingValue for f64 {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        let value = match node.raw {
            Raw::Real(value) => value,
            Raw::Whole(value) => value as f64,
            _ => return wrong_type(node, rule, "a number", problems),
        };
        if !value.is_finite() {
            let legal = rule.legal.text(rule.unit);
            problems.push(node.flawed(rule.key, ValueFlaw::NotFinite { legal }));
            return None;
        }
        in_range(value, node, rule, problems)
    }

    fn write(&self) -> Option<String> {
        // Debug gives the shortest text that reads back as the same bits.
        Some(format!("{self:?}"))
    }
}

impl SettingValue for u32 {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        let Raw::Whole(value) = node.raw else {
            return wrong_type(node, rule, "a whole number", problems);
        };
        // The ranges of whole keys lie inside u32, so the conversion after the range test only fails for a
        // bad rule.
        in_range(value as f64, node, rule, problems).and_then(|_| u32::try_from(value).ok())
    }

    fn write(&self) -> Option<String> {
        Some(self.to_string())
    }

    fn shape(range: &str) -> String {
        format!("whole number, {range}")
    }
}

impl SettingValue for bool {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        match node.raw {
            Raw::Flag(value) => Some(value),
            _ => wrong_type(node, rule, "true or false", problems),
        }
    }

    fn write(&self) -> Option<String> {
        Some(self.to_string())
    }
}

impl SettingValue for String {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        match &node.raw {
            Raw::Text(text) if !text.trim().is_empty() => Some(text.clone()),
            _ => wrong_type(node, rule, "a text in quotes, not empty", problems),
        }
    }

    fn write(&self) -> Option<String> {
        Some(toml::Value::String(self.clone()).to_string())
    }
}

impl<V: SettingValue> SettingValue for Option<V> {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        V::read(node, rule, problems).map(Some)
    }

    fn write(&self) -> Option<String> {
        self.as_ref().and_then(SettingValue::write)
    }

    fn absent() -> Option<Self> {
        Some(None)
    }

    fn shape(range: &str) -> String {
        V::shape(range)
    }
}

impl<V: SettingValue, const N: usize> SettingValue for [V; N] {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        let wanted = Self::shape(&rule.legal.text(rule.unit));
        match &node.raw {
            Raw::List(list) if list.len() == N => elements(list, rule, problems)?.try_into().ok(),
            _ => wrong_type(node, rule, &wanted, problems),
        }
    }

    fn write(&self) -> Option<String> {
        list(self)
    }

    fn shape(range: &str) -> String {
        let each = V::shape(range);
        if each.starts_with("list") {
            format!("list of {N}, each a {each}")
        } else {
            format!("list of {N}: {each}")
        }
    }
}

impl<V: SettingValue> SettingValue for Vec<V> {
    fn read(node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<Self> {
        match &node.raw {
            Raw::List(list) if !list.is_empty() => elements(list, rule, problems),
            _ => wrong_type(node, rule, &Self::shape(&rule.legal.text(rule.unit)), problems),
        }
    }

    fn write(&self) -> Option<String> {
        list(self)
    }

    fn shape(range: &str) -> String {
        format!("list: {}", V::shape(range))
    }
}

/// The legal word in `node`.
pub(crate) fn word<'n>(node: &'n Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<&'n str> {
    let Legal::Words(words) = rule.legal else {
        return None;
    };
    let Raw::Text(text) = &node.raw else {
        return wrong_type(node, rule, &format!("one of {}", rule.legal.text("")), problems);
    };
    if words.contains(&text.as_str()) {
        return Some(text);
    }
    let hint = nearest(text, words.iter().copied());
    let hint = hint.map_or_else(String::new, |word| format!(": did you mean {word:?}?"));
    problems.push(node.flawed(rule.key, ValueFlaw::NotOneOf { legal: rule.legal.text(""), hint }));
    None
}

fn elements<V: SettingValue>(
    list: &[Node],
    rule: &ValueRule<'_>,
    problems: &mut Vec<Problem>,
) -> Option<Vec<V>> {
    let read: Vec<Option<V>> = list
        .iter()
        .enumerate()
        .map(|(i, node)| {
            let before = problems.len();
            let value = V::read(node, &ValueRule { key: &format!("{}[{i}]", rule.key), ..*rule }, problems);
            if list.iter().take(i).any(|earlier| earlier.text == node.text) {
                // The same mistake in every element is reported once.
                problems.truncate(before);
            }
            value
        })
        .collect();
    read.into_iter().collect()
}

fn list<V: SettingValue>(values: &[V]) -> Option<String> {
    let all: Option<Vec<String>> = values.iter().map(SettingValue::write).collect();
    Some(format!("[{}]", all?.join(", ")))
}

fn in_range(value: f64, node: &Node, rule: &ValueRule<'_>, problems: &mut Vec<Problem>) -> Option<f64> {
    let legal = || rule.legal.text(rule.unit);
    let flaw = match rule.legal {
        Legal::Between(min, max) if !(min..=max).contains(&value) => {
            let remedy = unit_slip(value, min, max, rule.unit)
                .unwrap_or_else(|| format!("start with {}", rule.advice));
            ValueFlaw::OutOfRange { legal: legal(), remedy }
        }
        Legal::OneOf(numbers) if !numbers.contains(&value) => {
            ValueFlaw::NotOneOf { legal: legal(), hint: format!(": start with {}", rule.advice) }
        }
        _ => return Some(value),
    };
    problems.push(node.flawed(rule.key, flaw));
    None
}

fn wrong_type<V>(node: &Node, rule: &ValueRule<'_>, wanted: &str, problems: &mut Vec<Problem>) -> Option<V> {
    let wanted = format!("{wanted} ({})", rule.legal.text(rule.unit));
    problems.push(node.flawed(rule.key, ValueFlaw::WrongType { found: node.raw.kind(), wanted }));
    None
}
