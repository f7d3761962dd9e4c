"""foretrace: a robot arm follows a human hand ahead of time."""

from . import datasets, lab, law, recordings
from ._native import Invalid, NoDaemon, OtherVersion, Problem, Refused, Taken
from .law import Chain, Follower, Guard, Joints, Limits
from .recordings import read, replay

__all__ = [
    "Chain", "Follower", "Guard", "Invalid", "Joints", "Limits", "NoDaemon", "OtherVersion", "Problem", "Refused",
    "Taken", "datasets", "lab", "law", "read", "recordings", "replay",
]
