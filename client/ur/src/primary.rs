//! Packages of the primary and secondary interfaces (ports 30001 and 30002).
