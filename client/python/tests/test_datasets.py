"""Data sets from Python: every format, positions in metres, what readers remark; and the converters."""

import json
import math
import os
import tracemalloc
import unittest
import warnings
from unittest import mock

import foretrace
from foretrace import _ink, datasets
from support import Scratch, data, needs_numpy, numpy, recording

CSV = "t_s,x_m,y_m,contact\n" + "".join(f"{0.005 * k:.3f},{1e-4 * k:.7f},0.01,{int(k < 6)}\n" for k in range(10))
INKML = (
    '<ink xmlns="http://www.w3.org/2003/InkML"><traceFormat><channel name="X" type="decimal" units="mm"/>'
    '<channel name="Y" type="decimal" units="mm"/><channel name="T" type="decimal" units="ms"/></traceFormat>'
    '<traceGroup><annotation type="truth">a</annotation><annotation type="writer">w7</annotation>'
    "<trace>1 2 0,2 4 10,3 6 20,4 8 30</trace><trace>5 5 100,6 5 110,7 5 120</trace></traceGroup></ink>"
)
UNIPEN = (
    ".VERSION 1.0\n.COORD X Y\n.X_DIM 1000\n.POINTS_PER_SECOND 100\n.SEGMENT CHARACTER 0-1 ? \"b\"\n"
    ".PEN_DOWN\n0 0\n10 20\n20 40\n.PEN_UP\n30 40\n.PEN_DOWN\n40 0\n50 40\n"
)


def rows(samples):
    return samples.tolist() if hasattr(samples, "tolist") else samples


class Formats(Scratch):
    def load(self, *arguments, **options):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = datasets.load(*arguments, **options)
        self.assertEqual([str(w.message) for w in caught], found.errors + found.remarks)
        return found

    def test_csv_in_metres_is_taken_as_it_stands(self):
        [sequence] = self.load(self.write("pen.csv", CSV))
        self.assertTrue(sequence.unit_stated)
        self.assertEqual(sequence.metres_per_unit, (1.0, 1.0))
        samples = rows(sequence.samples)
        self.assertEqual([x for _, x, *_ in samples], [float(f"{1e-4 * k:.7f}") for k in range(10)])
        self.assertEqual([c for *_, c, _ in samples], [True] * 6 + [False] * 4)
        self.assertEqual([s for *_, s in samples], [0] * 6 + [1] * 4)
        self.assertAlmostEqual(samples[9][0] - samples[0][0], 0.045, 9)
        self.assertEqual([(s.contact, s.samples, s.gap_s) for s in sequence.strokes], [(True, 6, None), (False, 4, None)])
        self.assertAlmostEqual(sequence.rate_hz, 200.0, 6)

    def test_inkml_has_labels_hands_and_units(self):
        [sequence] = self.load(self.write("a.inkml", INKML))
        self.assertEqual((sequence.label, sequence.writer, sequence.unit_stated), ("a", "w7", True))
        samples = rows(sequence.samples)
        # InkML counts y downwards.
        for (_, x, y, *_), (mm_x, mm_y) in zip(samples, [(1, 2), (2, 4), (3, 6), (4, 8), (5, 5), (6, 5), (7, 5)]):
            self.assertAlmostEqual(x, 1e-3 * mm_x, 12)
            self.assertAlmostEqual(y, -1e-3 * mm_y, 12)
        self.assertEqual([s.samples for s in sequence.strokes], [4, 3])
        times = [t - samples[0][0] for t, *_ in samples]
        for own, wanted in zip(times, [0, 0.01, 0.02, 0.03, 0.1, 0.11, 0.12]):
            self.assertAlmostEqual(own, wanted, 9)

    def test_unipen_without_a_unit_gets_the_height_that_is_asked_for(self):
        path = self.write("b.dat", UNIPEN)
        for height in (0.03, 0.05):
            [sequence] = self.load(path, height_m=height)
            self.assertEqual((sequence.label, sequence.unit_stated), ("b", False))
            ink = [y for *_, y, contact, _ in rows(sequence.samples) if contact]
            self.assertAlmostEqual(max(ink) - min(ink), height, 12)

    def test_a_recording_of_foretrace_is_one_sequence(self):
        [sequence] = self.load(recording())
        pen = rows(foretrace.read(recording()).pen)
        self.assertTrue(sequence.unit_stated)
        samples = rows(sequence.samples)
        self.assertLessEqual(len(samples), len(pen))
        self.assertGreater(len(samples), 0.95 * len(pen))
        self.assertLessEqual({(x, y) for _, x, y, *_ in samples}, {(x, y) for _, x, y, _ in pen})

    def test_a_folder_has_parts_hands_remarks_and_refusals(self):
        self.write("set/one.csv", CSV)
        self.write("set/two.csv", CSV.replace("contact", "contact,pressure").replace(",1\n", ",1,9\n").replace(",0\n", ",0,0\n"))
        self.write("set/bad.csv", "t_s,x_m,y_m,contact\n0,0,0,1\n1,nonsense,0,1\n")
        table = "set\tfile\twriter\ntrain\tone.csv\tanna\ntest\ttwo.csv\tbert\ntest\tbad.csv\tbert\n"
        folder = os.path.dirname(self.write("set/split.tsv", table))
        self.assertEqual(datasets.splits(folder), ["train", "test", "all"])
        found = self.load(folder, "test")
        self.assertEqual([(s.writer, s.split, s.file) for s in found], [("bert", "test", "two.csv")])
        [error] = found.errors
        self.assertRegex(error, r"bad\.csv:3: x_m is .*nonsense")
        self.assertTrue(any("pressure" in remark for remark in found.remarks), found.remarks)
        everything = datasets.load(folder, quiet=True)
        self.assertEqual([s.split for s in everything], ["train", "test"])
        self.assertEqual(everything.writers, ["anna", "bert"])
        self.assertEqual([(f.name, f.split) for f in everything.files], [("one.csv", "train"), ("two.csv", "test")])
        self.assertEqual((everything[-1].writer, len(everything)), ("bert", 2))
        with self.assertRaises(IndexError):
            everything[2]
        with self.assertRaisesRegex(foretrace.Problem, r"bad\.csv:3"):
            datasets.load(folder, strict=True)
        with self.assertRaisesRegex(foretrace.Invalid, 'no split "dev"; it has: train, test, all'):
            datasets.load(folder, "dev")

    def test_parts_are_scaled_alike(self):
        self.write("set/a.dat", UNIPEN)
        self.write("set/b.dat", UNIPEN.replace("20 40", "20 80").replace("50 40", "50 80"))
        folder = os.path.dirname(self.write("set/split.tsv", "set\tfile\ntrain\ta.dat\ntest\tb.dat\n"))
        scales = {datasets.load(folder, part, quiet=True)[0].metres_per_unit for part in ("train", "test")}
        self.assertEqual(len(scales), 1)
        self.assertAlmostEqual(scales.pop()[0], 0.03 / 40.0, 15)

    def test_what_is_no_set_says_what_it_is(self):
        empty = os.path.dirname(self.write("none/readme.md", "words"))
        for path, why in [
            (self.path("missing"), "missing"), (empty, "no recording in this folder"),
            (self.write("x.csv", ""), "empty|header"), (self.write("x.gz", b"\x1f\x8b\x08"), "gzip"),
        ]:
            with self.assertRaisesRegex(foretrace.Problem, why):
                datasets.load(path)
        path = self.write("pen.csv", CSV)
        for options, why in [
            ({"split": "test"}, "has no parts"), ({"unit": "ell"}, "unit is"), ({"height_m": -1.0}, "height_m is -1"),
            ({"height_m": math.nan}, "height_m is NaN"),
        ]:
            with self.assertRaisesRegex(foretrace.Invalid, why):
                datasets.load(path, **options)

    @needs_numpy
    def test_samples_are_structured_arrays(self):
        [sequence] = datasets.load(self.write("pen.csv", CSV))
        self.assertEqual(sequence.samples.dtype.names, ("t_s", "x_m", "y_m", "contact", "stroke"))
        self.assertEqual(sequence.samples["contact"].dtype, numpy.bool_)

    def test_matlab_and_unipen_sets_of_others(self):
        found = datasets.load(data("character-trajectories"), quiet=True)
        self.assertGreater(len(found), 2000)
        self.assertTrue(all(s.integrated for s in found) and all(s.label for s in found if s.split == "train"))
        heights = sorted(max(y) - min(y) for y in ([r[2] for r in rows(s.samples)] for s in list(found)[:200]))
        self.assertTrue(0.005 < heights[100] < 0.1, heights[100])
        test = datasets.load(data("unipen-ced"), "test", quiet=True)
        self.assertGreater(len(test.writers), 1)
        self.assertEqual({s.split for s in test}, {"test"})


class Paths(Scratch):
    def test_the_built_in_writer_and_recorded_ink_are_paths_in_the_workspace(self):
        for source in ("glyphs:hello", self.write("a.inkml", INKML)):
            path = datasets.path(source, {"preset": "ur5", "predictor.kind": "hold"}, quiet=True)
            readings = path.readings(7_000_000_000)
            self.assertEqual((len(readings), readings[0][0]), (len(path), 7_000_000_000))
            self.assertEqual([r[0] for r in readings], sorted({r[0] for r in readings}))
            self.assertTrue(all(abs(x) < 0.3 and abs(y) < 0.3 for _, x, y, _ in readings))
            self.assertEqual([(x, y, c) for _, x, y, c in readings], [(x, y, c) for _, x, y, c in rows(path.samples)])
        self.assertEqual([label for label, *_ in datasets.path("glyphs:hi").spans], ["h", "i"])

    def test_wrong_wishes_say_what_is_legal(self):
        for options, why in [({"speed": 0.0}, "speed is 0"), ({"segments": (3, 1)}, "segments are 3 to 1"), ({"unit": "ell"}, "unit")]:
            with self.assertRaisesRegex(foretrace.Invalid, why):
                datasets.path("glyphs:hi", **options)
        with self.assertRaisesRegex(foretrace.Problem, "label"):
            datasets.path(self.write("a.inkml", INKML), label="z")
        with self.assertRaisesRegex(foretrace.Invalid, "source is empty"):
            datasets.path([])


def iam_line(strokes):
    points = lambda stroke: "".join(f'<Point x="{x}" y="{y}" time="{t:.2f}"/>' for x, y, t in stroke)
    inner = "".join(f'<Stroke colour="black" start_time="{s[0][2]}" end_time="{s[-1][2]}">{points(s)}</Stroke>' for s in strokes)
    return (
        '<?xml version="1.0" encoding="ISO-8859-1"?>\n<WhiteboardCaptureSession><WhiteboardDescription>'
        '<SensorLocation corner="top_left"/><DiagonallyOppositeCoords x="6512" y="1376"/></WhiteboardDescription>'
        f"<StrokeSet>{inner}</StrokeSet></WhiteboardCaptureSession>"
    )


STROKES = [[(1000 + 7 * k, 500 + 40 * (k % 3), 769.05 + 0.01 * k) for k in range(12)], [(1200, 600 + 9 * k, 769.5 + 0.01 * k) for k in range(8)]]
FORM = (
    '<?xml version="1.0" encoding="ISO-8859-1"?>\n<WhiteboardCaptureSession><General><Form id="a01-001z" writerID="10028"/></General>'
    '<Transcription><Text>By Trevor &amp; co</Text><TextLine id="a01-001z-01" text="By Trevor"/></Transcription>'
    "<StrokeSet><Stroke><Point x=\"1\" y=\"2\" time=\"0.01\"/><Point x=\"2\" y=\"9\" time=\"0.02\"/></Stroke></StrokeSet></WhiteboardCaptureSession>"
)


class Converters(Scratch):
    def test_iam_ondb_lines_keep_text_writer_parts_places_and_times(self):
        self.write("iam/lineStrokes/a01/a01-001/a01-001z-01.xml", iam_line(STROKES))
        self.write("iam/lineStrokes/a01/a01-001/a01-001z-02.xml", iam_line(STROKES[:1]))
        self.write("iam/lineStrokes/a02/a02-000/a02-000-01.xml", iam_line(STROKES))
        self.write("iam/original/a01/a01-001/strokesz.xml", FORM)
        self.write("iam/ascii/a02/a02-000/a02-000.txt", "OCR:\n\nxx\n\nCSR:\n\nA move\nsecond\n")
        self.write("iam/bad.xml", "<html/>")
        parts = {"train": self.write("train.txt", "a01-001z\n"), "test": self.write("test.txt", "a02-000\n")}
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("out"), parts=parts)
        self.assertEqual((done.files, done.sequences), (2, 3))
        self.assertEqual(len(done.left_out), 1)
        self.assertIn("bad.xml", done.left_out[0])
        train, test = (datasets.load(done.folder, part, strict=True, quiet=True) for part in ("train", "test"))
        self.assertEqual([(s.label, s.writer) for s in train], [("By Trevor", "10028"), ("", "10028")])
        self.assertEqual([(s.label, s.writer) for s in test], [("A move", "")])
        samples, unit = rows(train[0].samples), train[0].metres_per_unit[0]
        self.assertEqual([s.samples for s in train[0].strokes], [12, 8])
        flat = [point for stroke in STROKES for point in stroke]
        for (t, x, y, contact, _), (dx, dy, dt) in zip(samples, flat):
            self.assertAlmostEqual(x / unit, dx, 6)
            self.assertAlmostEqual(y / unit, -dy, 6)
            self.assertAlmostEqual(t - samples[0][0], dt - flat[0][2], 6)
            self.assertTrue(contact)
        with self.assertRaisesRegex(foretrace.Problem, "bad.xml"):
            datasets.convert_iam_ondb(self.path("iam"), self.path("other"), strict=True)
        self.assertFalse([name for name in os.listdir(self.folder) if "other" in name])
        with self.assertRaisesRegex(foretrace.Problem, "exists already"):
            datasets.convert_iam_ondb(self.path("iam"), self.path("out"))

    def test_iam_ondb_forms_stand_in_where_there_are_no_lines(self):
        self.write("iam/strokesz.xml", FORM)
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("out"))
        [sequence] = datasets.load(done.folder, quiet=True)
        self.assertEqual((sequence.label, sequence.writer), ("By Trevor & co", "10028"))

    def test_svc2004_keeps_lifts_hands_and_forgeries_apart(self):
        points = [(2933 + 10 * k, 5678 - 5 * k, 31275775 + 10 * k, int(not 4 <= k < 7)) for k in range(12)]
        task2 = f"{len(points)}\n" + "".join(f"{x} {y} {t} {b} 1550 710 {439 * b}\r\n" for x, y, t, b in points)
        task1 = f"{len(points)}\n" + "".join(f"{x} {y} {t} {b}\n" for x, y, t, b in points)
        self.write("svc/U1S1.TXT", task2)
        self.write("svc/U12S21.TXT", task1)
        self.write("svc/U2S1.TXT", task1.replace("12\n", "13\n", 1))
        self.write("svc/U3S1.TXT", "\n" + task1.replace(" 1\n", " 2\n", 1))
        done = datasets.convert_svc2004(self.path("svc"), self.path("out"))
        self.assertEqual((done.files, len(done.left_out)), (2, 2))
        self.assertRegex("\n".join(done.left_out), r"12 points where its first line says 13")
        self.assertRegex("\n".join(done.left_out), r"U3S1.TXT:3: button is '2'")
        genuine, forgery = (datasets.load(done.folder, part, strict=True, quiet=True)[0] for part in ("genuine", "forgery"))
        self.assertEqual((genuine.writer, forgery.writer), ("u1", ""))
        samples, unit = rows(genuine.samples), genuine.metres_per_unit[0]
        self.assertEqual([contact for *_, contact, _ in samples], [bool(b) for *_, b in points])
        for (t, x, y, *_), (dx, dy, dt, _) in zip(samples, points):
            self.assertAlmostEqual(x / unit, dx, 6)
            self.assertAlmostEqual(y / unit, dy, 6)
            self.assertAlmostEqual(t - samples[0][0], 1e-3 * (dt - points[0][2]), 6)

    def drawing(self, number, raw=True):
        strokes = [[[10, 20.5, 30], [5, 6, number + 40], [0, 16, 33]], [[40, 41], [50, 60], [100, 117]]]
        strokes = strokes if raw else [stroke[:2] for stroke in strokes]
        return json.dumps({"word": "ice & cream", "key_id": str(number), "countrycode": "CH", "drawing": strokes})

    def test_quickdraw_keeps_words_and_times_and_refuses_what_has_none(self):
        lines = [self.drawing(0), "", "{broken", self.drawing(1), self.drawing(2, raw=False), '{"word": "x", "drawing": []}', "[" * 100_000]
        path = self.write("quickdraw/ice cream.ndjson", "\n".join(lines))
        done = datasets.convert_quickdraw(path, self.path("out"))
        self.assertEqual((done.files, done.sequences, len(done.left_out)), (1, 2, 4))
        self.assertIn(f"{path}:3: not JSON", done.left_out[0])
        self.assertIn("take the raw one", done.left_out[1])
        found = datasets.load(done.folder, strict=True, quiet=True)
        self.assertEqual([(s.label, s.writer) for s in found], [("ice & cream", "0"), ("ice & cream", "1")])
        samples, unit = rows(found[0].samples), found[0].metres_per_unit[0]
        self.assertEqual([round(x / unit, 6) for _, x, *_ in samples], [10, 20.5, 30, 40, 41])
        self.assertEqual([round(-y / unit, 6) for _, _, y, *_ in samples], [5, 6, 40, 50, 60])
        self.assertEqual([round(1e3 * (t - samples[0][0]), 6) for t, *_ in samples], [0, 16, 33, 100, 117])
        with self.assertRaisesRegex(foretrace.Problem, "simplified file"):
            datasets.convert_quickdraw(self.write("s.ndjson", self.drawing(0, raw=False)), self.path("s"))
        self.assertEqual(sorted(os.listdir(self.folder)), ["out", "quickdraw", "s.ndjson"])

    def test_many_drawings_become_several_files_and_a_limit_holds(self):
        path = self.write("cat.ndjson", "\n".join(self.drawing(n) for n in range(1203)))
        done = datasets.convert_quickdraw([path], self.path("out"), limit=1100)
        self.assertEqual((done.files, done.sequences, done.left_out), (3, 1100, []))
        self.assertEqual(len(datasets.load(done.folder, quiet=True)), 1100)
        with self.assertRaisesRegex(foretrace.Invalid, "limit is 0"):
            datasets.convert_quickdraw(path, self.path("other"), limit=0)

    def test_a_file_of_drawings_has_so_many_points_and_no_more(self):
        path = self.write("cat.ndjson", "\n".join(self.drawing(n) for n in range(7)))
        with mock.patch("foretrace._convert.POINTS_PER_FILE", 11):
            done = datasets.convert_quickdraw(path, self.path("out"))
        # Of five points each.
        self.assertEqual((done.files, done.sequences), (3, 7))
        found = datasets.load(done.folder, strict=True, quiet=True)
        self.assertEqual([os.path.basename(s.file) for s in found], ["00000.inkml"] * 3 + ["00001.inkml"] * 3 + ["00002.inkml"])

    def test_iam_ondb_takes_the_memory_of_one_form_however_many_there_are(self):
        stroke = [(1000 + k, 2000 + 3 * k, 10.0 + 0.01 * k) for k in range(600)]

        def peak(forms):
            source = f"iam{forms}"
            for form in range(forms):
                self.write(f"{source}/original/b{form:02}/strokes.xml", iam_line([stroke]))
                for line in (1, 2):
                    self.write(f"{source}/lineStrokes/b{form:02}-{line:02}.xml", iam_line([stroke]))
            tracemalloc.start()
            try:
                done = datasets.convert_iam_ondb(self.path(source), self.path(f"{source}-out"))
                return done.sequences, tracemalloc.get_traced_memory()[1]
            finally:
                tracemalloc.stop()

        peak(2)
        (few, before), (many, after) = peak(3), peak(24)
        self.assertEqual((few, many), (6, 48))
        self.assertLess(after, 1.5 * before)

    def test_a_name_that_is_too_long_takes_no_other_with_it(self):
        self.write("iam/d-01.xml", iam_line(STROKES))
        self.write("iam/strokesz.xml", FORM.replace("a01-001z", "a" * 300))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("iam-out"))
        self.assertEqual((done.files, len(done.left_out)), (1, 1))
        self.assertRegex(done.left_out[0], "strokesz.xml: id has 300 characters; legal: at most 100$")
        self.write("iam/strokesz.xml", FORM.replace("a01-001z", "a" * 101))
        with self.assertRaisesRegex(foretrace.Problem, "id has 101 characters"):
            datasets.convert_iam_ondb(self.path("iam"), self.path("iam-strict"), strict=True)
        self.write("iam/strokesz.xml", FORM.replace("a01-001z", "a" * 100))
        self.assertEqual(datasets.convert_iam_ondb(self.path("iam"), self.path("iam-kept"), strict=True).files, 2)
        drawings = "\n".join(self.drawing(n) for n in range(3))
        paths = [self.write(f"q/{name}", drawings) for name in ("cat.ndjson", "c" * 251, "d" * 255, "dog.ndjson")]
        done = datasets.convert_quickdraw(paths, self.path("q-out"))
        self.assertEqual((done.files, done.sequences, len(done.left_out)), (3, 9, 1), done.left_out)
        self.assertRegex(done.left_out[0], r"d{255}: its file would be '002-ddd.*shorten that of its source")
        with self.assertRaisesRegex(foretrace.Problem, "too long here"):
            datasets.convert_quickdraw(paths, self.path("q-strict"), strict=True)
        with mock.patch("foretrace._convert.DRAWINGS_PER_FILE", 1):
            done = datasets.convert_quickdraw(paths, self.path("q-parts"))
        self.assertEqual((done.sequences, len(done.left_out)), (9, 1), done.left_out)

    def test_messages_show_the_begin_of_what_files_hold(self):
        for value, begin in [(5.0, "'5.0'"), ("x" * 1000, repr("x" * 40)), (10**5000, "'a int of thousands of digits'")]:
            self.assertEqual(_ink.shown(value), begin)

    def test_a_form_that_is_refused_is_not_converted(self):
        self.write("iam/d-01.xml", iam_line(STROKES))
        self.write("iam/strokesz.xml", FORM.replace("10028", "1" * 200))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("out"))
        self.assertEqual((done.files, len(done.left_out)), (1, 1), done.left_out)

    def signature(self):
        return "3\n" + "".join(f"{10 + k} {20 + k * k} {10 * k} 1\n" for k in range(3))

    def test_files_of_one_name_keep_their_folders_or_are_named(self):
        for name in ("Task1/U1S1.TXT", "Task2/U1S1.TXT", "Task2/u1s1.txt", "Task2/sub/U1S1.TXT"):
            self.write(f"svc/{name}", self.signature())
        done = datasets.convert_svc2004(self.path("svc"), self.path("out"))
        names = [file.name for file in datasets.load(done.folder, quiet=True).files]
        self.assertEqual(sorted(names), ["Task1/u1s1.inkml", "Task2/sub/u1s1.inkml", "Task2/u1s1.inkml"])
        [left] = done.left_out
        self.assertRegex(left, r"Task2/u1s1.txt: its file would be Task2/u1s1.inkml, which .*Task2/U1S1.TXT has already")
        with self.assertRaisesRegex(foretrace.Problem, "has already"):
            datasets.convert_svc2004(self.path("svc"), self.path("strict"), strict=True)
        for name in ("a+b", "a b"):
            self.write(f"iam/{name}.xml", iam_line(STROKES))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("iam-out"))
        self.assertEqual((done.files, len(done.left_out)), (1, 1))
        self.assertRegex(done.left_out[0], "form a.b: its file would be a_b.inkml, which form a.b has already")

    def test_iam_ondb_forms_and_lines_are_told_apart_form_by_form(self):
        bare = FORM.replace('<General><Form id="a01-001z" writerID="10028"/></General>', "")
        self.write("iam/original/a01/a01-001/strokesz.xml", bare)
        self.write("iam/original/a01/a01-002/strokesz.xml", bare)
        self.write("iam/original/a02/a02-000/strokes.xml", bare)
        for line in ("01", "02", "10"):
            self.write(f"iam/lineStrokes/a01/a01-001/a01-001z-{line}.xml", iam_line(STROKES))
        self.write("iam/other/a01-001z-02.xml", iam_line(STROKES))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("out"))
        found = datasets.load(done.folder, quiet=True)
        names = ["a01-001z.inkml"] * 3 + ["a01-002z.inkml", "a02-000.inkml"]
        self.assertEqual([sequence.file for sequence in found], names)
        self.assertEqual([len(sequence.strokes) for sequence in found], [2, 2, 2, 1, 1])
        self.assertEqual(len(done.left_out), 1)
        self.assertRegex(done.left_out[0], r"line 2 of form a01-001z was read from .*lineStrokes.* already")

    def test_numbers_that_the_lab_refuses_are_refused_here(self):
        drawing = lambda x: f'{{"word": "w", "key_id": "k", "drawing": [[[{x}, 2], [1, 2], [0, 10]]]}}'
        numbers = ["1" + "0" * 400, '"1_0"', '"\uff11"', "5e9", '"0x10"', "NaN", "true", "null", '"1e400"', "[1]"]
        path = self.write("q.ndjson", "\n".join([*map(drawing, numbers), drawing("1" + "0" * 6000), drawing("1.5e3")]))
        done = datasets.convert_quickdraw(path, self.path("out"))
        self.assertEqual((done.sequences, len(done.left_out)), (1, len(numbers) + 1), done.left_out)
        self.assertRegex(done.left_out[3], r"q.ndjson:4: stroke 0: x is '5000000000.0'; legal: numbers from -1e\+09 to 1e\+09")
        self.assertEqual(len(datasets.load(done.folder, strict=True, quiet=True)), 1)
        for at, cell in enumerate(("1_0", "\uff11", "5e9", "nan", "1e999")):
            self.write(f"svc/U{at + 1}S1.TXT", self.signature().replace("10 20 0", f"{cell} 20 0"))
        self.write("svc/U9S1.TXT", self.signature())
        self.write("svc/U10S1.TXT", "9" * 5000 + "\n")
        done = datasets.convert_svc2004(self.path("svc"), self.path("svc-out"))
        self.assertEqual((done.files, len(done.left_out)), (1, 6), done.left_out)

    def test_names_of_hands_are_one_cell_of_the_table(self):
        keys = [r"a\tb\nc", r"\ud800d", None, 12, "x" * 101, ["l"]]
        lines = [
            '{"word": null, "key_id": %s, "drawing": [[[1, 2], [1, 2], [0, 10]]]}'
            % (f'"{key}"' if isinstance(key, str) else json.dumps(key))
            for key in keys
        ]
        for at, line in enumerate(lines):
            self.write(f"q/{at}.ndjson", line)
        done = datasets.convert_quickdraw(self.path("q"), self.path("out"))
        with open(os.path.join(done.folder, "split.tsv"), encoding="utf-8") as file:
            rows_of = [line.rstrip("\n").split("\t") for line in file][1:]
        self.assertEqual([row[2] for row in rows_of], ["a b c", "d", "", "12"])
        found = datasets.load(done.folder, strict=True, quiet=True)
        self.assertEqual([(s.label, s.writer) for s in found][:2], [("", "a b c"), ("", "d")])
        self.assertRegex("\n".join(done.left_out), r"key_id has 101 characters; legal: at most 100\n.*key_id is \"\['l'\]\"; legal: a text")

    def test_a_target_that_cannot_be_finished_leaves_nothing(self):
        path = self.write("q.ndjson", self.drawing(0))
        with mock.patch("os.rename", side_effect=OSError(28, "No space left on device")):
            with self.assertRaisesRegex(foretrace.Problem, "cannot write .*No space left"):
                datasets.convert_quickdraw(path, self.path("out"))
        for target in (self.path("x" * 300), self.path("a") + "\0b", os.path.join(path, "below")):
            with self.assertRaisesRegex(foretrace.Problem, "cannot write"):
                datasets.convert_quickdraw(path, target)
        self.assertEqual(os.listdir(self.folder), ["q.ndjson"])

    def test_what_is_no_regular_file_is_left_out_and_never_waited_for(self):
        for name in ("iam/ascii/p.txt", "iam/p.xml", "svc/U1S1.TXT", "q/p.ndjson"):
            os.mkfifo(self.path(*name.split("/")))
            os.symlink("nowhere", self.path(*name.replace("p.", "gone.").replace("U1", "U2").split("/")))
        self.write("iam/ascii/large.txt", "CSR:\n" + "x" * (1 << 20))
        self.write("iam/d-01.xml", iam_line(STROKES))
        self.write("svc/U3S1.TXT", self.signature())
        self.write("q/good.ndjson", self.drawing(0))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("iam-out"))
        self.assertEqual((done.sequences, len(done.left_out)), (1, 5), done.left_out)
        told = "\n".join(done.left_out)
        for why in ("p.txt: not a regular file", "gone.xml: No such file", "large.txt: it has more than 1048576 bytes"):
            self.assertIn(why, told)
        for convert, source in ((datasets.convert_svc2004, "svc"), (datasets.convert_quickdraw, "q")):
            done = convert(self.path(source), self.path(f"{source}-out"))
            self.assertEqual((done.sequences, len(done.left_out)), (1, 2), done.left_out)
        for name in ("iam/p.xml", "iam/gone.xml", "iam"):
            with self.assertRaisesRegex(foretrace.Problem, name):
                datasets.convert_iam_ondb(self.path("iam"), self.path("never"), parts={"a": self.path(*name.split("/"))})

    def test_a_line_of_the_longest_length_takes_no_other_with_it(self):
        lines = [self.drawing(n) for n in range(3)]
        most = len(lines[0].encode()) + 20
        for spare, left in ((0, 0), (1, 1), (most, 1), (3 * most, 1)):
            first = lines[0] + " " * (20 + spare)
            path = self.write("q.ndjson", "\n".join([first, *lines[1:]]))
            with mock.patch("foretrace._convert.LONGEST_LINE", most):
                done = datasets.convert_quickdraw(path, self.path(f"out{spare}"))
            self.assertEqual((done.sequences, len(done.left_out)), (3 - left, left), (spare, done.left_out))

    def test_hostile_files_are_left_out_with_their_reason(self):
        bomb = '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "cc"><!ENTITY d "&b;&b;">]><WhiteboardCaptureSession>&d;</WhiteboardCaptureSession>'
        self.write("iam/a.xml", bomb)
        self.write("iam/a16.xml", bomb.encode("utf-16"))
        self.write("iam/a16be.xml", bomb.encode("utf-16-be"))
        self.write("iam/b.xml", iam_line(STROKES).replace('x="1000"', 'x="1e999"'))
        self.write("iam/c.xml", iam_line(STROKES)[:300])
        self.write("iam/d-01.xml", iam_line(STROKES))
        done = datasets.convert_iam_ondb(self.path("iam"), self.path("out"))
        self.assertEqual((done.sequences, len(done.left_out)), (1, 5))
        for reason, why in zip(done.left_out, (*["defines entities"] * 3, "x is '1e999'", "not XML")):
            self.assertIn(why, reason)
        for source, why in [(self.path("nowhere"), "no such file"), (os.path.dirname(self.write("e/f", "")), "no file that ends in .txt")]:
            with self.assertRaisesRegex(foretrace.Problem, why):
                datasets.convert_svc2004(source, self.path("never"))


if __name__ == "__main__":
    unittest.main()
