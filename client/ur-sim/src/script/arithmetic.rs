//! The operators. Between lists, and between a list and a number, they work element by element; a matrix (a
//! list of rows) times a matrix or a list is their product. Two integers give an integer, but their quotient
//! is a float.
//! *Source*: script manual, "Matrix and array expressions".

use super::limits;
use super::tree::{Binary, Unary};
use super::value::{List, Value};

/// `left operator right`.
pub(super) fn binary(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    match operator {
        Binary::And | Binary::Or | Binary::Xor => {
            let (left, right) = (truth(left)?, truth(right)?);
            Ok(Value::Bool(match operator {
                Binary::And => left && right,
                Binary::Or => left || right,
                _ => left != right,
            }))
        }
        Binary::Equal => Ok(Value::Bool(equal(left, right))),
        Binary::Differs => Ok(Value::Bool(!equal(left, right))),
        Binary::Below | Binary::BelowOrEqual | Binary::Above | Binary::AboveOrEqual => {
            let (Some(left), Some(right)) = (left.as_number(), right.as_number()) else {
                return Err(format!("{} and {} have no order", left.kind(), right.kind()));
            };
            Ok(Value::Bool(match operator {
                Binary::Below => left < right,
                Binary::BelowOrEqual => left <= right,
                Binary::Above => left > right,
                _ => left >= right,
            }))
        }
        _ => calculate(operator, left, right),
    }
}

/// `operator value`.
pub(super) fn unary(operator: Unary, value: &Value) -> Result<Value, String> {
    match operator {
        Unary::Not => Ok(Value::Bool(!truth(value)?)),
        Unary::Minus => match value {
            Value::Integer(number) => Ok(Value::integer(-i64::from(*number))),
            Value::Float(number) => Ok(Value::Float(-number)),
            Value::List(_) => calculate(Binary::Multiply, &Value::Integer(-1), value),
            other => Err(format!("{} has no negative", other.kind())),
        },
    }
}

/// A condition's truth. Numbers are none: a controller refuses them too.
pub(super) fn truth(value: &Value) -> Result<bool, String> {
    // The manual asks so whether a socket gave a string.
    if let Value::Text(text) = value {
        return Ok(!text.is_empty());
    }
    value.as_bool().ok_or_else(|| format!("a truth value wanted, not {}", value.kind()))
}

/// Numbers by what they are worth, lists element by element; values of different kinds differ.
fn equal(left: &Value, right: &Value) -> bool {
    match (left, right) {
        (Value::List(left), Value::List(right)) => {
            left.items().len() == right.items().len()
                && left.items().iter().zip(right.items()).all(|(left, right)| equal(left, right))
        }
        _ => match (left.as_number(), right.as_number()) {
            (Some(left), Some(right)) => left == right,
            _ => left == right,
        },
    }
}

fn calculate(operator: Binary, left: &Value, right: &Value) -> Result<Value, String> {
    let each = |items: Vec<Result<Value, String>>| {
        items.into_iter().collect::<Result<Vec<_>, _>>().and_then(List::new).map(Value::List)
    };
    match (left, right) {
        (Value::Integer(left), Value::Integer(right)) => integers(operator, *left, *right),
        (Value::List(left), Value::List(right)) => {
            let (left, right) = (left.items(), right.items());
            if operator == Binary::Multiply && matches!(left, [Value::List(_), ..]) {
                return product(left, right);
            }
            if left.len() != right.len() {
                return Err(format!("a list of {} and one of {} do not match", left.len(), right.len()));
            }
            each(left.iter().zip(right).map(|(left, right)| calculate(operator, left, right)).collect())
        }
        (Value::List(left), number) if number.as_number().is_some() => {
            each(left.items().iter().map(|item| calculate(operator, item, number)).collect())
        }
        (number, Value::List(right)) if number.as_number().is_some() => {
            each(right.items().iter().map(|item| calculate(operator, number, item)).collect())
        }
        _ => match (left.as_number(), right.as_number()) {
            (Some(left), Some(right)) => floats(operator, left, right),
            _ => Err(format!("{} cannot be calculated with {}", left.kind(), right.kind())),
        },
    }
}

/// The product of a matrix, as rows, with a matrix or a list.
fn product(left: &[Value], right: &[Value]) -> Result<Value, String> {
    // The elements in the position `column` of each row; the elements themselves if it is a list.
    let columns = |column: usize| {
        let element = |row: &Value| match row {
            Value::List(row) => row.items().get(column).cloned(),
            number => Some(number.clone()),
        };
        right.iter().map(element).collect::<Option<Vec<_>>>().ok_or("rows of one length wanted")
    };
    let times = |row: &Value, column: &[Value]| {
        let row = if let Value::List(row) = row {
            row.items()
        } else {
            return Err("a matrix has rows only".to_owned());
        };
        if row.len() != column.len() {
            return Err(format!("a row of {} and a column of {} do not match", row.len(), column.len()));
        }
        row.iter().zip(column).try_fold(Value::Integer(0), |sum, (left, right)| {
            calculate(Binary::Add, &sum, &calculate(Binary::Multiply, left, right)?)
        })
    };
    let Some(Value::List(first)) = right.first() else {
        let elements = left.iter().map(|row| times(row, right)).collect::<Result<_, _>>()?;
        return List::new(elements).map(Value::List);
    };
    if first.items().len().saturating_mul(left.len()) > limits::LIST_ELEMENTS {
        return Err(format!("a matrix has at most {} elements", limits::LIST_ELEMENTS));
    }
    if first.items().len().saturating_mul(left.len()).saturating_mul(right.len()) > limits::PRODUCT {
        return Err(format!("a product of matrices takes at most {} multiplications", limits::PRODUCT));
    }
    let columns = (0..first.items().len()).map(columns).collect::<Result<Vec<_>, _>>()?;
    let row = |row: &Value| {
        let elements = columns.iter().map(|column| times(row, column)).collect::<Result<_, _>>()?;
        List::new(elements).map(Value::List)
    };
    List::new(left.iter().map(row).collect::<Result<_, _>>()?).map(Value::List)
}

/// What an operation costs beyond what its sides hold: a product of matrices looks at each row for each
/// column.
pub(super) fn work(operator: Binary, left: &Value, right: &Value) -> usize {
    match (operator, left, right) {
        (Binary::Multiply, Value::List(left), Value::List(right)) => match (left.items(), right.items()) {
            ([Value::List(row), ..], [Value::List(other), ..]) => {
                left.items().len().saturating_mul(row.items().len()).saturating_mul(other.items().len())
            }
            _ => 0,
        },
        _ => 0,
    }
}

fn integers(operator: Binary, left: i32, right: i32) -> Result<Value, String> {
    let (wide_left, wide_right) = (i64::from(left), i64::from(right));
    match operator {
        Binary::Add => Ok(Value::integer(wide_left + wide_right)),
        Binary::Subtract => Ok(Value::integer(wide_left - wide_right)),
        Binary::Multiply => Ok(Value::integer(wide_left * wide_right)),
        Binary::Remainder if right != 0 => Ok(Value::integer(wide_left % wide_right)),
        _ => floats(operator, f64::from(left), f64::from(right)),
    }
}

fn floats(operator: Binary, left: f64, right: f64) -> Result<Value, String> {
    if right == 0.0 && matches!(operator, Binary::Divide | Binary::Remainder) {
        return Err("division by zero".to_owned());
    }
    Ok(Value::Float(match operator {
        Binary::Add => left + right,
        Binary::Subtract => left - right,
        Binary::Multiply => left * right,
        Binary::Divide => left / right,
        // The sign of the left side, as in C.
        _ => left % right,
    }))
}

/// The element of `of` at `indices`, from 0.
pub(super) fn element(of: &Value, indices: &[Value]) -> Result<Value, String> {
    let mut found = of.clone();
    for index in indices {
        found = match &found {
            Value::List(list) => {
                let at = position(index, list.items().len())?;
                list.items().get(at).cloned().unwrap_or(Value::None)
            }
            Value::Pose(pose) => {
                let at = position(index, pose.len())?;
                pose.get(at).copied().map_or(Value::None, Value::Float)
            }
            other => return Err(format!("{} has no elements", other.kind())),
        };
    }
    Ok(found)
}

/// `of` with another element at `indices`.
pub(super) fn with_element(of: Value, indices: &[Value], value: Value) -> Result<Value, String> {
    let Some((index, deeper)) = indices.split_first() else { return Ok(value) };
    match of {
        Value::List(list) => {
            let at = position(index, list.items().len())?;
            let inner = if deeper.is_empty() {
                Value::None
            } else {
                list.items().get(at).cloned().unwrap_or(Value::None)
            };
            let value = with_element(inner, deeper, value)?;
            list.with(at, value).map(Value::List)
        }
        Value::Pose(mut pose) if deeper.is_empty() => {
            let at = position(index, pose.len())?;
            let number =
                value.as_number().ok_or_else(|| format!("a pose has numbers, not {}", value.kind()))?;
            if let Some(position) = pose.get_mut(at) {
                *position = number;
            }
            Ok(Value::Pose(pose))
        }
        other => Err(format!("{} has no such elements", other.kind())),
    }
}

fn position(index: &Value, length: usize) -> Result<usize, String> {
    let at = index.as_integer().ok_or_else(|| format!("an index is an integer, not {}", index.kind()))?;
    usize::try_from(at)
        .ok()
        .filter(|&at| at < length)
        .ok_or_else(|| format!("index {at} is outside the {length} elements"))
}
