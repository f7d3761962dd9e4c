"""What callers give as whole numbers, and how messages show what they and their files gave."""

from __future__ import annotations

import operator
from typing import Any

from ._native import Invalid


def told(value: Any) -> str:
    """The begin of a foreign value, for a message; Python refuses to write numbers of thousands of digits."""
    try:
        return str(value)[:80]
    except ValueError:
        return f"a {type(value).__name__} of thousands of digits"


def whole(name: str, value: Any, kind: str, legal: str, most: int = (1 << 64) - 1) -> int:
    """A whole number of any type, numpy's too, from 0 to `most`; messages say what `kind` and which are `legal`."""
    try:
        number = operator.index(value)
    except TypeError:
        raise Invalid(f"{name} is {told(value)}; legal: {kind}") from None
    if not 0 <= number <= most:
        raise Invalid(f"{name} is {told(number)}; legal: {legal}")
    return number
