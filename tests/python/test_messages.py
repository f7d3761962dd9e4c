"""The messages as Python sees them, without a daemon."""

import ctypes
import subprocess
import sys
import unittest

import foretrace
from foretrace import messages
from foretrace.messages import (
    ControlResponse, JointCommand, JointState, Mode, PenFlags, PenSample, Record, Status, TickRecord,
)
from world import PROGRAM

try:
    import numpy
except ImportError:
    numpy = None

MESSAGES = [PenSample, JointCommand, JointState, TickRecord, Status, ControlResponse]


def records():
    return [kind for kind in vars(messages).values() if isinstance(kind, type) and issubclass(kind, Record) and kind is not Record]


class Messages(unittest.TestCase):
    def test_the_module_is_what_the_program_prints(self):
        printed = subprocess.run([PROGRAM, "schema", "python"], capture_output=True, text=True, check=True).stdout
        with open(messages.__file__, encoding="utf-8") as module:
            self.assertEqual(module.read().rstrip(), printed.rstrip())

    def test_records_read_what_they_wrote_and_name_enumerations_and_flags(self):
        sample = PenSample(x_m=0.1, y_m=-0.2, pressure=0.5, flags=PenFlags.CONTACT | PenFlags.IN_RANGE)
        again = PenSample.from_buffer_copy(bytes(sample))
        self.assertEqual(sample, again)
        self.assertEqual(again.to_dict()["flags"], ["CONTACT", "IN_RANGE"])
        again.x_m = 0.3
        self.assertNotEqual(sample, again)
        status = Status(mode=Mode.FOLLOWING)
        status.predictor.bytes = b"mixture"
        self.assertIn("mode='following'", repr(status))
        self.assertEqual(status.to_dict()["predictor"], {"bytes": "mixture"})
        self.assertEqual((Mode(2).label, Mode.words(77)), ("following", "unknown (77)"))

    def test_arrays_of_enumerations_are_words_and_every_record_has_some(self):
        arrays = 0
        for kind in records():
            words = kind.__doc__ or ""
            self.assertTrue(words.strip(), kind.__name__)
            told = kind().to_dict()
            self.assertNotIn("object at", repr(kind()), kind.__name__)
            for name, of in kind._kinds_.items():
                if isinstance(getattr(kind(), name), ctypes.Array):
                    arrays += 1
                    self.assertEqual(len(told[name]), len(getattr(kind(), name)))
                    for word in told[name]:
                        self.assertIn(word, [member.label for member in of], f"{kind.__name__}.{name}")
        self.assertGreater(arrays, 0)

    def test_every_field_has_its_place_and_no_gap(self):
        def check(record):
            end = 0
            for name, *_ in record._fields_:
                field = getattr(record, name)
                self.assertEqual(field.offset, end, f"{record.__name__}.{name}")
                end += field.size
            self.assertEqual(end, ctypes.sizeof(record))

        self.assertGreater(len(records()), 10)
        for kind in records():
            check(kind)

    @unittest.skipIf(numpy is None, "numpy is not installed")
    def test_numpy_reads_the_same_numbers(self):
        for message in MESSAGES:
            self.assertEqual(message.dtype().itemsize, ctypes.sizeof(message))
        state = JointState(safety_mode=1)
        state.q[:] = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
        array = numpy.frombuffer(bytes(state) * 3, JointState.dtype())
        self.assertEqual(array["q"].shape, (3, 6))
        self.assertEqual(array["q"][2].tolist(), list(state.q))
        self.assertEqual(array["safety_mode"].tolist(), [1, 1, 1])

    def test_the_package_needs_no_numpy_at_import(self):
        code = "import sys; sys.modules['numpy'] = None; import foretrace.messages; print(foretrace.__all__[0])"
        told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        self.assertEqual((told.returncode, told.stdout.strip()), (0, "Answer"), told.stderr)

    def test_every_public_name_has_a_docstring_and_every_native_name_a_stub(self):
        for name in foretrace.__all__:
            public = getattr(foretrace, name)
            self.assertTrue(public.__doc__, name)
            if isinstance(public, type) and public.__module__.startswith("foretrace."):
                for attribute, value in vars(public).items():
                    if callable(value) and not attribute.startswith("_"):
                        self.assertTrue(value.__doc__, f"{name}.{attribute}")
        import pathlib

        folder = pathlib.Path(foretrace.__file__).parent
        stubs = (folder / "_native.pyi").read_text()
        self.assertTrue((folder / "py.typed").exists())
        for name, value in vars(foretrace._native).items():
            if name.startswith("_"):
                continue
            self.assertRegex(stubs, rf"(?m)^(class |def )?{name}\b", name)
            if isinstance(value, type) and not issubclass(value, Exception):
                for attribute in vars(value):
                    if not attribute.startswith("_"):
                        body = stubs.split(f"class {name}:")[1].split("\nclass ")[0]
                        self.assertRegex(body, rf"(def {attribute}\(|    {attribute}: )")


if __name__ == "__main__":
    unittest.main()
