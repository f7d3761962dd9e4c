//! Strings. Positions count letters from 0.

use super::super::limits;
use super::super::value::Value;
use super::{integer, value};

fn text(arguments: &[Value], at: usize) -> Result<&str, String> {
    let value = value(arguments, at);
    value.as_text().ok_or_else(|| format!("wants a string, not {}", value.kind()))
}

/// A string within its bound.
fn bounded(text: &str) -> Result<Value, String> {
    if text.len() > limits::STRING_BYTES {
        return Err(format!("makes a string longer than {} bytes", limits::STRING_BYTES));
    }
    Ok(Value::text(text))
}

fn position(arguments: &[Value], at: usize) -> Result<usize, String> {
    usize::try_from(integer(arguments, at)?).map_err(|_| "wants no negative position".to_owned())
}

/// Both sides as they are written; they need not be strings.
pub(super) fn str_cat(arguments: &[Value]) -> Result<Value, String> {
    bounded(&format!("{}{}", value(arguments, 0), value(arguments, 1)))
}

pub(super) fn to_str(arguments: &[Value]) -> Result<Value, String> {
    bounded(&value(arguments, 0).to_string())
}

/// An integer or a float, as it is written.
pub(super) fn to_num(arguments: &[Value]) -> Result<Value, String> {
    let written = text(arguments, 0)?.trim();
    if let Ok(integer) = written.parse() {
        return Ok(Value::Integer(integer));
    }
    match written.parse::<f64>() {
        Ok(float) if float.is_finite() => Ok(Value::Float(float)),
        _ => Err("wants a string with a number".to_owned()),
    }
}

pub(super) fn str_len(arguments: &[Value]) -> Result<Value, String> {
    Ok(Value::integer(i64::try_from(text(arguments, 0)?.chars().count()).unwrap_or(i64::MAX)))
}

pub(super) fn str_empty(arguments: &[Value]) -> Result<Value, String> {
    Ok(Value::Bool(text(arguments, 0)?.is_empty()))
}

pub(super) fn str_at(arguments: &[Value]) -> Result<Value, String> {
    let at = position(arguments, 1)?;
    let letter = text(arguments, 0)?.chars().nth(at).ok_or_else(|| format!("has no letter {at}"))?;
    Ok(Value::text(&letter.to_string()))
}

/// Where `target` begins, or -1.
pub(super) fn str_find(arguments: &[Value]) -> Result<Value, String> {
    let (source, target) = (text(arguments, 0)?, text(arguments, 1)?);
    let from = if arguments.len() > 2 { position(arguments, 2)? } else { 0 };
    let start = source.char_indices().nth(from).map_or(source.len(), |(at, _)| at);
    let rest = source.get(start..).unwrap_or_default();
    let letters = rest.find(target).and_then(|at| rest.get(..at)).map(|before| before.chars().count());
    let found = letters.and_then(|letters| i64::try_from(from.saturating_add(letters)).ok());
    Ok(found.map_or(Value::Integer(-1), Value::integer))
}

/// `len` letters from `index`; to the end without `len`.
pub(super) fn str_sub(arguments: &[Value]) -> Result<Value, String> {
    let (source, from) = (text(arguments, 0)?, position(arguments, 1)?);
    let length = match arguments.get(2) {
        Some(length) if length.as_integer().is_some_and(|length| length < 0) => usize::MAX,
        Some(_) => position(arguments, 2)?,
        None => usize::MAX,
    };
    Ok(Value::text(&source.chars().skip(from).take(length).collect::<String>()))
}
