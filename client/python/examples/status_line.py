"""Mode, trust and lag, twice a second, also over restarts of the daemon: python status_line.py."""

import foretrace
from foretrace.messages import Mode

ft = foretrace.attach(wait=60.0)
for _ in ft.pace(2):
    try:
        status = ft.status()
        late_ms = status.tracking.recent_lag_s * 1e3
        print(f"{Mode.words(status.mode)}, trust {status.trust:.2f}, the tool {late_ms:.0f} ms behind the pen")
    except foretrace.Problem as problem:
        print(problem)
