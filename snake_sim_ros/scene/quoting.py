# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Received values as sentences quote them: short, whatever they are."""

from reprlib import Repr
from typing import Any

LONGEST = 80  # characters of a quoted value
LONGEST_PATH = 250  # characters of the name of a file
LONGEST_REASON = 250  # characters of what a library finds wrong
LOOKED_AT = 10_000  # characters of a text that is cut; each takes memory

_SHORT = Repr()
_SHORT.maxlevel = 3
_SHORT.maxdict = _SHORT.maxlist = _SHORT.maxtuple = _SHORT.maxset = _SHORT.maxfrozenset = 12
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = LONGEST


def quoted(value: Any) -> str:
    """Return a value as text in one line of at most about 80 characters."""
    try:
        text = _SHORT.repr(value)
    except ValueError:  # whole numbers of more digits than Python writes
        return f'a {type(value).__name__} of very many digits'
    except Exception:  # a type that cannot be shown
        return f'a {type(value).__name__}'
    return cut(text)


def cut(text: str, longest: int = LONGEST) -> str:
    """Return a text in one line, with dots in its middle if it is longer than that."""
    if len(text) > LOOKED_AT:
        text = text[: LOOKED_AT // 2] + text[-LOOKED_AT // 2 :]
    line = ' '.join(text.split()) if not text.isprintable() else text
    line = ''.join(each if each.isprintable() else '?' for each in line)
    half = (longest - 3) // 2
    return line if len(line) <= longest else f'{line[:half]}...{line[-half:]}'
