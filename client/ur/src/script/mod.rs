//! An interpreter of URScript.
