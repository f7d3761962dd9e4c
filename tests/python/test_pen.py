"""Pens: through shared memory, through a gateway; two of them; what is refused."""

import math
import os
import sys
import time
import unittest

import foretrace
from foretrace.messages import PenFlags
from world import World, until


class Pens(World):
    def test_samples_arrive_as_they_were_sent(self):
        self.daemon()
        with foretrace.attach() as ft, ft.pen(name="circle") as pen:
            watch = ft.records("pen")
            until("the daemon hears", lambda: pen.send(0.01, 0.02, True))
            watch.drain_records()
            stamp = time.monotonic_ns()
            self.assertTrue(pen.send(0.03, -0.04, True, stamp=stamp, pressure=0.25, tilt=(0.1, -0.2)))
            self.assertTrue(pen.send(0.03, -0.04, False, flags=PenFlags.IN_RANGE | PenFlags.BUTTON_1))
            first, second = until("both", lambda: (got := watch.drain_records(0.5)) and len(got) == 2 and got)
            self.assertEqual((first.x_m, first.y_m, first.device_stamp_ns), (0.03, -0.04, stamp))
            self.assertEqual((first.pressure, first.flags), (0.25, PenFlags.CONTACT | PenFlags.IN_RANGE))
            self.assertAlmostEqual(first.tilt_y_rad, -0.2, places=6)
            self.assertEqual((second.pressure, second.flags), (-1.0, PenFlags.IN_RANGE | PenFlags.BUTTON_1))

            stamps = [time.monotonic_ns() - back for back in (3_000_000, 2_000_000, 1_000_000)]
            self.assertEqual(pen.send_many([0.0, 0.01, 0.02], (0.0, 0.0, 0.0), True, stamps, [0.1, 0.2, 0.3]), 3)
            got = until("three", lambda: (got := watch.drain_records(0.5)) and len(got) == 3 and got)
            self.assertEqual([(one.x_m, one.device_stamp_ns) for one in got], list(zip([0.0, 0.01, 0.02], stamps)))
            try:
                import numpy
            except ImportError:
                pass
            else:
                stamps = numpy.array([time.monotonic_ns() - 1000, time.monotonic_ns()])
                self.assertEqual(pen.send_many(numpy.zeros(2), numpy.zeros(2), numpy.array([True, False]), stamps), 2)
                # One number of numpy stands for all, as one of Python does.
                now = time.monotonic_ns()
                self.assertEqual(pen.send_many(numpy.zeros(2), numpy.zeros(2), numpy.bool_(True), [now, now]), 2)
            watch.drain_records(0.5)
            stamps = [time.monotonic_ns(), time.monotonic_ns()]
            tilts, flags = [(0.1, 0.2), (0.3, -0.4)], [PenFlags.BUTTON_1, PenFlags.IN_RANGE]
            self.assertEqual(pen.send_many([0.0, 0.0], [0.0, 0.0], False, stamps, tilt=tilts, flags=flags), 2)
            got = until("both", lambda: (got := watch.drain_records(0.5)) and len(got) == 2 and got)
            self.assertEqual([one.flags for one in got], flags)
            self.assertAlmostEqual(got[1].tilt_y_rad, -0.4, places=6)
            holder = self.ask("status").stdout
            self.assertIn("circle", holder)

    def test_what_is_no_sample_is_refused_with_bound_and_unit(self):
        self.daemon()
        with foretrace.attach() as ft, ft.pen() as pen:
            watch = ft.records("pen")
            until("the daemon hears", lambda: pen.send(0.0, 0.0, True))
            for bad in (math.nan, math.inf, -math.inf):
                with self.refuses(foretrace.Invalid, "x_m"):
                    pen.send(bad, 0.0, True)
            # Millimetres instead of metres.
            with self.refuses(foretrace.Invalid, "y_m = 150", "10", " m"):
                pen.send(0.0, 150.0, True)
            with self.refuses(foretrace.Invalid, "pressure"):
                pen.send(0.0, 0.0, True, pressure=1024)
            with self.refuses(foretrace.Invalid, "tilt_x_rad"):
                pen.send(0.0, 0.0, True, tilt=(45.0, 0.0))
            for tilt in (5, (0.1,), (0.1, 0.2, 0.3), "left"):
                with self.refuses(foretrace.Invalid, "tilt"):
                    pen.send(0.0, 0.0, True, tilt=tilt)
            with self.refuses(foretrace.Invalid, "x is 1"):
                pen.send(10**400, 0.0, True)
            # Python writes no number of so many digits.
            with self.refuses(foretrace.Invalid, "x is a int of thousands of digits"):
                pen.send(10**5000, 0.0, True)
            for flags in (1 << 20, -1, 1 << 40, 0.5, 5.0, 10**5000):
                with self.refuses(foretrace.Invalid, "flags"):
                    pen.send(0.0, 0.0, True, flags=flags)
            with self.refuses(foretrace.Invalid, "tilt has 1 values, x has 2"):
                pen.send_many([0.0, 0.0], [0.0, 0.0], True, [1, 2], tilt=[(0.0, 0.0)])
            # The time of day, and a clock that began elsewhere.
            with self.refuses(foretrace.Invalid, "in the future", "time.monotonic_ns()", "time.time_ns()"):
                pen.send(0.0, 0.0, True, stamp=time.time_ns())
            with self.refuses(foretrace.Invalid, "old"):
                pen.send(0.0, 0.0, True, stamp=5_000)
            for stamp in (-1, 1.5, 5.0, "now", 2**80, 10**5000):
                with self.refuses(foretrace.Invalid, "stamp"):
                    pen.send(0.0, 0.0, True, stamp=stamp)
            with self.refuses(foretrace.Invalid, "x is left; legal: a number [m]"):
                pen.send("left", 0.0, True)
            with self.refuses(foretrace.Invalid, "y has 1 values, x has 2"):
                pen.send_many([0.0, 0.0], [0.0], True, [1, 2])
            now = time.monotonic_ns()
            with self.refuses(foretrace.Invalid, "x_m") as refused:
                pen.send_many([0.0, math.nan, 0.0], [0.0] * 3, True, [now, now + 1, now + 2])
            self.assertEqual(refused.error.sent, 1)
            with self.refuses(foretrace.Invalid, "clock = 'sundial'", "monotonic, realtime or device"):
                ft.pen(clock="sundial")
            time.sleep(0.1)
            self.assertEqual([one.x_m for one in watch.drain_records()], [0.0, 0.0])

    def test_stamps_of_other_clocks_are_mapped(self):
        self.daemon()
        with foretrace.attach() as ft:
            watch = ft.records("pen")
            with ft.pen(clock="realtime") as pen:
                until("the daemon hears", lambda: pen.send(0.0, 0.0, True))
                watch.drain_records()
                before = time.monotonic_ns()
                pen.send(0.0, 0.0, True, stamp=time.time_ns())
                after = time.monotonic_ns()
                (got,) = until("one", lambda: watch.drain_records(0.5))
                self.assertTrue(before - 1_000_000 <= got.device_stamp_ns <= after + 1_000_000)
            with ft.pen(clock="device") as pen:
                sent = []
                # A counter that began at 7 s; every fourth sample comes 4 ms late.
                begin = time.monotonic_ns()
                for count in range(40):
                    there = time.monotonic_ns()
                    if count % 4 == 1:
                        time.sleep(0.004)
                    pen.send(0.0, 0.0, True, stamp=7_000_000_000 + there - begin)
                    sent.append(there)
                    time.sleep(0.002)
                got = until("all", lambda: (got := watch.drain_records(0.5)) and got)
                errors = [one.device_stamp_ns - there for one, there in zip(got[-20:], sent[-20:])]
                self.assertLess(max(abs(error) for error in errors), 2_000_000, errors)
                stamps = [one.device_stamp_ns for one in got]
                self.assertEqual(stamps, sorted(set(stamps)))

    def test_of_two_pens_the_second_is_refused_with_the_name_of_the_first(self):
        self.daemon()
        with foretrace.attach() as ft:
            with ft.pen():
                # The file of this program, or what stands for one without.
                with self.refuses(foretrace.Taken, os.path.basename(sys.argv[0]) or "python", str(os.getpid())):
                    ft.pen(name="second")
            first = ft.pen(name="first")
            with self.refuses(foretrace.Taken, "first", str(os.getpid())):
                ft.pen(name="second")
            second = ft.pen(name="second", take_over=2.0)
            self.assertIn("second", until("handed over", first.handed_to))
            with self.refuses(foretrace.Taken, "second"):
                first.send(0.0, 0.0, True)
            second.send(0.0, 0.0, True)
            second.close()
            ft.pen(name="third").close()
            with ft.dead_man(name="pedal") as switch:
                switch.beat()
                with self.refuses(foretrace.Taken, "pedal"):
                    ft.dead_man()
                switch.stop()

    def test_a_gateway_takes_the_same_calls(self):
        self.daemon()
        path = f"{self.folder}/pen.socket"
        with self.refuses(foretrace.NoDaemon, path, "foretrace gateway"):
            foretrace.gateway(path)
        self.start("gateway", "--socket", path, "--allow-uid", str(os.getuid()))
        until("the gateway listens", lambda: os.path.exists(path))
        with foretrace.attach() as ft:
            watch = ft.records("pen")
            gateway = foretrace.gateway(path)
            self.assertTrue(gateway.send(0.01, 0.02, True))
            with self.refuses(foretrace.Invalid, "x_m"):
                gateway.send(math.nan, 0.0, True)
            now = time.monotonic_ns()
            self.assertEqual(gateway.send_many([0.02, 0.03], [0.0, 0.0], True, [now, now + 1]), 2)
            got = until("all", lambda: (got := watch.drain_records(0.5)) and got)
            self.assertEqual(got[0].x_m, 0.01)
            self.assertIn("3 samples", gateway.close())
            self.assertIsNone(gateway.close())
            with self.refuses(foretrace.NoDaemon, "closed", "connect again"):
                gateway.send(0.0, 0.0, True)


if __name__ == "__main__":
    unittest.main()
