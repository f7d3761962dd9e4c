"""Settings as a caller names them, for the native part: a preset or a file, and changes as TOML."""

from __future__ import annotations

import os
from typing import Any, Mapping, Union

from ._native import Invalid, is_preset

Settings = Union[str, "os.PathLike[str]", Mapping[str, Any]]


def toml_value(key: str, value: Any) -> str:
    """`value` as TOML."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return repr(value)
    if isinstance(value, str):
        quoted = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04x}" for c in quoted) + '"'
    if isinstance(value, os.PathLike):
        return toml_value(key, os.fspath(value))
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(key, entry) for entry in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{toml_key(k)} = {toml_value(key, v)}" for k, v in value.items()) + "}"
    raise Invalid(f"{key} is of type {type(value).__name__}; legal: bool, int, float, str, list, dict")


def toml_key(key: Any) -> str:
    if not isinstance(key, str) or not key:
        raise Invalid(f"a key of the settings is {key!r}; legal: words as in loop.rate_hz")
    if all(part and all(c.isascii() and (c.isalnum() or c in "-_") for c in part) for part in key.split(".")):
        return key
    raise Invalid(f"a key of the settings is {key!r}; legal: letters, digits, - and _, joined by points")


def flat(changes: Mapping[str, Any], above: str = "") -> list[tuple[str, str]]:
    """Keys with points, and values as TOML; sections may be dicts of their own."""
    pairs: list[tuple[str, str]] = []
    for key, value in changes.items():
        path = above + toml_key(key)
        if isinstance(value, Mapping):
            pairs += flat(value, path + ".")
        else:
            pairs.append((path, toml_value(path, value)))
    return pairs


def named(settings: Settings, changes: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """For the native part. A name without a slash and without an end such as `.toml` is a preset's."""
    extra = flat(changes or {})
    if isinstance(settings, Mapping):
        own = dict(settings)
        preset = own.pop("preset", None)
        if preset is not None and not isinstance(preset, str):
            raise Invalid(f"preset is {preset!r}; legal: the name of a preset, as ur5")
        return {"preset": preset, "file": None, "changes": flat(own) + extra}
    if isinstance(settings, str) and (is_preset(settings) or not ("/" in settings or "." in settings)):
        return {"preset": settings, "file": None, "changes": extra}
    if isinstance(settings, (str, os.PathLike)):
        return {"preset": None, "file": os.fspath(settings), "changes": extra}
    raise Invalid(f"settings are a {type(settings).__name__}; legal: a preset's name, a path, or a dict")
