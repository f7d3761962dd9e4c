//! What a source has to say, in words for people.

use crate::source::SourceNews;

impl SourceNews {
    pub fn words(self) -> String {
        match self {
            Self::Gone => "the daemon is gone; waiting for another".to_owned(),
            Self::Back => "a daemon took over".to_owned(),
            Self::Renewed => "a new daemon is there".to_owned(),
            Self::Elsewhere => "the relay is gone; listening goes on without it".to_owned(),
            Self::Deaf(error) => format!("not all comes, and it is tried again: {error}"),
        }
    }
}
