//! Values for Python: dicts by key, numbers as bytes.

/// A dict of these keys and values.
macro_rules! table {
    ($python:expr; $($key:literal => $value:expr),+ $(,)?) => {{
        let table = pyo3::types::PyDict::new($python);
        $(pyo3::types::PyDictMethods::set_item(&table, $key, $value)?;)+
        table
    }};
}
pub(crate) use table;

/// The numbers, little-endian, one after the other.
pub fn bytes_of(numbers: impl IntoIterator<Item = f64>) -> Vec<u8> {
    numbers.into_iter().flat_map(f64::to_le_bytes).collect()
}
