//! Strings. Positions count bytes from 0.
//!
//! *Source*: script manual, `str_...`, `to_num` and `to_str` of the module "internals".

use super::super::limits;
use super::super::value::Value;
use super::{integer, value};

fn text(arguments: &[Value], at: usize) -> Result<&[u8], String> {
    let value = value(arguments, at);
    value.as_bytes().ok_or_else(|| format!("wants a string, not {}", value.kind()))
}

/// A string within the bound of strings that are made.
fn bounded(text: &[u8]) -> Result<Value, String> {
    if text.len() > limits::MADE_STRING_BYTES {
        return Err(format!("makes a string longer than {} bytes", limits::MADE_STRING_BYTES));
    }
    Ok(Value::bytes(text))
}

fn position(arguments: &[Value], at: usize) -> Result<usize, String> {
    usize::try_from(integer(arguments, at)?).map_err(|_| "wants no negative position".to_owned())
}

/// Appends a value as `str_cat` and `to_str` write it: floats with 6 decimals, less the zeros at their end.
fn write(value: &Value, to: &mut Vec<u8>) -> Result<(), String> {
    let float = |float: f64, to: &mut Vec<u8>| {
        if float.is_nan() {
            return to.extend_from_slice(b"nan");
        }
        let written = format!("{float:.6}");
        let short =
            if float.is_finite() { written.trim_end_matches('0').trim_end_matches('.') } else { &written };
        to.extend_from_slice(short.as_bytes());
    };
    match value {
        Value::Float(number) => float(*number, to),
        Value::Text(text) => to.extend_from_slice(text),
        Value::Bool(_) | Value::Integer(_) => to.extend_from_slice(value.to_string().as_bytes()),
        Value::Pose(numbers) => {
            to.extend_from_slice(b"p[");
            for (at, number) in numbers.iter().enumerate() {
                if at > 0 {
                    to.extend_from_slice(b", ");
                }
                float(*number, to);
            }
            to.push(b']');
        }
        Value::List(list) => {
            to.push(b'[');
            for (at, item) in list.items().iter().enumerate() {
                if at > 0 {
                    to.extend_from_slice(b", ");
                }
                write(item, to)?;
                // Too long already, whatever follows.
                if to.len() > limits::MADE_STRING_BYTES {
                    return Ok(());
                }
            }
            to.push(b']');
        }
        Value::None | Value::Thread(_) => return Err(format!("cannot write {}", value.kind())),
    }
    Ok(())
}

/// Both sides as they are written; they need not be strings.
pub(super) fn str_cat(arguments: &[Value]) -> Result<Value, String> {
    let mut written = Vec::new();
    write(value(arguments, 0), &mut written)?;
    write(value(arguments, 1), &mut written)?;
    bounded(&written)
}

pub(super) fn to_str(arguments: &[Value]) -> Result<Value, String> {
    let mut written = Vec::new();
    write(value(arguments, 0), &mut written)?;
    bounded(&written)
}

/// A float where there is a point, an exponent, an infinity or no number (`nan`); else an integer, decimal or
/// hexadecimal.
pub(super) fn to_num(arguments: &[Value]) -> Result<Value, String> {
    let none = || "wants a string with a number".to_owned();
    let too_large = || "wants a number that its type can hold".to_owned();
    let written = std::str::from_utf8(text(arguments, 0)?).map_err(|_| none())?.trim();
    let (negative, digits) = match written.strip_prefix(['+', '-']) {
        Some(digits) => (written.starts_with('-'), digits),
        None => (false, written),
    };
    let hexadecimal = digits.strip_prefix("0x").or(digits.strip_prefix("0X"));
    let (radix, digits) = hexadecimal.map_or((10, digits), |digits| (16, digits));
    if !digits.is_empty() && digits.chars().all(|digit| digit.is_digit(radix)) {
        let whole = i64::from_str_radix(digits, radix).map_err(|_| too_large())?;
        let whole = if negative { -whole } else { whole };
        return i32::try_from(whole).map(Value::Integer).map_err(|_| too_large());
    }
    // A second sign, and a point or exponent of a hexadecimal number, are none of a number.
    if hexadecimal.is_some() || digits.starts_with(['+', '-']) {
        return Err(none());
    }
    match written.parse::<f64>() {
        Ok(float) if float.is_infinite() && digits.contains(|c: char| c.is_ascii_digit()) => Err(too_large()),
        Ok(float) => Ok(Value::Float(float)),
        Err(_) => Err(none()),
    }
}

pub(super) fn str_len(arguments: &[Value]) -> Result<Value, String> {
    Ok(Value::integer(i64::try_from(text(arguments, 0)?.len()).unwrap_or(i64::MAX)))
}

pub(super) fn str_empty(arguments: &[Value]) -> Result<Value, String> {
    Ok(Value::Bool(text(arguments, 0)?.is_empty()))
}

pub(super) fn str_at(arguments: &[Value]) -> Result<Value, String> {
    let at = position(arguments, 1)?;
    let byte = text(arguments, 0)?.get(at).ok_or_else(|| format!("has no byte {at}"))?;
    Ok(Value::bytes(&[*byte]))
}

/// Where `target` begins, or -1.
pub(super) fn str_find(arguments: &[Value]) -> Result<Value, String> {
    let (source, target) = (text(arguments, 0)?, text(arguments, 1)?);
    let from = if arguments.len() > 2 { position(arguments, 2)? } else { 0 };
    let rest = source.get(from..).unwrap_or_default();
    let at = if target.is_empty() {
        Some(0).filter(|_| from <= source.len())
    } else {
        rest.windows(target.len()).position(|window| window == target)
    };
    let found = at.and_then(|at| i64::try_from(from.saturating_add(at)).ok());
    Ok(found.map_or(Value::Integer(-1), Value::integer))
}

/// At most `len` bytes from `index`; to the end without `len`.
pub(super) fn str_sub(arguments: &[Value]) -> Result<Value, String> {
    let (source, from) = (text(arguments, 0)?, position(arguments, 1)?);
    let length = if arguments.len() > 2 { position(arguments, 2)? } else { usize::MAX };
    let rest = source.get(from..).ok_or_else(|| format!("wants an index up to {}", source.len()))?;
    Ok(Value::bytes(rest.get(..length).unwrap_or(rest)))
}
