# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that are written as a whole: until then, what was there before stays."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
import os
from pathlib import Path
from secrets import token_hex
import shutil
from typing import Any

LONGEST_STEM = 40  # characters of a name that the file beside it keeps


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """
    Yield a path to write to, whose file takes the place of another one once it is on the disk.

    If writing fails, what was there before stays, and nothing else is left. A link stays a link,
    and what is not a file, such as a terminal or a pipe, is written as it is.

    Parameters
    ----------
    path : Path
        The file to write.

    Yields
    ------
    Path
        A new name beside the file, with its suffix and ``.part`` before it.

    Raises
    ------
    OSError
        If the system refuses to write; the error names `path`.

    """
    place = path.resolve()
    in_place = place.exists() and not place.is_file()
    name = f'{place.stem[:LONGEST_STEM]}.{token_hex(4)}.part{place.suffix}'
    part = place if in_place else place.with_name(name)
    try:
        yield part
        if not in_place:
            _keep(part, place)
    except OSError as error:
        raise OSError(f'{path} cannot be written: {error.strerror or error}') from None
    finally:
        if not in_place:
            part.unlink(missing_ok=True)


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a text, in UTF-8, or bytes as a file, see `whole_file`."""
    with whole_file(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def write_figure(figure: Any, path: Path, **how: Any) -> None:
    """
    Write a figure of matplotlib as a file, see `whole_file`.

    It is drawn in memory, because what draws PDF does not pass on errors of the system.

    Parameters
    ----------
    figure : Figure
    path : Path
        Its suffix selects the format.
    **how
        Other arguments of `Figure.savefig`.

    """
    content = BytesIO()
    figure.savefig(content, format=path.suffix[1:], **how)
    write_whole(path, content.getvalue())


def _keep(part: Path, place: Path) -> None:
    """Give a file, once it is on the disk, the place and the permissions of another one."""
    with part.open('rb') as file:
        os.fsync(file.fileno())
    if place.exists():
        shutil.copymode(place, part)
    os.replace(part, place)
