"""An RTDE client of a few lines that asks for input registers."""

import socket
import struct


class Registers:
    """Owns the registers that it has claimed until it is closed."""

    def __init__(self, host):
        self.socket = socket.create_connection((host, 30004), timeout=5)
        self.ask(b"V", struct.pack("!H", 2))

    def ask(self, kind, payload):
        self.socket.sendall(struct.pack("!Hc", len(payload) + 3, kind) + payload)
        size, got = struct.unpack("!Hc", self.exactly(3))
        payload = self.exactly(size - 3)
        assert got == kind, got
        return payload

    def exactly(self, size):
        data = b""
        while len(data) < size:
            data += self.socket.recv(size - len(data))
        return data

    def claim(self, numbers):
        """The answer to a recipe of these registers, integers before doubles."""
        names = [f"input_{kind}_register_{n}" for kind in ("int", "double") for n in numbers]
        return self.ask(b"I", ",".join(names).encode())

    def close(self):
        self.socket.close()
