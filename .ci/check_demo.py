"""Checks the JSON of a demo run: legal commands, nothing rejected, the arm followed. Times are not checked."""

import json
import math
import sys

with open(sys.argv[1], encoding="utf-8") as file:
    result = json.load(file)
tracking = result["tracking"]
compared = [tracking[key] for key in ("rms_m", "max_m", "lag_ms", "ghost_rms_m", "ghost_max_m", "ghost_lag_ms")]
claims = {
    "commands were sent": result["commands"]["count"] > 100,
    "no command broke a limit": result["commands"]["limit_violations"] == 0,
    "no good sample was rejected": result["pen"]["rejected"] == 0,
    "the pen was heard": result["pen"]["samples"] > 100,
    "the arm followed the pen": tracking["rms_m"] < 0.02,
    "no allocation in a tick": result["loop"]["allocations_per_tick"] == 0,
    "loop and ghost were compared": all(value is not None and math.isfinite(value) for value in compared),
    "prediction saved millimetres": tracking["rms_m"] < (tracking["ghost_rms_m"] or 0),
}
for claim, holds in claims.items():
    print(f"{'ok  ' if holds else 'FAIL'} {claim}")
sys.exit(0 if all(claims.values()) else 1)
