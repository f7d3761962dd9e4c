"""What the tests share: the program, a recording that it made, data sets, the Rust side of the law.

Environment: FORETRACE (the program), FORETRACE_RECORDING (an .mcap; made here where it is not given),
FORETRACE_LAW_BITS (the example `law_bits`), FORETRACE_DATA (a folder of data sets).
"""

import functools
import os
import shutil
import struct
import subprocess
import tempfile
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
ROOT = os.path.dirname(os.path.dirname(os.path.dirname(HERE)))
KEPT = os.path.join(ROOT, "client", "record", "tests", "kept")

try:
    import numpy
except ImportError:
    numpy = None

needs_numpy = unittest.skipIf(numpy is None, "numpy is not installed")


@functools.cache
def program():
    """The program, or the test is skipped."""
    found = os.environ.get("FORETRACE") or shutil.which("foretrace")
    if found is None or not os.access(found, os.X_OK):
        raise unittest.SkipTest("the program foretrace is not built; give it as FORETRACE")
    return os.path.abspath(found)


def run(*arguments, legal=(0,)):
    """What the program prints to stdout."""
    done = subprocess.run([program(), *map(str, arguments)], capture_output=True, text=True, timeout=300)
    if done.returncode not in legal:
        raise AssertionError(f"foretrace {arguments} ended with {done.returncode}: {done.stderr}")
    return done.stdout


@functools.cache
def recording():
    """A recording of a few seconds with a stop, made by a daemon, an arm, a pen and a recorder."""
    given = os.environ.get("FORETRACE_RECORDING")
    if given:
        return given
    path = os.path.join(tempfile.mkdtemp(prefix="ftr-py-"), "run.mcap")
    done = subprocess.run(
        ["bash", os.path.join(HERE, "make_recording.sh"), path],
        env={**os.environ, "FORETRACE": program()}, capture_output=True, text=True, timeout=300,
    )
    if done.returncode != 0:
        raise AssertionError(f"no recording could be made: {done.stdout}{done.stderr}")
    return path


def kept():
    """Recordings of other versions of the messages."""
    return sorted(os.path.join(KEPT, name) for name in os.listdir(KEPT))


def mcap(channels):
    """The bytes of a recording: per channel topic, encoding, schema (name, encoding, text) and messages (time, data)."""
    text = lambda words: struct.pack("<I", len(words.encode())) + words.encode()
    record = lambda kind, body: struct.pack("<BQ", kind, len(body)) + body
    magic = b"\x89MCAP0\r\n"
    parts = [magic, record(1, text("") + text("test"))]
    for number, (topic, encoding, (name, kind, table), messages) in enumerate(channels, 1):
        parts.append(record(3, struct.pack("<H", number) + text(name) + text(kind) + struct.pack("<I", len(table)) + table))
        parts.append(record(4, struct.pack("<HH", number, number) + text(topic) + text(encoding) + bytes(4)))
        parts += [record(5, struct.pack("<HIQQ", number, at, time, time) + data) for at, (time, data) in enumerate(messages)]
    return b"".join([*parts, record(15, bytes(4)), record(2, bytes(20)), magic])


def data(name):
    """A data set, or the test is skipped."""
    folder = os.path.join(os.environ.get("FORETRACE_DATA", ""), name)
    if not os.environ.get("FORETRACE_DATA") or not os.path.isdir(folder):
        raise unittest.SkipTest(f"the data set {name} is not here; give the folder of sets as FORETRACE_DATA")
    return folder


class Scratch(unittest.TestCase):
    """A test with a folder of its own."""

    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="ftr-py-")
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def path(self, *names):
        """A path in the folder, whose own folders exist."""
        path = os.path.join(self.folder, *names)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        return path

    def write(self, name, text):
        """A file in the folder."""
        path = self.path(*name.split("/"))
        with open(path, "wb") as file:
            file.write(text if isinstance(text, bytes) else text.encode())
        return path
