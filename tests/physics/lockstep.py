"""The arm's side of `foretrace lab closed-loop --arm-socket` (docs/extend/judge.md), in the standard library."""

import os
import socket
import struct

MAGIC, VERSION, JOINTS = b"FTLS", 1, 6
HEADER = struct.Struct("<4sHHII")
LAW_HELLO, ARM_HELLO = struct.Struct("<QQ6d"), struct.Struct("<ddII6d")
COMMAND, STATE = struct.Struct("<QQII6d6d"), struct.Struct("<QQII6d6d6d")
NEWTON_METRE = 1


def message(kind, body):
    """`body` behind its header."""
    return HEADER.pack(MAGIC, VERSION, kind, HEADER.size + len(body), JOINTS) + body


def receive(connection, kind, form):
    """The next message, which must be of this kind; None where the law has gone."""
    bytes_ = b""
    while len(bytes_) < HEADER.size + form.size:
        more = connection.recv(HEADER.size + form.size - len(bytes_))
        if not more:
            return None
        bytes_ += more
    magic, version, found, length, joints = HEADER.unpack_from(bytes_)
    if (magic, version, found, length, joints) != (MAGIC, VERSION, kind, len(bytes_), JOINTS):
        raise ValueError(f"not message {kind} of version {VERSION}: {bytes_[:16]!r}")
    return form.unpack_from(bytes_, HEADER.size)


def listen(path):
    """A socket that `foretrace` connects to, once for every hand."""
    if os.path.exists(path):
        os.unlink(path)
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(path)
    listener.listen(1)
    return listener


def serve(connection, make_arm):
    """One run: `make_arm(home, period_s)` gives an arm: `q`, `group_delay_s` (-1: unknown), `step(q, qd, enabled) -> q, qd, effort`."""
    period_ns, _begin, *home = receive(connection, 1, LAW_HELLO)
    arm = make_arm(home, period_ns * 1e-9)
    connection.sendall(message(2, ARM_HELLO.pack(1e9 / period_ns, arm.group_delay_s, NEWTON_METRE, 0, *arm.q)))
    while (command := receive(connection, 3, COMMAND)) is not None:
        until, tick, enabled, _, *numbers = command
        q, qd, effort = arm.step(numbers[:6], numbers[6:], enabled == 1)
        connection.sendall(message(4, STATE.pack(until, tick, 1, 0, *q, *qd, *effort)))
    return arm
