//! The real-time data exchange (RTDE, port 30004): packages, fields, and a client.
