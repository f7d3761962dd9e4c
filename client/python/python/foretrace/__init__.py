"""foretrace: a robot arm follows a human hand ahead of time."""

from . import datasets, lab, law, recordings
from ._native import Invalid, NoAnswer, NoDaemon, OtherVersion, Problem, Refused, Taken
from .arm import ArmInterface, ArmPorts, Target, demand_at
from .handles import DeadMan, Gateway, Pen, Records, StatusWatch, gateway
from .law import Chain, Follower, Guard, Joints, Limits
from .live import Answer, Foretrace, JointsAt, Settings, Stopped, attach, now_ns, stop
from .pace import Pace
from .predictor import PredictorInterface
from .recordings import read, replay

__all__ = [
    "Answer",
    "ArmInterface",
    "ArmPorts",
    "Chain",
    "DeadMan",
    "Follower",
    "Foretrace",
    "Gateway",
    "Guard",
    "Invalid",
    "Joints",
    "JointsAt",
    "Limits",
    "NoAnswer",
    "NoDaemon",
    "OtherVersion",
    "Pace",
    "Pen",
    "PredictorInterface",
    "Problem",
    "Records",
    "Refused",
    "Settings",
    "StatusWatch",
    "Stopped",
    "Taken",
    "Target",
    "attach",
    "datasets",
    "demand_at",
    "gateway",
    "lab",
    "law",
    "now_ns",
    "read",
    "recordings",
    "replay",
    "stop",
]
