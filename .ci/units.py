"""Checks the systemd units with systemd-analyze where it is installed: `verify`, and `security` against an upper bound.

`verify` wants every program to exist, so each unit is checked as a copy whose programs are /bin/true.
"""

import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Exposure by `systemd-analyze security`, 0 (sealed) to 10 (open), times ten. Each unit must stay below.
EXPOSURE_LIMIT = {"foretraced.service": 12, "foretrace-gateway.service": 10}


def main() -> int:
    units = sorted((ROOT / "daemon" / "systemd").glob("*.service"))
    if {unit.name for unit in units} != set(EXPOSURE_LIMIT):
        print(f"units: {[unit.name for unit in units]} are there, limits for {sorted(EXPOSURE_LIMIT)}", file=sys.stderr)
        return 1
    if shutil.which("systemd-analyze") is None:
        print("units: skipped, systemd-analyze is not installed")
        return 0
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        copies = []
        for unit in units:
            text, count = re.subn(r"^ExecStart=/usr/local/bin/\S+", "ExecStart=/bin/true", unit.read_text(encoding="utf-8"), flags=re.M)
            if count != 1:
                print(f"{unit.relative_to(ROOT)}: {count} lines ExecStart=/usr/local/bin/..., expected one", file=sys.stderr)
                wrong += 1
            copy = pathlib.Path(folder) / unit.name
            copy.write_text(text, encoding="utf-8")
            copies.append(str(copy))
        # Unknown keys and values are only warnings to systemd: any output is an error here.
        verified = subprocess.run(["systemd-analyze", "verify", "--man=no", *copies], capture_output=True, text=True)
        said = [line for line in verified.stderr.splitlines() if folder in line or any(unit.name in line for unit in units)]
        if verified.returncode or said:
            print("\n".join(said) or verified.stderr, file=sys.stderr)
            wrong += 1
        for copy in copies:
            name = pathlib.Path(copy).name
            limit = EXPOSURE_LIMIT[name]
            command = ["systemd-analyze", "security", "--offline=true", f"--threshold={limit}", "--no-pager", copy]
            judged = subprocess.run(command, capture_output=True, text=True)
            verdict = [line for line in judged.stdout.splitlines() if "Overall exposure level" in line]
            print(f"units: {name}: {verdict[0].lstrip('→ ') if verdict else judged.stderr.strip()}")
            if judged.returncode:
                print(f"{name}: more exposed than {limit / 10}, or not judged", file=sys.stderr)
                wrong += 1
    print(f"units: {len(units)} checked, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
