//! A recipe: fields in an agreed order, and packages of them.

use super::value::{FieldType, RtdeValue};

/// Types of the fields of a package, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RtdeRecipe {
    /// Number of the recipe, from 1; 0 in version 1 of the protocol, which does not count outputs.
    pub id: u8,
    /// In the order of the package.
    pub types: Vec<FieldType>,
}

/// Values that a recipe does not have.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Misfit {
    /// Another number of values.
    #[error("{given} values for a recipe of {wanted}")]
    Count {
        given: usize,
        /// Fields of the recipe.
        wanted: usize,
    },
    /// A value of another type.
    #[error("field {index} of the recipe is {}, not {}", wanted.word(), given.word())]
    Type {
        /// Which, from 0.
        index: usize,
        /// Type of the value.
        given: FieldType,
        /// Type of the field.
        wanted: FieldType,
    },
    /// A package of another length.
    #[error("a package of {given} bytes for a recipe of {wanted}")]
    Size {
        given: usize,
        /// Bytes of the recipe.
        wanted: usize,
    },
}

impl RtdeRecipe {
    /// Bytes of the fields.
    #[must_use]
    pub fn size(&self) -> usize {
        self.types.iter().map(|kind| kind.size()).sum()
    }

    /// Reads the fields of a package.
    ///
    /// # Errors
    ///
    /// [`Misfit::Size`].
    pub fn read(&self, mut fields: &[u8]) -> Result<Vec<RtdeValue>, Misfit> {
        let misfit = Misfit::Size { given: fields.len(), wanted: self.size() };
        let mut values = Vec::with_capacity(self.types.len());
        for kind in &self.types {
            values.push(kind.take(&mut fields).ok_or_else(|| misfit.clone())?);
        }
        if fields.is_empty() { Ok(values) } else { Err(misfit) }
    }

    /// Writes the fields of a package.
    ///
    /// # Errors
    ///
    /// [`Misfit::Count`], [`Misfit::Type`].
    pub fn write(&self, values: &[RtdeValue]) -> Result<Vec<u8>, Misfit> {
        if values.len() != self.types.len() {
            return Err(Misfit::Count { given: values.len(), wanted: self.types.len() });
        }
        let mut fields = Vec::with_capacity(self.size());
        for (index, (value, wanted)) in values.iter().zip(&self.types).enumerate() {
            let given = value.field_type();
            if given != *wanted {
                return Err(Misfit::Type { index, given, wanted: *wanted });
            }
            value.put(&mut fields);
        }
        Ok(fields)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packages_of_a_recipe_come_back_and_others_are_refused() {
        let recipe = RtdeRecipe { id: 1, types: vec![FieldType::Double, FieldType::Int32, FieldType::Bool] };
        let values = [RtdeValue::Double(0.5), RtdeValue::Int32(-7), RtdeValue::Bool(true)];
        let bytes = recipe.write(&values).unwrap();
        assert_eq!(bytes.len(), recipe.size());
        assert_eq!(recipe.read(&bytes).unwrap(), values);
        for wrong in [&bytes[..12], &[bytes.clone(), vec![0]].concat()] {
            assert_eq!(recipe.read(wrong), Err(Misfit::Size { given: wrong.len(), wanted: 13 }));
        }
        assert_eq!(recipe.write(&values[..2]), Err(Misfit::Count { given: 2, wanted: 3 }));
        let (given, wanted) = (FieldType::Int32, FieldType::Double);
        assert_eq!(
            recipe.write(&[values[1], values[1], values[2]]),
            Err(Misfit::Type { index: 0, given, wanted })
        );
    }
}
