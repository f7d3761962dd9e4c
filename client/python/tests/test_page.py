"""The Python of docs/extend/python-lab.md runs as it stands."""

import os
import re
import subprocess
import sys
import unittest

import foretrace
from support import ROOT, Scratch, needs_numpy, program, recording

PAGE = os.path.join(ROOT, "docs", "extend", "python-lab.md")


class Page(Scratch):
    @needs_numpy
    def test_every_block_of_python_runs_and_prints(self):
        with open(PAGE, encoding="utf-8") as file:
            blocks = re.findall(r"^```python\n(.*?)^```$", file.read(), re.MULTILINE | re.DOTALL)
        self.assertGreater(len(blocks), 4)
        os.symlink(recording(), self.path("run.mcap"))
        drawing = '{"word": "cat", "key_id": "1", "drawing": [[[1, 2, 3], [4, 5, 9], [0, 16, 33]]]}\n'
        foretrace.datasets.convert_quickdraw(self.write("cat.ndjson", drawing), self.path("letters"))
        path = os.pathsep.join([os.path.dirname(program()), os.environ.get("PATH", "")])
        for block in blocks:
            with self.subTest(block=block.splitlines()[0]):
                done = subprocess.run(
                    [sys.executable, "-W", "error", "-c", block], cwd=self.folder, env={**os.environ, "PATH": path},
                    capture_output=True, text=True, timeout=60,
                )
                self.assertEqual(done.returncode, 0, done.stderr)
                self.assertTrue(done.stdout.strip())


if __name__ == "__main__":
    unittest.main()
