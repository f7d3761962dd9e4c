//! The bridge: joint commands of foretrace to a UR controller, its joints back.
