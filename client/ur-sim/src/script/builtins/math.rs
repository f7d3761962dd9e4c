//! Numbers: the manual's module `urmath`. Angles in \[rad\]. Where a function has no value it fails.

use super::super::value::Value;
use super::number;

/// A float, if the function has a value there.
fn float(result: f64) -> Result<Value, String> {
    if result.is_nan() { Err("has no value there".to_owned()) } else { Ok(Value::Float(result)) }
}

pub(super) fn acos(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.acos())
}

pub(super) fn asin(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.asin())
}

pub(super) fn atan(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.atan())
}

/// The manual's x stands over its y.
pub(super) fn atan2(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.atan2(number(arguments, 1)?))
}

pub(super) fn cos(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.cos())
}

pub(super) fn sin(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.sin())
}

pub(super) fn tan(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.tan())
}

pub(super) fn d2r(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.to_radians())
}

pub(super) fn r2d(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.to_degrees())
}

pub(super) fn sqrt(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.sqrt())
}

pub(super) fn pow(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 0)?.powf(number(arguments, 1)?))
}

/// The logarithm of `f` to the base `b`.
pub(super) fn log(arguments: &[Value]) -> Result<Value, String> {
    float(number(arguments, 1)?.log(number(arguments, 0)?))
}

pub(super) fn ceil(arguments: &[Value]) -> Result<Value, String> {
    whole(number(arguments, 0)?.ceil())
}

pub(super) fn floor(arguments: &[Value]) -> Result<Value, String> {
    whole(number(arguments, 0)?.floor())
}

/// An integer, or the float where 32 bits are too few.
fn whole(result: f64) -> Result<Value, String> {
    float(result).map(|value| value.as_integer().map_or(value, Value::Integer))
}
