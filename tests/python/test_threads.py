"""Threads, the interpreter lock, fork, Ctrl-C, and the end of the interpreter."""

import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import foretrace
from foretrace.messages import Mode
from world import HOME, World, until

#: A program that is an arm and ends in some way.
ARM = f"""
import os, sys, time, foretrace
ft = foretrace.attach()
arm = ft.arm_interface(500)
q = {HOME}
for count, target in enumerate(arm):
    if target.move:
        q = target.q
    arm.measured(q, [0.0] * 6)
    if count == 100:
        while True:
            try:
                ft.arm()
                break
            except foretrace.Refused:
                arm.measured(q, [0.0] * 6)
    if count == 300:
        print("armed", flush=True)
        break
"""


class Threads(World):
    def test_every_handle_may_be_used_from_any_thread(self):
        self.daemon()
        with foretrace.attach() as ft:
            pen, ticks, switch, arm = ft.pen(), ft.records("ticks"), ft.dead_man(), ft.arm_interface(200)
            errors = []

            def use(number):
                try:
                    for _ in range(20):
                        pen.send(0.001 * number, 0.0, True)
                        ticks.drain_records()
                        switch.beat()
                        arm.measured(HOME, [0.0] * 6)
                        arm.next_target()
                        ft.status()
                        ft.query()
                except Exception as problem:
                    errors.append(problem)

            threads = [threading.Thread(target=use, args=(number,)) for number in range(6)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(60)
            self.assertEqual(errors, [])
            # A handle that is dropped in another thread than it was made in.
            threading.Thread(target=lambda: pen.close()).start()
            until("the pen is free", lambda: free(ft))

    def test_threads_that_measure_at_once_never_have_stamps_that_fall(self):
        self.daemon()
        with foretrace.attach() as ft, ft.arm_interface(200) as arm:
            joints, errors = ft.records("joints"), []
            # Switches between threads as often as it can.
            switching = sys.getswitchinterval()
            sys.setswitchinterval(1e-6)
            self.addCleanup(sys.setswitchinterval, switching)

            def measure():
                try:
                    for count in range(300):
                        arm.measured(HOME, [0.0] * 6)
                        if count % 20 == 0:
                            time.sleep(0.005)
                except Exception as problem:
                    errors.append(problem)

            threads = [threading.Thread(target=measure) for _ in range(4)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join(60)
            self.assertEqual(errors, [])
            stamps = [state.header.stamp_ns for state in joints.drain_records(0.5)]
            self.assertEqual(stamps, sorted(set(stamps)))

    def test_waits_release_the_interpreter(self):
        self.daemon()
        with foretrace.attach() as ft, ft.records("pen") as records:
            begin = time.monotonic()
            waiting = threading.Thread(target=lambda: records.drain_records(timeout=1.0))
            waiting.start()
            count = 0
            while waiting.is_alive():
                time.sleep(0.001)
                count += 1
            self.assertGreaterEqual(time.monotonic() - begin, 0.9)
            # Held, it would have been counted in steps of the switch interval at best, or not at all.
            self.assertGreater(count, 100)

    def test_ctrl_c_ends_a_wait(self):
        self.daemon()
        code = (
            "import foretrace\n"
            "with foretrace.attach() as ft, ft.records('pen') as records:\n"
            "    print('waits', flush=True)\n"
            "    records.drain_records(timeout=600)\n"
        )
        child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        self.assertEqual(child.stdout.readline().strip(), "waits")
        time.sleep(0.2)
        child.send_signal(signal.SIGINT)
        _, error = child.communicate(timeout=10)
        self.assertIn("KeyboardInterrupt", error)

    def test_ctrl_c_ends_the_wait_for_an_answer(self):
        daemon = self.daemon()
        code = (
            "import foretrace\n"
            "ft = foretrace.attach()\n"
            "print(ft.query().mode, flush=True)\n"
            "input()\n"
            "try:\n"
            "    ft.query(timeout=600)\n"
            "except KeyboardInterrupt:\n"
            "    print('ended', flush=True)\n"
        )
        child = subprocess.Popen(
            [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.children.append(child)
        self.assertTrue(child.stdout.readline())
        # It gives no answer.
        daemon.send_signal(signal.SIGSTOP)
        child.stdin.write("\n")
        child.stdin.flush()
        time.sleep(0.5)
        child.send_signal(signal.SIGINT)
        out, error = child.communicate(timeout=10)
        daemon.send_signal(signal.SIGCONT)
        self.assertEqual(out.strip(), "ended", error)

    def test_an_attachment_that_is_dropped_stops_its_arm_without_the_interpreter_lock(self):
        daemon = self.daemon()
        self.start("arm", "sim")
        ft = foretrace.attach()
        self.armed(ft)
        gaps, wanted = [0.0], [True]

        def tick():
            last = time.monotonic()
            while wanted[0]:
                time.sleep(0.005)
                now = time.monotonic()
                gaps.append(now - last)
                last = now

        ticking = threading.Thread(target=tick)
        ticking.start()
        daemon.send_signal(signal.SIGSTOP)
        begin = time.monotonic()
        del ft
        took = time.monotonic() - begin
        daemon.send_signal(signal.SIGCONT)
        wanted[0] = False
        ticking.join()
        # The stop of a frozen daemon is waited for; others run meanwhile.
        self.assertGreater(took, 1.0)
        self.assertLess(max(gaps), 0.6)

    def test_a_wait_ends_when_its_handle_is_closed(self):
        self.daemon()
        with foretrace.attach() as ft:
            records, told = ft.records("pen"), []

            def wait():
                try:
                    records.drain_records(timeout=30.0)
                except foretrace.Problem as problem:
                    told.append(str(problem))

            waiting = threading.Thread(target=wait)
            waiting.start()
            time.sleep(0.2)
            records.close()
            waiting.join(5.0)
            self.assertFalse(waiting.is_alive())
            self.assertIn("closed", told[0])

    def test_a_child_by_fork_refuses_and_leaves_the_parent_alone(self):
        self.daemon()
        with foretrace.attach() as ft:
            pen = ft.pen()
            predictor = ft.predictor_interface()
            until("the daemon hears", lambda: pen.send(0.0, 0.0, True))
            reading, writing = os.pipe()
            child = os.fork()
            if child == 0:
                told = []
                uses = [lambda: pen.send(0.0, 0.0, True), ft.query, ft.status, lambda: ft.pen(name="child")]
                uses += [lambda: predictor.lost, lambda: predictor.next(0.0)]
                for use in uses:
                    try:
                        use()
                        told.append("did it")
                    except foretrace.Problem as problem:
                        told.append(str(problem))
                os.write(writing, "\n".join(told).encode())
                ft.close()
                sys.stdout.flush()
                os._exit(0)
            os.close(writing)
            with os.fdopen(reading) as pipe:
                told = pipe.read().splitlines()
            os.waitpid(child, 0)
            self.assertEqual(len(told), 6)
            for line in told:
                self.assertIn("attach in the child", line)
            self.assertTrue(pen.send(0.0, 0.0, True))
            ft.query()

    def ends(self, code, want):
        """A program that is an arm ends as `code` says; how, and what the daemon then does."""
        child = subprocess.Popen([sys.executable, "-c", ARM + code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.children.append(child)
        _, error = child.communicate(timeout=60)
        self.assertEqual(child.returncode, want, error)
        return error

    def test_the_interpreters_end_stops_the_arm_and_joins_the_loop(self):
        self.daemon()
        with foretrace.attach() as ft:
            for code, want in (
                ("", 0),
                ("sys.exit(3)", 3),
                ("raise SystemError('on purpose')", 1),
                ("import threading; threading.Thread(target=lambda: [arm.next_target() for _ in range(50)]).start()", 0),
                ("import gc; del ft, arm; gc.collect()", 0),
            ):
                error = self.ends(code, want)
                self.assertNotIn("panicked", error)
                self.assertNotIn("Fatal", error)
                self.assertEqual(ft.query().mode, Mode.STOPPED, code)
                ft.disarm()
            # Without an end that anybody could act on: silence stops the arm.
            self.ends("os._exit(5)", 5)
            ft.wait_until(lambda status: status.mode == Mode.STOPPED, timeout=10)


def free(ft):
    try:
        ft.pen().close()
        return True
    except foretrace.Taken:
        return False


if __name__ == "__main__":
    unittest.main()
