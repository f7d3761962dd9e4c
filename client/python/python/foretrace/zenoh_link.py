"""A zenoh session for watching only: no scouting, explicit endpoints; and the keys that foretrace uses on it."""

from __future__ import annotations

import importlib
import json
import os
import re
from typing import Any, NamedTuple, Sequence

from ._native import Invalid, Problem

#: Everything of foretrace is below this.
PREFIX = "foretrace"
#: Largest answer that is read [bytes].
LARGEST = 1 << 20

#: Lists and objects stand in each other at most this deep in an answer.
DEEPEST = 32

_ENDPOINT = re.compile(r"(tcp|udp|tls|quic|unixsock-stream)/[^\s#?]+")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,62}")


def is_name(text: str) -> bool:
    """Whether it can be a host's name."""
    return _NAME.fullmatch(text) is not None


def name(what: str, text: Any) -> str:
    """A host's name as part of a key."""
    if isinstance(text, str) and _NAME.fullmatch(text):
        return text
    raise Invalid(f"{what} = {text!r}: 1 to 63 letters, digits, dots, hyphens or underscores, a letter or digit first")


def endpoint(what: str, text: Any) -> str:
    """An endpoint of zenoh."""
    if isinstance(text, str) and len(text) <= 256 and _ENDPOINT.fullmatch(text):
        return text
    raise Invalid(f"{what} = {text!r}: an endpoint of zenoh, as tcp/192.168.1.7:7447")


class Tls(NamedTuple):
    """Files of endpoints `tls/…` and `quic/…`, as PEM."""

    #: Who signed the certificates of the others.
    root_ca: str | None = None
    #: Certificate of this end, and its private key.
    certificate: str | None = None
    key: str | None = None


def tls(what: str, given: Any) -> Tls:
    """Checks the files of a table or of options. Raises `Invalid`."""
    if not isinstance(given, dict) or not given.keys() <= set(Tls._fields):
        raise Invalid(f"{what} = {given!r}: files {', '.join(Tls._fields)}")
    for key, path in given.items():
        if not isinstance(path, str) or not os.path.isfile(path):
            raise Invalid(f"{what}.{key} = {path!r}: no such file")
    if ("certificate" in given) != ("key" in given):
        raise Invalid(f"{what}: certificate and key belong together: give both or none")
    return Tls(**given)


def _tls_settings(files: Tls) -> dict[str, Any]:
    given = {
        "root_ca_certificate": files.root_ca,
        "listen_certificate": files.certificate,
        "listen_private_key": files.key,
        "connect_certificate": files.certificate,
        "connect_private_key": files.key,
        # Who knows whom it trusts, and shows who it is, wants the other end to do so too.
        "enable_mtls": True if files.root_ca and files.certificate else None,
    }
    return {f"transport/link/tls/{key}": value for key, value in given.items() if value is not None}


def open_session(mode: str, listen: Sequence[str], connect: Sequence[str], *, lasting: bool, files: Tls = Tls()) -> Any:
    """A session of zenoh. One that is `lasting` waits for places to connect to, and finds them again; another one fails
    where a place does not answer. Raises `Problem`, also where zenoh is not installed."""
    try:
        # By name: it is an extra, which tools that check types need not find.
        zenoh = importlib.import_module("zenoh")
    except ImportError:
        raise Problem("zenoh is not installed: `pip install eclipse-zenoh`, or foretrace with the extra `zenoh`") from None
    if not listen and not connect:
        raise Invalid("neither an endpoint to listen at nor one to connect to is given, and nobody is looked for")
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/exit_on_failure": not lasting,
        "connect/timeout_ms": 0 if lasting else 2000,
        "listen/exit_on_failure": True,
        **_tls_settings(files),
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except Exception as error:
        where = ", ".join([*(f"listen {one}" for one in listen), *(f"connect {one}" for one in connect)])
        raise Problem(f"zenoh does not open ({where}): {error}: is the address this machine's, and free?") from None


def read(payload: Any) -> Any:
    """What somebody sent, as JSON; none where it is too large or none."""
    data = bytes(payload)
    if len(data) > LARGEST:
        return None
    try:
        told = json.loads(data.decode("utf-8"))
    except (UnicodeDecodeError, ValueError, RecursionError):
        return None
    return None if _deeper(told, DEEPEST) else told


def _deeper(value: Any, most: int) -> bool:
    """Whether lists and objects stand in each other more than `most` deep."""
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return bool(inside) and (most == 0 or any(_deeper(one, most - 1) for one in inside))
