"""Tells stacks apart by the times at which their pictures were taken.

For cameras that number pictures through: a stack is a burst, and the next one begins after a pause. Each burst becomes
a folder in the names that the service groups, so front and back light are paired as folders are: the first burst of
``front`` with the first of ``back``.
"""

from __future__ import annotations

import struct
from bisect import bisect_right
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Dict, List, Mapping, Optional, Tuple

from .._paths import on_disk
from .._zips import is_picture

#: Where EXIF keeps the time: the folder of EXIF, the time, and the fraction of a second.
EXIF, TAKEN, FRACTION = 0x8769, 0x9003, 0x9291
#: Bytes of a JPEG in which its EXIF data are looked for.
HEAD = 1 << 18


@dataclass
class Bursts:
    """Files by burst."""

    #: The names with a folder for each burst.
    names: Dict[str, Path] = field(default_factory=dict)
    #: When each picture was taken, seconds.
    times: Dict[Path, float] = field(default_factory=dict)
    #: The pictures without a time, and why.
    untimed: List[Tuple[Path, str]] = field(default_factory=list)
    #: Those of them that cannot be read now, so that a burst of their folder may lack a slice.
    unread: List[Path] = field(default_factory=list)


def by_bursts(names: Mapping[str, Path], gap_s: float) -> Bursts:
    """Puts the pictures of each burst into a folder of their own."""
    bursts = Bursts()
    folders: Dict[PurePosixPath, List[Tuple[float, str, Path]]] = {}
    for name, path in names.items():
        if not is_picture(path):
            bursts.names[name] = path
            continue
        try:
            taken = time_taken(path)
        except OSError as error:
            bursts.untimed.append((path, f"cannot be read: {error.strerror or error}"))
            bursts.unread.append(path)
            continue
        if taken is None:
            bursts.untimed.append((path, "has no time in its EXIF data, so its burst is unknown"))
        else:
            bursts.times[path] = taken
            folders.setdefault(PurePosixPath(name).parent, []).append((taken, name, path))
    for folder, pictures in folders.items():
        pictures.sort()
        starts = [at for at in range(1, len(pictures)) if pictures[at][0] - pictures[at - 1][0] > gap_s]
        for at, (_, name, path) in enumerate(pictures):
            # a folder that is one burst stays as it is
            inner = f"{bisect_right(starts, at) + 1:04d}" if starts else ""
            bursts.names[str(folder / inner / PurePosixPath(name).name)] = path
    return bursts


def time_taken(path: Path) -> Optional[float]:
    """When a JPEG or TIFF was taken, in seconds, by its EXIF data; None if it does not say."""
    with on_disk(path).open("rb") as file:
        head = file.read(4)
        if head[:2] == b"\xff\xd8":
            file.seek(0)
            at = _exif_of_jpeg(file.read(HEAD))
            if at is None:
                return None
            start, limit = at
        elif head in (b"II*\0", b"MM\0*"):
            start, limit = 0, None
        else:
            return None
        try:
            return _time(_Tiff(file, start, limit))
        except (struct.error, ValueError, OverflowError):
            # torn or foreign
            return None


def _exif_of_jpeg(data: bytes) -> Optional[Tuple[int, int]]:
    """Begin and end of the TIFF structure in the APP1 segment."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (size,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return at + 10, at + 2 + size
        at += 2 + max(size, 2)
    return None


class _Tiff:
    """Reads entries of the directories of a TIFF structure."""

    def __init__(self, file: BinaryIO, start: int, end: Optional[int]) -> None:
        self._file, self._start, self._end = file, start, end
        self._order = "<" if self._bytes(0, 2) == b"II" else ">"
        self.first = self._unpack("I", 4)[0]

    def _bytes(self, at: int, size: int) -> bytes:
        if self._end is not None and self._start + at + size > self._end:
            raise ValueError("beyond the segment")
        self._file.seek(self._start + at)
        return self._file.read(size)

    def _unpack(self, layout: str, at: int) -> Tuple[int, ...]:
        layout = self._order + layout
        return struct.unpack(layout, self._bytes(at, struct.calcsize(layout)))

    def entries(self, directory: int) -> Dict[int, Tuple[int, int]]:
        """Of each tag: the number of its values, and the place of its entry's value."""
        (count,) = self._unpack("H", directory)
        found = {}
        for index in range(min(count, 512)):
            at = directory + 2 + 12 * index
            tag, _, values = self._unpack("HHI", at)
            found[tag] = (values, at + 8)
        return found

    def offset(self, at: int) -> int:
        """A number of 32 bits."""
        return self._unpack("I", at)[0]

    def text(self, entry: Tuple[int, int]) -> str:
        """A text of at most 64 letters."""
        size, at = entry
        size = min(size, 64)
        return self._bytes(at if size <= 4 else self.offset(at), size).split(b"\0")[0].decode("ascii").strip()


def _time(tiff: _Tiff) -> Optional[float]:
    outer = tiff.entries(tiff.first)
    if EXIF not in outer:
        return None
    exif = tiff.entries(tiff.offset(outer[EXIF][1]))
    if TAKEN not in exif:
        return None
    # the zone does not matter: only differences count
    taken = datetime.strptime(tiff.text(exif[TAKEN]), "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc)
    fraction = tiff.text(exif[FRACTION]) if FRACTION in exif else ""
    return taken.timestamp() + (float(f"0.{fraction}") if fraction.isdigit() else 0.0)
