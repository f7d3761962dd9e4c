"""Fills a folder with programs that others wrote, for the tests in others.rs: python3 others.py FOLDER [CHECKOUT]

Needs `ur_rtde` 1.6.5 (pip) and a free port 30003 on 127.0.0.99: its script client sends there what it would send to a
controller. CHECKOUT is one of github.com/UniversalRobots/Universal_Robots_Client_Library; without it its program is left out.
The programs are not ours: they are not committed.
"""

import pathlib
import re
import socket
import sys
import threading

HOST = "127.0.0.99"
OFFSETS = ("# float register offset\n", "# int register offset\n")


def of_ur_rtde(folder: pathlib.Path) -> None:
    from script_client import ScriptClient  # part of ur_rtde

    for major, minor in ((3, 14), (5, 11), (5, 25)):
        with socket.create_server((HOST, 30003)) as server:
            received = bytearray()

            def receive() -> None:
                connection, _ = server.accept()
                with connection:
                    while piece := connection.recv(1 << 16):
                        received.extend(piece)

            reader = threading.Thread(target=receive)
            reader.start()
            client = ScriptClient(HOST, major, minor)
            client.connect()
            client.sendScript()
            client.disconnect()
            reader.join()
        text = received.decode()
        # What the control client does before it sends: the offset of its registers, behind each of these comments.
        for offset in OFFSETS:
            text = text.replace(offset, offset + "0")
        (folder / f"ur_rtde-{major}.{minor}.script").write_text(text)


def of_client_library(folder: pathlib.Path, checkout: pathlib.Path) -> None:
    """The library's template for version 5.11, filled in as its driver does."""
    values = {
        "BEGIN_REPLACE": "",
        "JOINT_STATE_REPLACE": "1000000",
        "TIME_REPLACE": "1000",
        "SERVO_J_REPLACE": "lookahead_time=0.03, gain=2000",
        "SERVER_IP_REPLACE": "127.0.0.1",
        "TRAJECTORY_SERVER_PORT_REPLACE": "50003",
        "SCRIPT_COMMAND_SERVER_PORT_REPLACE": "50004",
        "SERVER_PORT_REPLACE": "50001",
    }
    compare = {"<": lambda a, b: a < b, ">": lambda a, b: a > b, "<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b}

    def holds(condition: str) -> bool:
        operator, *version = re.search(r"(<=|>=|<|>)\s*v(\d+)\.(\d+)\.(\d+)", condition).groups()
        return compare[operator]((5, 11, 0), tuple(map(int, version)))

    lines, conditions = [], []  # Of each open condition: whether this branch holds, and whether one has held.
    for line in (checkout / "resources/external_control.urscript").read_text().splitlines():
        if not (found := re.match(r"\s*\{%\s*(if|elif|else|endif)\s*(.*?)%\}", line)):
            if all(now for now, _ in conditions):
                lines.append("\t" + re.sub(r"\{\{(\w+)\}\}", lambda name: values[name[1]], line))
        elif found[1] == "endif":
            conditions.pop()
        elif found[1] == "if":
            now = holds(found[2])
            conditions.append((now, now))
        else:
            _, before = conditions.pop()
            now = not before and (found[1] == "else" or holds(found[2]))
            conditions.append((now, before or now))
    (folder / "external_control.script").write_text("\n".join(["def externalControl():", *lines, "end", ""]))


if __name__ == "__main__":
    target = pathlib.Path(sys.argv[1])
    target.mkdir(parents=True, exist_ok=True)
    of_ur_rtde(target)
    if len(sys.argv) > 2:
        of_client_library(target, pathlib.Path(sys.argv[2]))
    print(*sorted(path.name for path in target.glob("*.script")), sep="\n")
