"""A predictor in Python: what it is given, what becomes of its previews, what is refused."""

import math
import threading
import time
import unittest

import foretrace
from foretrace.messages import PenMotion, PenStep, PreviewRefusal
from world import Hand, World, until


def refused(ft, reason):
    return ft.status().external.refused[reason - 1]


class Predictors(World):
    settings = [*World.settings, "--set", "predictor.kind=external"]

    def test_steps_come_in_order_and_previews_in_time_are_taken(self):
        self.daemon("--set", "predictor.external.fallback=hold")
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:
            hand = Hand(ft)
            indices, answered, deadline = [], 0, time.monotonic() + 60.0
            external = None
            while external is None:
                self.assertLess(time.monotonic(), deadline, f"{answered} answered, {ft.status().external}")
                step = predictor.next(timeout=1.0)
                if step is None:
                    continue
                self.assertIsInstance(step, PenStep)
                self.assertTrue(1 <= step.wanted <= 64 and step.scale_m > 0.0)
                self.assertLess(math.hypot(step.x_m, step.y_m), 0.2)
                if step.motion == PenMotion.CONTINUES:
                    indices.append(step.index)
                ahead = [(step.x_m + i * step.dx_m, step.y_m + i * step.dy_m) for i in range(1, step.wanted + 1)]
                answered += predictor.send(step, ahead)
                if answered % 50 == 0:
                    state = ft.status().external
                    # Straight on is better than to stand still: it earns a part in the preview.
                    external = state if state.taken > 100 and state.weight > 0.0 else None
            self.assertGreaterEqual(external.evidence, 0.0)
            self.assertGreater(external.latency.p50_ns, 0)
            self.assertTrue(all(after > before for before, after in zip(indices, indices[1:])))
            hand.end()
            self.assertIsNone(hand.error)

    def test_a_thread_that_waits_for_a_step_holds_nobody_up(self):
        self.daemon()
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:
            # No pen: no step comes.
            waiting = threading.Thread(target=lambda: predictor.next(timeout=8.0))
            waiting.start()
            time.sleep(0.2)
            begin = time.monotonic()
            for _ in range(60):
                predictor.send(5, [(0.0, 0.0)] * 40)
            self.assertLess(time.monotonic() - begin, 1.0)
            self.assertTrue(waiting.is_alive())
            waiting.join()

    def test_steps_that_found_no_room_are_counted(self):
        self.daemon()
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:
            self.assertEqual(predictor.lost, 0)
            hand = Hand(ft)
            first = until("a step", predictor.next)
            # Nobody reads: 256 of them wait, and the oldest make room.
            until("a step was lost", lambda: predictor.lost >= 20)
            before = predictor.lost
            step = predictor.next()
            self.assertGreater(step.index, first.index + before)
            kept = predictor.lost
            while predictor.next(timeout=0.0):
                pass
            self.assertLess(predictor.lost - kept, 20, "who reads loses no more")
            hand.end()
            self.assertIsNone(hand.error)

    def test_what_is_wrong_is_named_here_or_counted_there(self):
        self.daemon()
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:
            with self.refuses(foretrace.Taken, "the predictor's place"):
                ft.predictor_interface()
            self.assertIsNone(predictor.next(timeout=0.1))
            with self.refuses(foretrace.Invalid, "0 positions", "1 to 64"):
                predictor.send(5, [])
            with self.refuses(foretrace.Invalid, "65 positions"):
                predictor.send(5, [(0.0, 0.0)] * 65)
            with self.refuses(foretrace.Invalid, "radii"):
                predictor.send(5, [(0.0, 0.0)] * 40, [0.001])
            for number in (math.nan, math.inf):
                with self.refuses(foretrace.Invalid, "y 2 of the preview"):
                    predictor.send(5, [(0.0, 0.0), (0.0, 0.0), (0.0, number)])
            with self.refuses(foretrace.Invalid, "pairs of numbers"):
                predictor.send(5, [1.0, 2.0])
            for index in (-1, 2**64, 10**5000):
                with self.refuses(foretrace.Invalid, "index"):
                    predictor.send(index, [(0.0, 0.0)])
            for step in (1.5, 5.0, "5", None):
                with self.refuses(foretrace.Invalid, "step"):
                    predictor.send(step, [(0.0, 0.0)])
            with self.refuses(foretrace.Invalid, "pairs of numbers"):
                predictor.send(5, [(10**400, 0.0)])
            hand = Hand(ft)
            step = until("a step", predictor.next)
            predictor.send(step.index + 1000, [(0.0, 0.0)] * 64)
            until("ahead is counted", lambda: refused(ft, PreviewRefusal.AHEAD) == 1)
            step = until("a step", predictor.next)
            # The newest: an older one is late first.
            while newer := predictor.next(timeout=0.0):
                step = newer
            predictor.send(step, [(0.0, 0.0)] * 2)
            until("too few is counted", lambda: refused(ft, PreviewRefusal.MALFORMED) == 1)
            time.sleep(0.2)
            predictor.send(step, [(0.0, 0.0)] * 64)
            until("late is counted", lambda: refused(ft, PreviewRefusal.LATE) == 1)
            try:
                import numpy
            except ImportError:
                pass
            else:
                predictor.send(numpy.int64(step.index), numpy.zeros((64, 2)))
                until("late is counted again", lambda: refused(ft, PreviewRefusal.LATE) == 2)
            hand.end()

    def test_the_place_outlives_a_daemon_and_is_free_after_its_end(self):
        daemon = self.daemon()
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:
            self.kill(daemon)
            self.assertIsNone(predictor.next(timeout=0.3))
            self.daemon()
            hand = None
            with foretrace.attach() as again:
                hand = Hand(again)
                step = until("a step of the new daemon", lambda: predictor.next(timeout=0.2))
                until("heard", lambda: predictor.send(step, [(step.x_m, step.y_m)] * 64))
                hand.end()
        with foretrace.attach() as ft, ft.predictor_interface() as predictor:

            def wait():
                with self.refuses(foretrace.Problem, "closed"):
                    predictor.next(5.0)

            waiting = threading.Thread(target=wait)
            waiting.start()
            predictor.close()
            waiting.join(10.0)
            self.assertFalse(waiting.is_alive())
            with self.refuses(foretrace.Problem, "closed"):
                predictor.send(1, [(0.0, 0.0)])


if __name__ == "__main__":
    unittest.main()
