//! The dashboard (port 29999): commands and answers as lines of text.
