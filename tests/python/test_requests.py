"""Attach, ask, watch, and what the end of a block does."""

import signal
import threading
import time
import unittest

import foretrace
from foretrace.messages import ControlStatus, Mode, TrustReason
from world import Hand, World, following, until


class Requests(World):
    def simulated(self):
        self.daemon()
        self.start("arm", "sim")
        until("the arm reports", lambda: self.ask("request", "query").returncode == 0)

    def test_without_a_daemon_everything_says_so(self):
        with self.refuses(foretrace.NoDaemon, "instance 0", "foretrace daemon"):
            foretrace.attach()
        with self.refuses(foretrace.NoDaemon, "instance 3"):
            foretrace.stop(3)
        begin = time.monotonic()
        with self.refuses(foretrace.NoDaemon):
            foretrace.attach(wait=0.5)
        self.assertGreater(time.monotonic() - begin, 0.4)
        for wait in (-1.0, float("nan"), 1e9):
            with self.refuses(foretrace.Invalid, "wait", "from 0 to 3600"):
                foretrace.attach(wait=wait)
        for instance in (-1, "0", 2**40, 0.5, 5.0, 10**5000):
            with self.refuses(foretrace.Invalid, "instance"):
                foretrace.attach(instance)
        with self.refuses(foretrace.Problem, "relative/path", "absolute"):
            foretrace.attach(root="relative/path")

    def test_a_refusal_has_the_daemons_reason_and_remedy(self):
        self.daemon()
        with foretrace.attach() as ft:
            with self.refuses(foretrace.Refused, "no joint state") as refused:
                ft.arm()
            self.assertEqual(refused.error.status, ControlStatus.NO_JOINT_STATE)
            with self.refuses(foretrace.Refused):
                ft.move_home()
            with self.refuses(foretrace.Refused, "nothing-like-it"):
                ft.predictor("nothing-like-it")
            with self.refuses(foretrace.Invalid):
                ft.predictor("NOT A NAME")
            for value in (1.5, -0.1, float("nan"), float("inf"), 10**5000, "always"):
                with self.refuses(foretrace.Invalid, "trust", "from 0 to 1"):
                    ft.trust(value)

    def test_requests_that_are_granted(self):
        self.simulated()
        with foretrace.attach() as ft:
            self.assertEqual(ft.query().mode, Mode.IDLE)
            self.armed(ft)
            # Never older than the request before it.
            self.assertNotEqual(ft.status().mode, Mode.IDLE)
            self.assertEqual(ft.trust(0.25).mode, ft.query().mode)
            hand = Hand(ft)
            status = ft.wait_until(lambda status: abs(status.trust - 0.25) < 1e-6, timeout=20)
            self.assertEqual(status.trust_reason, TrustReason.MANUAL)
            self.assertAlmostEqual(ft.query().trust, 0.25)
            hand.end()
            ft.trust("freeze")
            ft.trust("auto")
            settings = ft.settings()
            self.assertIn("joint_state_timeout_ms = 500", settings.text)
            ft.reload()
            stopped = ft.stop()
            self.assertEqual(stopped.mode, Mode.STOPPED)
            self.assertEqual(ft.status().mode, Mode.STOPPED)
            ft.disarm()
            ft.wait_until(lambda status: status.mode == Mode.IDLE, timeout=10)
            ft.move_home()
            ft.stop()
            with self.refuses(foretrace.NoAnswer, "0.3 s", "stopped"):
                ft.wait_until(lambda status: status.mode == Mode.FOLLOWING, timeout=0.3)
            for timeout in (float("nan"), float("inf"), -1.0, "soon"):
                with self.refuses(foretrace.Invalid, "timeout"):
                    ft.wait_until(lambda status: False, timeout=timeout)

    def test_leaving_the_block_stops_the_arm_also_by_an_exception(self):
        self.simulated()
        with foretrace.attach() as outside:
            with foretrace.attach() as ft:
                self.armed(ft)
            self.assertEqual(outside.query().mode, Mode.STOPPED)
            with self.assertRaises(ZeroDivisionError):
                with foretrace.attach() as ft:
                    self.armed(ft)
                    hand = Hand(ft)
                    following(ft)
                    1 / 0
            hand.end()
            self.assertIn(outside.query().mode, (Mode.STOPPED,))
            # A block that did not arm does not stop.
            self.armed(outside)
            with foretrace.attach() as ft:
                ft.query()
            self.assertNotEqual(outside.query().mode, Mode.STOPPED)
            # Nor does one whose request was refused.
            with foretrace.attach() as ft:
                with self.refuses(foretrace.Refused):
                    ft.arm()
            self.assertNotEqual(outside.query().mode, Mode.STOPPED)

    def test_a_refusal_never_takes_the_mark_of_a_request_that_was_granted(self):
        daemon = self.daemon()
        self.start("arm", "sim")
        with foretrace.attach() as outside:
            self.armed(outside)
            decided = time.monotonic_ns()
            outside.stop()

            def marked():
                """One request that a stop has made void, and one that is granted, while the daemon takes neither."""
                ft, told = foretrace.attach(), {}

                def ask(name, **options):
                    try:
                        told[name] = ft.arm(timeout=8.0, **options)
                    except foretrace.Problem as problem:
                        told[name] = problem

                daemon.send_signal(signal.SIGSTOP)
                asking = [threading.Thread(target=ask, args=("void",), kwargs={"decided_ns": decided}), threading.Thread(target=ask, args=("new",))]
                for thread in asking:
                    thread.start()
                    time.sleep(0.1)
                daemon.send_signal(signal.SIGCONT)
                for thread in asking:
                    thread.join()
                stopped = ft.close()
                self.assertIsInstance(told["void"], foretrace.Refused)
                # A busy machine may have a reason of its own to refuse.
                return None if isinstance(told["new"], foretrace.Refused) else (told["new"], stopped)

            answer, stopped = until("a request is granted", marked, timeout=60.0)
            self.assertIsInstance(answer, foretrace.Answer)
            self.assertTrue(stopped)
            self.assertEqual(outside.query().mode, Mode.STOPPED)

    def test_a_request_that_was_not_sent_sets_no_mark(self):
        daemon = self.daemon()
        self.start("arm", "sim")
        with foretrace.attach() as outside, foretrace.attach() as ft:
            self.armed(outside)
            # All places of operators are in use.
            daemon.send_signal(signal.SIGSTOP)

            def wait():
                try:
                    outside.query(timeout=6.0)
                except foretrace.Problem:
                    pass

            waiting = [threading.Thread(target=wait) for _ in range(4)]
            for thread in waiting:
                thread.start()
            time.sleep(0.5)
            with self.refuses(foretrace.Taken, "operator"):
                ft.arm(timeout=0.5)
            daemon.send_signal(signal.SIGCONT)
            for thread in waiting:
                thread.join()
            self.assertFalse(ft.close())

    def test_a_stop_that_failed_is_tried_again(self):
        daemon = self.daemon()
        self.start("arm", "sim")
        with foretrace.attach() as outside:
            ft = foretrace.attach()
            self.armed(ft)
            daemon.send_signal(signal.SIGSTOP)
            with self.refuses(foretrace.NoAnswer, "stop button"):
                ft.close()
            daemon.send_signal(signal.SIGCONT)
            self.assertTrue(ft.close())
            self.assertEqual(outside.query().mode, Mode.STOPPED)
            self.assertFalse(ft.close())

    def test_a_closed_attachment_and_its_handles_say_so(self):
        self.daemon()
        with foretrace.attach() as ft:
            pen = ft.pen()
            records = ft.records("ticks")
        ft.close()
        with self.refuses(foretrace.Problem, "attachment is closed", "attach again"):
            ft.query()
        with self.refuses(foretrace.Problem, "closed"):
            ft.pen()
        with self.refuses(foretrace.Problem, "pen is closed"):
            pen.send(0.0, 0.0, True)
        with self.refuses(foretrace.Problem, "watch is closed"):
            records.drain_records()

    def test_statuses_come_and_ticks_come_in_bulk(self):
        self.daemon()
        with foretrace.attach() as ft:
            ticks = ft.records("ticks")
            watch = ft.watch()
            stamps = [next(watch).header.stamp_ns for _ in range(5)]
            self.assertEqual(stamps, sorted(set(stamps)))
            records = ticks.drain_records(timeout=2.0)
            numbers = [record.tick for record in records]
            self.assertGreater(len(numbers), 50)
            self.assertEqual(numbers, list(range(numbers[0], numbers[0] + len(numbers))))
            self.assertEqual((ticks.lost, ticks.refused), (0, 0))
            try:
                import numpy
            except ImportError:
                with self.refuses(foretrace.Problem, "numpy is not installed", "drain_records"):
                    ticks.drain()
            else:
                array = ticks.drain(timeout=1.0)
                self.assertIsInstance(array, numpy.ndarray)
                self.assertGreater(int(array["tick"][0]), numbers[-1])
            with self.refuses(foretrace.Invalid, '"nothing" cannot be watched', "ticks, pen, joints or commands"):
                ft.records("nothing")
            # There are places for a few watchers only.
            with self.refuses(foretrace.Taken, "slots"):
                for _ in range(10):
                    ft.records("ticks")

    def test_a_pace_loses_whole_periods_and_never_catches_up(self):
        begin = time.monotonic()
        pace = foretrace.Pace(100)
        counts = []
        for count in pace:
            counts.append(count)
            if len(counts) == 3:
                time.sleep(0.055)
            if len(counts) == 6:
                break
        self.assertEqual(counts[:3], [0, 1, 2])
        self.assertGreaterEqual(counts[3], 7)
        self.assertEqual(pace.skipped, counts[3] - 3 + (counts[5] - counts[3] - 2))
        self.assertGreaterEqual(time.monotonic() - begin, counts[5] * 0.01)
        with self.refuses(foretrace.Invalid, "rate_hz"):
            foretrace.Pace(0.0)


if __name__ == "__main__":
    unittest.main()
