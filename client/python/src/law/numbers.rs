//! Lists of numbers, one per joint.

use pyo3::prelude::*;

use crate::problem::invalid;

/// Most joints of an arm for the guard and the chain.
pub const MOST_JOINTS: usize = 8;

/// Exactly `J` of them; `name` stands in the message.
pub fn per_joint<const J: usize, T: Copy>(name: &str, values: &[T]) -> PyResult<[T; J]> {
    values.try_into().map_err(|_| {
        let found = values.len();
        invalid(format_args!(
            "{name} has {found} entries; the arm has {J} joints: give one per joint, base first"
        ))
    })
}

/// As [`per_joint`], of finite numbers only.
pub fn finite_per_joint<const J: usize>(name: &str, values: &[f64]) -> PyResult<[f64; J]> {
    finite(name, values)?;
    per_joint(name, values)
}

/// Refuses NaN and infinities.
pub fn finite(name: &str, values: &[f64]) -> PyResult<()> {
    match values.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        Some((at, value)) => Err(invalid(format_args!("{name}[{at}] is {value}; legal: finite numbers"))),
        None => Ok(()),
    }
}

/// Calls `$call` with the constant number of joints `$J` that `$count` is; `None` beyond the most.
macro_rules! for_joints {
    ($count:expr, $J:ident => $call:expr) => {
        match $count {
            1 => {
                const $J: usize = 1;
                Some($call)
            }
            2 => {
                const $J: usize = 2;
                Some($call)
            }
            3 => {
                const $J: usize = 3;
                Some($call)
            }
            4 => {
                const $J: usize = 4;
                Some($call)
            }
            5 => {
                const $J: usize = 5;
                Some($call)
            }
            6 => {
                const $J: usize = 6;
                Some($call)
            }
            7 => {
                const $J: usize = 7;
                Some($call)
            }
            8 => {
                const $J: usize = 8;
                Some($call)
            }
            _ => None,
        }
    };
}
pub(crate) use for_joints;

/// The refusal of an arm of `count` joints.
pub fn too_many(count: usize) -> PyErr {
    invalid(format_args!("an arm of {count} joints; legal: 1 to {MOST_JOINTS}"))
}
