//! Errors whose `Debug` form is their sentence.
//!
//! A program whose `main` returns an error shows its `Debug` form. For errors that users see this must be the
//! sentence with the remedy, not names of variants and fields.

/// Implements `Debug` by `Display` for each type.
#[macro_export]
macro_rules! debug_as_display {
    ($($type:ty),+ $(,)?) => {$(
        impl ::std::fmt::Debug for $type {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                ::std::fmt::Display::fmt(self, f)
            }
        }
    )+};
}
