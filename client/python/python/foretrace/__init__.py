"""foretrace: a robot arm follows a human hand ahead of time."""

from ._native import Invalid, NoDaemon, OtherVersion, Problem, Refused, Taken

__all__ = ["Invalid", "NoDaemon", "OtherVersion", "Problem", "Refused", "Taken"]
