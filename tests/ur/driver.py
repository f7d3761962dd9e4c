"""What drivers do to `foretrace ur-sim`: come back over a running script, load a program of a pendant, be called back.

Usage: driver.py HOST RATE_HZ. One line a claim; exits with the number of claims that do not hold.
"""

import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import rtde_control
import rtde_receive

HOST, RATE_HZ = sys.argv[1], float(sys.argv[2])
broken = 0


def claim(text, holds, seen=""):
    """Prints one line and counts what does not hold."""
    global broken
    broken += not holds
    print(f"{'ok    ' if holds else 'BROKEN'} driver {RATE_HZ:.0f} Hz: {text} {seen}", flush=True)


class Texts(threading.Thread):
    """Texts and errors of port 30001."""

    def __init__(self):
        super().__init__(daemon=True)
        self.socket = socket.create_connection((HOST, 30001), timeout=5)
        self.seen = []
        self.start()

    def run(self):
        data = b""
        while piece := self.socket.recv(65536):
            data += piece
            while len(data) >= 5 and len(data) >= (size := struct.unpack(">I", data[:4])[0]):
                if data[4] == 20:
                    self.seen.append((data[14], data[15:size].decode("latin1")))
                data = data[size:]

    def wait(self, text, seconds=10.0):
        """Whether a message with `text` comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if any(text in seen for _, seen in self.seen):
                return True
            time.sleep(0.01)
        return False


def send(text):
    """Sends a program and leaves, as drivers do."""
    with socket.create_connection((HOST, 30002), timeout=5) as script:
        script.sendall(text.encode())
        time.sleep(0.3)


texts = Texts()
receive = rtde_receive.RTDEReceiveInterface(HOST)

# A control client that dies amid its work, and another that comes over the script that it left behind.
left = subprocess.Popen(
    [sys.executable, "-c", f"import rtde_control, time; c = rtde_control.RTDEControlInterface({HOST!r}); "
     "print('up', flush=True); time.sleep(60)"], stdout=subprocess.PIPE, text=True)
claim("a control client is up", left.stdout.readline().strip() == "up")
left.send_signal(signal.SIGKILL)
left.wait()
claim("its script still runs", receive.getRuntimeState() == 2)
control = rtde_control.RTDEControlInterface(HOST)
home = receive.getActualQ()
target = [home[0] + 0.1] + home[1:]
claim("another client comes over it and moves the arm", control.moveJ(target, 1.0, 2.0) and control.moveJ(home, 1.0, 2.0))
control.stopScript()
control.disconnect()

header = """def saved():
  set_standard_analog_input_domain(0, 1)
  set_tool_analog_input_domain(0, 1)
  set_analog_outputdomain(0, 0)
  set_input_actions_to_default()
  set_payload(0.0)
  set_gravity([0.0, 0.0, 9.82])
  set_safety_mode_transition_hardness(1)
  step_count_a1 = 0.0
  thread Step_Counter_Thread_a1():
    while (True):
      step_count_a1 = step_count_a1 + 1.0
      sync()
    end
  end
  run Step_Counter_Thread_a1()
  $ 1 "Robot Program"
  sleep(0.2)
  textmsg("loaded ", step_count_a1 > 1)
end
"""
send(header)
claim("a program as a pendant saves it runs", texts.wait("loaded True"))

with socket.create_server(("127.0.0.1", 0)) as server:
    port = server.getsockname()[1]
    send(f"""def back():
  if socket_open("127.0.0.1", {port}, "driver"):
    socket_send_string("ready", "driver")
    params = socket_read_binary_integer(3, "driver", 5)
    textmsg("params ", params)
    socket_close("driver")
  end
end
""")
    server.settimeout(10)
    connection, _ = server.accept()
    with connection:
        claim("a program calls its driver back", connection.recv(5) == b"ready")
        connection.sendall(struct.pack(">3i", 1, -2, 3))
        claim("and reads what that sends", texts.wait("params [3, 1, -2, 3]"))

if RATE_HZ > 125:
    send("def interpreter():\n  interpreter_mode()\nend\n")
    with socket.create_connection((HOST, 30020), timeout=5) as line:
        answers = line.makefile()
        line.sendall(b'textmsg("interpreted")\n')
        answer = answers.readline().strip()
        claim("interpreter mode takes a statement", answer == 'ack: 1: textmsg("interpreted")', answer)
        claim("and runs it", texts.wait("interpreted"))
        line.sendall(b"end_interpreter()\n")
        claim("and ends", answers.readline().startswith("ack: 2"))
sys.exit(broken)
