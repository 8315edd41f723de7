r"""Long paths on Windows.

Most calls of Windows refuse a path of 260 characters or more, and a folder of 248, unless it begins with ``\\?\``.
Such a path must be absolute and normalised, and that of a network drive begins with ``\\?\UNC\``.

In: a path as people write and read it. Out: the path for a call that opens, lists or writes. Only long paths on
Windows are changed, so an ordinary path behaves as in any other program.
"""

from __future__ import annotations

import ntpath
import os
from pathlib import Path
from typing import Callable, Iterator, List, Optional, Tuple

#: Whether long paths need a prefix.
ON_WINDOWS = os.name == "nt"
#: Length from which a path gets the prefix: below 248, the limit of a folder, with room for ``.part`` or ``-journal``.
LONG_FROM = 230
PREFIX, SHARE_PREFIX = "\\\\?\\", "\\\\?\\UNC\\"


def on_disk(path: Path) -> Path:
    """The path for a call of the system."""
    if not ON_WINDOWS:
        return path
    absolute = ntpath.abspath(path)
    return path if len(absolute) < LONG_FROM else type(path)(extended(absolute))


def extended(absolute: str) -> str:
    """An absolute, normalised path of Windows with the prefix for long paths."""
    if absolute.startswith((PREFIX, "\\\\.\\")):
        # long already, or a device
        return absolute
    if absolute.startswith("\\\\"):
        return SHARE_PREFIX + absolute[2:]
    return PREFIX + absolute


def shown(path: object) -> str:
    """A path, such as the ``filename`` of an ``OSError``, for people: without the prefix."""
    text = os.fsdecode(path) if isinstance(path, (str, bytes, os.PathLike)) else str(path)
    if text.startswith(SHARE_PREFIX):
        return "\\\\" + text[len(SHARE_PREFIX) :]
    return text[len(PREFIX) :] if text.startswith(PREFIX) else text


def walk(
    root: Path, on_error: Optional[Callable[[OSError], None]] = None
) -> Iterator[Tuple[Path, List[str], List[str]]]:
    """As ``os.walk``: each folder, and the names of its folders and files; names of folders that the caller removes
    are left out. Links to folders are not followed."""
    waiting = [root]
    while waiting:
        folder = waiting.pop()
        # one level: each folder decides anew whether its path is long
        for _, folders, files in os.walk(on_disk(folder), onerror=on_error):
            yield folder, folders, files
            waiting.extend(folder / name for name in reversed(folders) if not on_disk(folder / name).is_symlink())
            break
