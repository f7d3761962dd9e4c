"""Recordings from Python: the numbers and the words are those of the command."""

import csv
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import unittest
import warnings
from unittest import mock

import foretrace
from support import Scratch, kept, mcap, needs_numpy, numpy, recording, run

# A script in the background has its children ignore Ctrl-C; those of the tests obey it.
signal.signal(signal.SIGINT, signal.default_int_handler)


class Read(Scratch):
    def exported(self, topic, *options):
        path = self.path("export.csv")
        run("export", "--csv", path, "--topic", topic, *options, recording())
        with open(path, newline="", encoding="utf-8") as file:
            header, *rows = csv.reader(file)
        return header, rows

    def test_info_and_settings_are_those_of_the_command(self):
        found = foretrace.read(recording())
        told = json.loads(run("record", "--info", recording(), "--json", "-"))
        for key in ("begin", "end", "topics", "foreign", "seconds", "missing_ticks", "states", "daemons", "damage"):
            self.assertEqual(found.info[key], told[key], key)
        self.assertEqual(list(found.info["ticks"]), told["ticks"])
        self.assertIn(f"rate_hz = {found.settings['loop']['rate_hz']}", found.settings_text)
        self.assertEqual({piece.kind for piece in found.pieces}, {"settings", "state", "weights", "law"})
        self.assertEqual([piece.number for piece in found.pieces if piece.kind == "state"], told["states"])
        self.assertTrue(all(piece.data for piece in found.pieces))

    def test_every_exported_number_is_in_the_columns_bit_for_bit(self):
        for topic in ("/raw/input", "/raw/tick", "/raw/status"):
            header, rows = self.exported(topic)
            os.remove(self.path("export.csv"))
            found = foretrace.read(recording()).topic(topic)
            self.assertEqual(len(found), len(rows))
            self.assertEqual(found.column("time_ns"), [int(row[0]) for row in rows])
            compared = 0
            for at, name in enumerate(header[1:], 1):
                field, _, rest = name.split(" ")[0].partition("[")
                if field == "stage_ns":
                    # Its entries have names there.
                    continue
                if rest and not rest.endswith("]"):
                    field, rest = name.split(" ")[0], ""
                index = int(rest.rstrip("]")) if rest else None
                for value, row in zip(found.column(field), rows):
                    value = value if index is None else value[index]
                    told = type(value)(row[at])
                    if value != told:
                        # Of numbers with 32 bits there are as many digits as those need.
                        self.assertEqual(struct.pack("<f", value), struct.pack("<f", told), f"{topic} {name}")
                        self.assertEqual(struct.unpack("<f", struct.pack("<f", value))[0], value)
                    compared += 1
            self.assertGreater(compared, 20 * len(rows))

    @needs_numpy
    def test_arrays_hold_the_columns(self):
        found = foretrace.read(recording())
        self.assertEqual(set(found), {"/raw/input", "/raw/tick", "/raw/status"})
        ticks, topic = found["/raw/tick"], found.topic("/raw/tick")
        self.assertEqual(list(ticks.dtype.names), topic.columns)
        self.assertEqual(ticks["q"].shape, (len(topic), 6))
        for name in ("tick", "time_ns", "trust", "q", "stage_ns", "mode"):
            self.assertEqual(ticks[name].tolist(), [list(v) if isinstance(v, tuple) else v for v in topic.column(name)])
        self.assertTrue((numpy.diff(ticks["tick"].astype(int)) > 0).all())
        every = found.topic("/raw/tick", every=10)
        self.assertEqual(every.column("tick"), topic.column("tick")[::10])

    def test_without_numpy_arrays_say_what_to_do(self):
        if numpy is not None:
            self.skipTest("numpy is installed")
        with self.assertRaisesRegex(foretrace.Problem, "pip install numpy"):
            foretrace.read(recording())["/raw/tick"]
        self.assertGreater(len(foretrace.read(recording()).topic("/raw/tick").column("q")), 100)

    def test_the_pen_is_the_exported_one(self):
        path = self.path("pen.csv")
        run("export", "--pen", path, recording())
        with open(path, encoding="utf-8") as file:
            rows = [line.split(",") for line in file if line[0].isdigit() or line[0] == "-"]
        pen = foretrace.read(recording()).pen
        pen = pen.tolist() if hasattr(pen, "tolist") else pen
        self.assertEqual(len(pen), len(rows))
        self.assertGreater(len(pen), 500)
        for (stamp, x, y, contact), row in zip(pen, rows):
            self.assertAlmostEqual(x, float(row[1]), delta=5.1e-8)
            self.assertAlmostEqual(y, float(row[2]), delta=5.1e-8)
            self.assertEqual(contact, row[3].strip() == "1")
        self.assertEqual(sorted(stamp for stamp, *_ in pen), [stamp for stamp, *_ in pen])

    def test_stops_moments_and_ticks_are_told_as_by_explain(self):
        found = foretrace.read(recording())
        told = json.loads(run("explain", recording(), "--json", "-"))
        self.assertEqual([m.__dict__ for m in found.moments], told["moments"])
        [stop] = [m for m in told["moments"] if m["what"].startswith("it stopped")]
        [own] = found.stops
        self.assertEqual((own.tick, own.after_s), (stop["tick"], stop["after_s"]))
        self.assertEqual(f"it stopped: {own.text}", stop["what"])
        self.assertEqual((own.reason, own.joint), ("requested", None))
        said = run("explain", recording(), "--tick", own.tick)
        for sentence in found.explain(own.tick):
            self.assertIn(sentence, said)

    def test_messages_of_others_formats_are_bytes_with_their_schema(self):
        topic = foretrace.read(recording()).topic("/log")
        self.assertEqual(topic.encoding, "protobuf")
        messages = topic.messages
        self.assertEqual(len(messages), len(topic))
        self.assertTrue(any(b"armed" in message.data for message in messages))
        self.assertIn(b"foxglove", topic.schema)
        with self.assertRaisesRegex(foretrace.Problem, "take `messages`"):
            topic.columns
        raw = foretrace.read(recording()).topic("/raw/input")
        self.assertEqual({len(message.data) for message in raw.messages}, {912})


class Refused(Scratch):
    def test_unknown_topics_and_fields_name_those_that_there_are(self):
        found = foretrace.read(recording())
        with self.assertRaisesRegex(KeyError, "no such topic; topics with columns: .*/raw/tick"):
            found["/tick2"]
        with self.assertRaisesRegex(KeyError, "/tf: .*take topic.name..messages"):
            found["/tf"]
        for name, there in [("/tf", False), ("/tick2", False), ("/raw/thing", False), (5, False), ("/raw/tick", True)]:
            self.assertEqual(name in found, there, name)
        self.assertIsNone(found.get("/tf"))
        with self.assertRaisesRegex(foretrace.Invalid, "no message of /tick2; there are .*/raw/tick"):
            found.topic("/tick2")
        with self.assertRaisesRegex(foretrace.Invalid, "every is 0"):
            found.topic("/raw/tick", every=0)
        for every in (-1, 1 << 64):
            with self.assertRaisesRegex(foretrace.Invalid, f"every is {every}; legal"):
                found.topic("/raw/tick", every=every)
        with self.assertRaisesRegex(foretrace.Invalid, "tick is -1; legal"):
            found.explain(-1)
        with self.assertRaisesRegex(KeyError, "no field nothing; there are: time_ns"):
            found.topic("/raw/tick").column("nothing")

    def test_what_is_no_recording_is_a_problem(self):
        cases = [
            (self.path("missing.mcap"), "cannot read"),
            (self.folder, "folder|directory"),
            (self.write("empty.mcap", ""), "empty"),
            (self.write("text.mcap", "t_s,x_m,y_m,contact\n0,0,0,1\n"), "CSV"),
            (self.write("noise.mcap", bytes(range(256)) * 20), "no recording"),
        ]
        for path, why in cases:
            for work in (foretrace.read, foretrace.replay, lambda p: foretrace.replay(p, what_if="trust=0")):
                with self.assertRaisesRegex(foretrace.Problem, why):
                    work(path)

    def test_a_file_that_ends_early_gives_what_comes_before(self):
        with open(recording(), "rb") as file:
            data = file.read()
        whole = foretrace.read(recording())
        path = self.write("cut.mcap", data[: len(data) // 2])
        with self.assertWarnsRegex(foretrace.recordings.RecordingRemark, "ends early, .*--repair"):
            cut = foretrace.read(path)
        ticks = cut.topic("/raw/tick").column("tick")
        self.assertEqual(ticks, whole.topic("/raw/tick").column("tick")[: len(ticks)])
        self.assertGreater(len(ticks), 100)
        again = cut.replay()
        self.assertTrue(again.same and again.damage, again)

    def forged(self, table, message=bytes(16)):
        channel = ("/raw/tick", "foretrace.wire", ("TickRecord", "foretrace.wire", table), [(7, message)])
        return foretrace.read(self.write("forged.mcap", mcap([channel])))

    def test_layouts_that_are_forged_are_problems(self):
        head = b"layout 0123456789abcdef size 16\n"
        for table, why in [
            (b"", "names no size"), (b"layout x size many\n", "names no size"), (b"\xff\n", "no text"),
            (head + b"a 0 8 f64\na 8 8 f64\n", 'two fields "a"'), (head + b"time_ns 0 8 u64\n", "time_ns has the name"),
            (head + b"a 8 16 f64*2\n", '"a" does not lie'), (head + b"a 0 8 f64*99999999999999999999\n", '"a" does not lie'),
            (head + b"a 0 16 f64*2305843009213693954\n", '"a" does not lie'), (head + b"a 0 8 f64*x\n", '"a" does not lie'),
            (head + b"a 0 0 bytes\n", '"a" does not lie'), (head + b"a -1 8 f64\n", '"a" does not lie'),
            (head + b"a 18446744073709551615 8 f64\n", '"a" does not lie'), (head + b" 0 8 f64\n", '"" does not lie'),
            (head + b"a 0 8\n", '"a" does not lie'), (head + b"a 0 4 f64\n", '"a" does not lie'),
            (head + b"".join(b"f%d 0 1 u8\n" % n for n in range(5000)), "more than 4096 fields"),
            (head + b"x" * 5000 + b" 0 8\n", '"x{50,60}.{0,4}" does not lie'),
        ]:
            with self.assertRaisesRegex(foretrace.Problem, f"the layout of /raw/tick is damaged: .*{why}"):
                self.forged(table).topic("/raw/tick")
        for message in (b"", bytes(15), bytes(32)):
            with self.assertRaisesRegex(foretrace.Problem, "/raw/tick"):
                self.forged(head + b"a 0 8 f64\n", message).topic("/raw/tick")

    def test_fields_that_are_no_numbers_are_bytes(self):
        table = b"layout 0123456789abcdef size 16\nis 0 2 bool\nname 2 6 bytes\nodd 2 4 bool*4\nx 8 8 f64\n"
        found = self.forged(table, b"\1\0abcdef" + struct.pack("<d", 0.25))
        topic = found.topic("/raw/tick")
        self.assertEqual(topic.columns, ["time_ns", "is", "name", "odd", "x"])
        self.assertEqual([topic.column(name) for name in topic.columns], [[7], [(1, 0)], [tuple(b"abcdef")], [tuple(b"abcd")], [0.25]])
        if numpy is not None:
            row = found["/raw/tick"][0]
            self.assertEqual((row["time_ns"], bytes(row["name"]), row["x"]), (7, b"abcdef", 0.25))

    def test_what_is_too_much_for_the_memory_names_the_remedy(self):
        found = foretrace.read(recording())
        size = len(found.topic("/raw/tick")._data)
        with mock.patch("foretrace.recordings.MOST_BYTES", size // 2):
            with self.assertRaisesRegex(foretrace.Problem, f"more than {size // 2} bytes; .*every=n"):
                foretrace.read(recording()).topic("/raw/tick")
            self.assertGreater(len(foretrace.read(recording()).topic("/raw/tick", every=3)), 100)
        with mock.patch("foretrace.recordings.MOST_BYTES", 1000):
            for work in (lambda run: run.pieces, lambda run: run.pen, lambda run: run.stops):
                with self.assertRaisesRegex(foretrace.Problem, "more than 1000 bytes; set foretrace.recordings.MOST_BYTES"):
                    work(foretrace.read(recording()))

    def test_a_stop_before_the_recording_began_is_none_of_its_stops(self):
        found = foretrace.read(recording())
        [stop] = found.stops
        topic = found.topic("/raw/tick")
        schema = (topic.schema_name, "foretrace.wire", topic.schema)
        messages = [(message.time_ns, message.data) for message in topic.messages]
        at = topic.column("tick").index(stop.tick)
        for begin, stops in ((at - 1, [stop.tick]), (at, []), (at + 1, [])):
            path = self.write("late.mcap", mcap([("/raw/tick", "foretrace.wire", schema, messages[begin : at + 50])]))
            self.assertEqual([own.tick for own in foretrace.read(path).stops], stops)

    def test_bytes_that_are_changed_never_end_the_interpreter(self):
        with open(recording(), "rb") as file:
            data = bytearray(file.read(400_000))
        state = 12345
        for case in range(60):
            broken = bytearray(data)
            for _ in range(8):
                state = (1103515245 * state + 12345) % (1 << 31)
                broken[state % len(broken)] = (state >> 8) % 256
            path = self.write(f"{case}.mcap", bytes(broken))
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    found = foretrace.read(path)
                for topic in found.info["topics"]:
                    found.topic(topic)
                found.stops, found.pieces, found.pen
                found.replay()
            except foretrace.Problem as error:
                self.assertGreater(len(str(error)), 10)

    def test_recordings_of_other_versions_are_read_and_not_replayed(self):
        versions = 0
        for path in kept():
            found = foretrace.read(path)
            topic = found.topic("/raw/input")
            self.assertEqual(len(topic), found.info["topics"]["/raw/input"])
            self.assertEqual(topic.column("tick"), list(range(topic.column("tick")[0], topic.column("tick")[-1] + 1)))
            self.assertGreater(len(found.pen), 0)
            if found.info["foreign"]:
                versions += 1
                with self.assertRaisesRegex(foretrace.OtherVersion, "another layout"):
                    found.replay()
        self.assertGreater(versions, 0)


class Replay(unittest.TestCase):
    def test_a_replay_says_what_the_command_says(self):
        found = foretrace.replay(recording())
        said = run("replay", recording())
        told = json.loads(run("replay", recording(), "--json", "-"))
        self.assertTrue(found.same, found)
        self.assertIn(f"{recording()}: {found.summary}\n{found.verdict}\n", said)
        for key, value in told.items():
            if key not in ("end", "difference", "same_build"):
                self.assertEqual(getattr(found, key), value, key)
        self.assertEqual((found.end, found.difference), (told["end"], None))

    def test_what_if_has_the_commands_figures_to_the_last_bit(self):
        variants = ["predictor=hold", {"predictor": "constant-velocity", "trust": 0.5, "mpc": {"velocity_lead_ms": 10.0}}]
        found = foretrace.replay(recording(), what_if=variants)
        text = found.rows[-1].name
        self.assertEqual(text, "predictor=constant-velocity,trust=0.5,mpc.velocity_lead_ms=10.0")
        told = json.loads(run("replay", recording(), "--what-if", variants[0], "--what-if", text, "--json", "-"))
        self.assertEqual([row.name for row in found.rows], [row["name"] for row in told["rows"]])
        for own, row in zip(found.rows, told["rows"]):
            for key, value in row.items():
                self.assertEqual(getattr(own, key), value, (own.name, key))
        self.assertEqual((found.arm.__dict__, found.arm_misfit_mm), (told["arm"], told["arm_misfit_mm"]))
        self.assertGreater(found["predictor=hold"].rms_mm, found.rows[1].rms_mm)
        self.assertGreater(len(found.rows[0].error_mm), 10)
        self.assertGreater(len(found.stroke), 10)

    def test_variants_that_mean_nothing_are_refused(self):
        for what_if, why in [
            ("trust", "KEY=VALUE"),
            ({"predictor": "ours-of-nobody"}, "ours-of-nobody"),
            ({"loop.rate": 5}, "loop.rate"),
            ({"mpc": {"horizon": 11}}, "horizon"),
            ([], "at least one"),
            ([3], "int; legal"),
            ({"a b": 1}, "legal: letters"),
        ]:
            with self.assertRaisesRegex(foretrace.Invalid, why):
                foretrace.replay(recording(), what_if=what_if)


class Waits(unittest.TestCase):
    def test_other_threads_go_on_while_a_replay_runs(self):
        path, steps, ends = recording(), [], threading.Event()

        def count():
            while not ends.is_set():
                steps.append(time.monotonic())
                time.sleep(0.002)

        thread = threading.Thread(target=count)
        thread.start()
        begin = time.monotonic()
        try:
            foretrace.replay(path)
        finally:
            end = time.monotonic()
            ends.set()
            thread.join()
        during = [t for t in steps if begin <= t <= end]
        self.assertGreater(len(during), (end - begin) / 0.05, "the lock was held")

    def test_ctrl_c_ends_a_long_wait(self):
        script = (
            "import foretrace, sys\nprint('begun', flush=True)\n"
            f"while True: foretrace.replay({recording()!r}, what_if=['trust=0', 'trust=1', 'predictor=hold'])\n"
        )
        child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.addCleanup(child.kill)
        self.assertEqual(child.stdout.readline(), "begun\n")
        time.sleep(0.5)
        child.send_signal(signal.SIGINT)
        begin = time.monotonic()
        _, error = child.communicate(timeout=20)
        self.assertLess(time.monotonic() - begin, 5.0)
        self.assertIn("KeyboardInterrupt", error)


if __name__ == "__main__":
    unittest.main()
