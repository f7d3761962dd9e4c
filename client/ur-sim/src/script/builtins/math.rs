//! Numbers: the manual's module `urmath`. Angles in \[rad\]. Where a function has no value it fails.

use super::super::value::Value;
use super::number;

/// A float, if the function has a value there.
fn float(result: f64) -> Result<Value, String> {
    if result.is_nan() { Err("has no value there".to_owned()) } else { Ok(Value::Float(result)) }
}

/// A function of one number.
pub(super) fn one(arguments: &[Value], of: fn(f64) -> f64) -> Result<Value, String> {
    float(of(number(arguments, 0)?))
}

/// A function of two numbers.
pub(super) fn two(arguments: &[Value], of: fn(f64, f64) -> f64) -> Result<Value, String> {
    float(of(number(arguments, 0)?, number(arguments, 1)?))
}

/// A function of one number that gives an integer, or a float where 32 bits are too few.
pub(super) fn whole(arguments: &[Value], of: fn(f64) -> f64) -> Result<Value, String> {
    one(arguments, of).map(|value| value.as_integer().map_or(value, Value::Integer))
}
