"""foretrace: a robot arm follows a human hand ahead of time."""

from ._native import Invalid, NoAnswer, NoDaemon, OtherVersion, Problem, Refused, Taken
from .arm import ArmInterface, ArmPorts, Target, demand_at
from .handles import DeadMan, Gateway, Pen, Records, StatusWatch, gateway
from .live import Answer, Foretrace, JointsAt, Settings, Stopped, attach, now_ns, stop
from .pace import Pace

__all__ = [
    "Answer",
    "ArmInterface",
    "ArmPorts",
    "DeadMan",
    "Foretrace",
    "Gateway",
    "Invalid",
    "JointsAt",
    "NoAnswer",
    "NoDaemon",
    "OtherVersion",
    "Pace",
    "Pen",
    "Problem",
    "Records",
    "Refused",
    "Settings",
    "StatusWatch",
    "Stopped",
    "Taken",
    "Target",
    "attach",
    "demand_at",
    "gateway",
    "now_ns",
    "stop",
]
