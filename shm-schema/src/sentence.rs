//! Errors whose `Debug` form is their sentence.
//!
//! A program whose `main` returns an error shows its `Debug` form. For the errors that users meet that has to be the sentence
//! with the remedy, not names of variants and fields.

/// Implements `Debug` by `Display` for each type.
#[macro_export]
macro_rules! debug_is_sentence {
    ($($type:ty),+ $(,)?) => {$(
        impl ::std::fmt::Debug for $type {
            fn fmt(&self, f: &mut ::std::fmt::Formatter<'_>) -> ::std::fmt::Result {
                ::std::fmt::Display::fmt(self, f)
            }
        }
    )+};
}

crate::debug_is_sentence!(
    crate::ServiceError,
    crate::InstanceError,
    crate::PublishError,
    crate::AskError,
    crate::Rejection,
    crate::UnknownValue,
);

#[cfg(test)]
mod tests {
    use crate::{InstanceError, RejectReason, Rejection, ServiceError};

    #[test]
    fn what_main_prints_is_a_sentence_with_a_remedy() {
        let root = std::path::PathBuf::from("/tmp/foretrace-0-3");
        let errors: [Box<dyn std::error::Error>; 3] = [
            Box::new(ServiceError::NoDaemon { number: 3, root: root.clone(), foreign: None }),
            Box::new(ServiceError::from(InstanceError::NotADirectory { root })),
            Box::new(Rejection::new(RejectReason::NotFinite, "q").because(f64::NAN, 1.0)),
        ];
        for (error, words) in
            errors.iter().zip(["start it with `foretrace daemon", "remove it or", "must be a finite"])
        {
            let printed = format!("{error:?}");
            assert!(printed.contains(words) && !printed.contains('{'), "{printed}");
        }
    }

    #[test]
    fn daemon_of_another_user_is_recognised_and_the_gateway_named() {
        let root = std::path::PathBuf::from("/tmp/foretrace-0-0");
        let error = ServiceError::NoDaemon { number: 0, root, foreign: Some(1001) };
        let words = error.to_string();
        assert!(words.contains("user 1001") && words.contains("foretrace gateway"), "{words}");
    }
}
