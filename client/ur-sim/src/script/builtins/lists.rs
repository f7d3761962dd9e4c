//! Lists and matrices.

use nalgebra::DMatrix;

use super::super::limits;
use super::super::value::{List, Value};
use super::{integer, pose, value};

/// Rows of a matrix that is turned around: what takes its time is the cube of them.
const MOST_ROWS: usize = 16;

/// The elements of the list at `at`; those of a pose too.
fn items(arguments: &[Value], at: usize) -> Result<Vec<Value>, String> {
    match value(arguments, at) {
        Value::List(list) => Ok(list.items().to_vec()),
        Value::Pose(pose) => Ok(pose.map(Value::Float).to_vec()),
        other => Err(format!("wants a list, not {}", other.kind())),
    }
}

fn numbers(arguments: &[Value], at: usize) -> Result<Vec<f64>, String> {
    let wrong = || "wants a list of numbers".to_owned();
    items(arguments, at)?.iter().map(|item| item.as_number().ok_or_else(wrong)).collect()
}

fn count(length: usize) -> Value {
    Value::integer(i64::try_from(length).unwrap_or(i64::MAX))
}

/// Elements of a list, letters of a string.
pub(super) fn length(arguments: &[Value]) -> Result<Value, String> {
    match value(arguments, 0) {
        Value::Text(text) => Ok(count(text.len())),
        _ => items(arguments, 0).map(|items| count(items.len())),
    }
}

/// Rows and columns of a matrix as a list, elements of a list as a number.
pub(super) fn size(arguments: &[Value]) -> Result<Value, String> {
    match items(arguments, 0)?.as_slice() {
        rows @ [Value::List(first), ..] => {
            List::new(vec![count(rows.len()), count(first.items().len())]).map(Value::List)
        }
        list => Ok(count(list.len())),
    }
}

/// The first element is the lowest bit.
pub(super) fn binary_list_to_integer(arguments: &[Value]) -> Result<Value, String> {
    let bits = items(arguments, 0)?;
    if bits.len() > 32 {
        return Err(format!("takes at most 32 bits, not {}", bits.len()));
    }
    let mut number: u32 = 0;
    for bit in bits.iter().rev() {
        let bit = bit.as_bool().ok_or_else(|| format!("wants truth values, not {}", bit.kind()))?;
        number = number << 1 | u32::from(bit);
    }
    Ok(Value::Integer(number.cast_signed()))
}

/// 32 truth values, the lowest bit first.
pub(super) fn integer_to_binary_list(arguments: &[Value]) -> Result<Value, String> {
    let number = integer(arguments, 0)?.cast_unsigned();
    List::new((0..32).map(|bit| Value::Bool(number >> bit & 1 == 1)).collect()).map(Value::List)
}

pub(super) fn make_list(arguments: &[Value]) -> Result<Value, String> {
    let length = usize::try_from(integer(arguments, 0)?).unwrap_or(usize::MAX);
    if length > limits::LIST_ELEMENTS {
        return Err(format!("makes lists of 0 to {} elements", limits::LIST_ELEMENTS));
    }
    List::new(vec![value(arguments, 1).clone(); length]).map(Value::List)
}

/// The length of a vector; the amount of a number.
pub(super) fn norm(arguments: &[Value]) -> Result<Value, String> {
    match value(arguments, 0) {
        Value::Integer(number) => Ok(Value::integer(i64::from(*number).abs())),
        Value::Float(number) => Ok(Value::Float(number.abs())),
        _ => Ok(Value::Float(numbers(arguments, 0)?.iter().map(|x| x * x).sum::<f64>().sqrt())),
    }
}

pub(super) fn normalize(arguments: &[Value]) -> Result<Value, String> {
    let vector = numbers(arguments, 0)?;
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(length > 0.0) {
        return Err("has no direction".to_owned());
    }
    Ok(Value::floats(&vector.iter().map(|x| x / length).collect::<Vec<_>>()))
}

pub(super) fn transpose(arguments: &[Value]) -> Result<Value, String> {
    let rows: Vec<Vec<Value>> = items(arguments, 0)?
        .iter()
        .map(|row| items(std::slice::from_ref(row), 0))
        .collect::<Result<_, _>>()?;
    let width = rows.first().map_or(0, Vec::len);
    if rows.iter().any(|row| row.len() != width) {
        return Err("wants rows of one length".to_owned());
    }
    let column = |at: usize| List::new(rows.iter().filter_map(|row| row.get(at).cloned()).collect());
    let columns = (0..width).map(|at| column(at).map(Value::List)).collect::<Result<_, _>>()?;
    List::new(columns).map(Value::List)
}

/// The inverse of a square matrix, or of a pose.
pub(super) fn inv(arguments: &[Value]) -> Result<Value, String> {
    if let Value::Pose(_) = value(arguments, 0) {
        return pose::pose_inv(arguments);
    }
    let rows: Vec<Vec<f64>> = items(arguments, 0)?
        .iter()
        .map(|row| numbers(std::slice::from_ref(row), 0))
        .collect::<Result<_, _>>()?;
    let size = rows.len();
    if size == 0 || size > MOST_ROWS || rows.iter().any(|row| row.len() != size) {
        return Err(format!("wants a square matrix of at most {MOST_ROWS} rows"));
    }
    let matrix = DMatrix::from_row_iterator(size, size, rows.into_iter().flatten());
    let inverse = matrix.try_inverse().ok_or("has no value there: the matrix is singular")?;
    let rows = inverse.row_iter().map(|row| Value::floats(&row.iter().copied().collect::<Vec<_>>()));
    List::new(rows.collect()).map(Value::List)
}
