//! States of numbers, arrays, matrices, options, boxes, lists and tuples.

use nalgebra::SMatrix;

use super::{Blank, Reader, State, StateError, Writer};

macro_rules! numbers {
    ($($number:ty)*) => {$(
        impl State for $number {
            fn save(&self, to: &mut Writer<'_>) {
                to.put(&self.to_le_bytes());
            }

            fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
                *self = Self::from_le_bytes(from.take()?);
                Ok(())
            }
        }

        impl Blank for $number {
            fn blank() -> Self {
                Self::default()
            }
        }
    )*};
}
numbers!(u8 u16 u32 u64 i32 i64 f32 f64);

impl State for usize {
    fn save(&self, to: &mut Writer<'_>) {
        (*self as u64).save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        *self = from.length(usize::MAX, |_| true)?;
        Ok(())
    }
}

impl Blank for usize {
    fn blank() -> Self {
        0
    }
}

impl State for bool {
    fn save(&self, to: &mut Writer<'_>) {
        to.put(&[u8::from(*self)]);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        *self = from.mark(1)? == 1;
        Ok(())
    }
}

impl Blank for bool {
    fn blank() -> Self {
        false
    }
}

impl<T: State, const N: usize> State for [T; N] {
    fn save(&self, to: &mut Writer<'_>) {
        self.iter().for_each(|item| item.save(to));
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        self.iter_mut().try_for_each(|item| item.load(from))
    }
}

impl<T: Blank, const N: usize> Blank for [T; N] {
    fn blank() -> Self {
        std::array::from_fn(|_| T::blank())
    }
}

impl<const R: usize, const C: usize> State for SMatrix<f64, R, C> {
    fn save(&self, to: &mut Writer<'_>) {
        self.iter().for_each(|item| item.save(to));
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        self.iter_mut().try_for_each(|item| item.load(from))
    }
}

impl<const R: usize, const C: usize> Blank for SMatrix<f64, R, C> {
    fn blank() -> Self {
        Self::zeros()
    }
}

impl<T: Blank> State for Option<T> {
    fn save(&self, to: &mut Writer<'_>) {
        self.is_some().save(to);
        if let Some(item) = self {
            item.save(to);
        }
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        *self = None;
        if from.mark(1)? == 1 {
            self.insert(T::blank()).load(from)?;
        }
        Ok(())
    }
}

impl<T: Blank> Blank for Option<T> {
    fn blank() -> Self {
        None
    }
}

impl<T: State + ?Sized> State for Box<T> {
    fn save(&self, to: &mut Writer<'_>) {
        self.as_ref().save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        self.as_mut().load(from)
    }
}

/// A list whose length the settings give.
impl<T: State> State for [T] {
    fn save(&self, to: &mut Writer<'_>) {
        self.len().save(to);
        self.iter().for_each(|item| item.save(to));
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        let own = self.len();
        from.length(own, |length| length == own)?;
        self.iter_mut().try_for_each(|item| item.load(from))
    }
}

/// A list that grows and shrinks within its capacity.
impl<T: Blank> State for Vec<T> {
    fn save(&self, to: &mut Writer<'_>) {
        self.as_slice().save(to);
    }

    fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
        let most = self.capacity();
        let length = from.length(most, |length| length <= most)?;
        self.clear();
        self.resize_with(length, T::blank);
        self.iter_mut().try_for_each(|item| item.load(from))
    }
}

macro_rules! tuples {
    ($(($($name:ident $number:tt),+))*) => {$(
        impl<$($name: State),+> State for ($($name,)+) {
            fn save(&self, to: &mut Writer<'_>) {
                $(self.$number.save(to);)+
            }

            fn load(&mut self, from: &mut Reader<'_>) -> Result<(), StateError> {
                $(self.$number.load(from)?;)+
                Ok(())
            }
        }

        impl<$($name: Blank),+> Blank for ($($name,)+) {
            fn blank() -> Self {
                ($($name::blank(),)+)
            }
        }
    )*};
}
tuples!((A 0, B 1) (A 0, B 1, C 2));
