"""EXIF data of pictures and camera raw files: reading them, and writing them for a picture made from a raw file.

In: a file. Out: the entries of its main and its Exif directory, as they are stored: a new file in the same byte order
gets them without a conversion.

| file | where the data are |
|---|---|
| TIFF, and raw files that are like TIFF (ARW, NEF, CR2, DNG, PEF, 3FR, IIQ, SRW, ORF, RW2) | the file itself |
| JPEG | its segment APP1 |
| CR3 | the boxes ``CMT1`` (main) and ``CMT2`` (Exif) |
| RAF | the JPEG in it |
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import BinaryIO, Dict, Mapping, Optional, Tuple

#: Bytes of a JPEG or CR3 file in which its EXIF data are looked for.
HEAD = 1 << 18
#: Longest value that is kept, bytes: an EXIF block of JPEG has at most 64 KiB.
LONGEST = 2048
#: The first bytes of TIFF files, and of those of Olympus and Panasonic.
LIKE_TIFF = (b"II*\0", b"MM\0*", b"IIRO", b"IIRS", b"MMOR", b"IIU\0")
#: Bytes of a value by its type.
SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8}
ASCII, SHORT, LONG, UNDEFINED = 2, 3, 4, 7

ORIENTATION, SOFTWARE, EXIF_DIRECTORY = 0x0112, 0x0131, 0x8769
TAKEN, FRACTION, USER_COMMENT, COLOUR_SPACE = 0x9003, 0x9291, 0x9286, 0xA001
#: Main directory: description, make, model, orientation, time, artist, copyright, unique model, serial number.
KEPT_OF_MAIN = (0x010E, 0x010F, 0x0110, ORIENTATION, 0x0132, 0x013B, 0x8298, 0xC614, 0xC62F)
#: Exif directory: what is right for the raw file alone: compressed bits, maker note, subject areas, size, sizes of
#: other directories, pattern of the sensor, padding.
NOT_KEPT_OF_EXIF = frozenset({0x9102, 0x927C, 0x9214, 0xA214, 0xA002, 0xA003, 0xA005, 0xA302, 0xEA1C})


@dataclass(frozen=True)
class Entry:
    """An entry of a directory: its type, the number of its values, and their bytes."""

    kind: int
    count: int
    value: bytes


@dataclass
class Exif:
    """The entries of a file by their tags. ``order``: of the bytes, ``<`` or ``>``."""

    order: str = "<"
    main: Dict[int, Entry] = field(default_factory=dict)
    exif: Dict[int, Entry] = field(default_factory=dict)

    def text(self, tag: int) -> str:
        """A text of the Exif directory; empty without one."""
        entry = self.exif.get(tag)
        return entry.value.split(b"\0")[0].decode("ascii").strip() if entry is not None else ""

    def short(self, value: int) -> Entry:
        """An entry with one number of 16 bits."""
        return Entry(SHORT, 1, struct.pack(f"{self.order}H", value))

    def longs(self, *values: int) -> Entry:
        """An entry with numbers of 32 bits."""
        return Entry(LONG, len(values), struct.pack(f"{self.order}{len(values)}I", *values))


def read_exif(file: BinaryIO) -> Optional[Exif]:
    """The EXIF data of a file; None if it has none, or if they are torn."""
    head = file.read(12)
    try:
        if head[:2] == b"\xff\xd8":
            return _of_jpeg(file, 0)
        if head.startswith(b"FUJIFILM"):
            file.seek(84)
            return _of_jpeg(file, struct.unpack(">I", file.read(4))[0])
        if head[4:12] == b"ftypcrx ":
            return _of_cr3(file)
        return _of_tiff(_Tiff(file, 0, None)) if head[:4] in LIKE_TIFF else None
    except (struct.error, ValueError, OverflowError):
        return None


def _of_jpeg(file: BinaryIO, start: int) -> Optional[Exif]:
    file.seek(start)
    data, at = file.read(HEAD), 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        (size,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return _of_tiff(_Tiff(file, start + at + 10, start + at + 2 + size))
        at += 2 + max(size, 2)
    return None


def _of_cr3(file: BinaryIO) -> Optional[Exif]:
    file.seek(0)
    data = file.read(HEAD)
    main, exif = (data.find(name) for name in (b"CMT1", b"CMT2"))
    if main < 0:
        return None
    found = _of_tiff(_Tiff(file, main + 4, None))
    if exif >= 0:
        own = _Tiff(file, exif + 4, None)
        found.exif = own.entries(own.first)
    return found


def _of_tiff(tiff: _Tiff) -> Exif:
    main = tiff.entries(tiff.first)
    pointer = main.get(EXIF_DIRECTORY)
    exif = tiff.entries(struct.unpack(f"{tiff.order}I", pointer.value)[0]) if pointer is not None else {}
    return Exif(tiff.order, main, exif)


class _Tiff:
    """Reads directories of a TIFF structure."""

    def __init__(self, file: BinaryIO, start: int, end: Optional[int]) -> None:
        self._file, self._start, self._end = file, start, end
        self.order = "<" if self._bytes(0, 2) == b"II" else ">"
        self.first = self._unpack("I", 4)[0]

    def _bytes(self, at: int, size: int) -> bytes:
        if self._end is not None and self._start + at + size > self._end:
            raise ValueError("beyond the segment")
        self._file.seek(self._start + at)
        return self._file.read(size)

    def _unpack(self, layout: str, at: int) -> Tuple[int, ...]:
        layout = self.order + layout
        return struct.unpack(layout, self._bytes(at, struct.calcsize(layout)))

    def entries(self, directory: int) -> Dict[int, Entry]:
        """The entries by their tags, without those whose value is long or beyond the file."""
        (count,) = self._unpack("H", directory)
        found = {}
        for index in range(min(count, 512)):
            at = directory + 2 + 12 * index
            tag, kind, values = self._unpack("HHI", at)
            size = SIZES.get(kind, 0) * values
            if 0 < size <= LONGEST:
                value = self._bytes(at + 8 if size <= 4 else self._unpack("I", at + 8)[0], size)
                if len(value) == size:
                    found[tag] = Entry(kind, values, value)
        return found


def for_picture(exif: Exif, orientation: int, software: str, comment: str) -> Exif:
    """The data of a picture in sRGB that was made from the file of ``exif`` without turning it.

    ``orientation``: the tag, if the file has none. ``comment`` is the user comment, in ASCII.
    """
    made = Exif(exif.order)
    made.main = {tag: exif.main[tag] for tag in KEPT_OF_MAIN if tag in exif.main}
    made.main.setdefault(ORIENTATION, made.short(orientation))
    made.main[SOFTWARE] = _ascii(software)
    made.exif = {tag: entry for tag, entry in exif.exif.items() if tag not in NOT_KEPT_OF_EXIF}
    text = b"ASCII\0\0\0" + comment.encode("ascii", "replace")
    made.exif[USER_COMMENT] = Entry(UNDEFINED, len(text), text)
    made.exif[COLOUR_SPACE] = made.short(1)
    return made


def _ascii(text: str) -> Entry:
    value = text.encode("ascii", "replace") + b"\0"
    return Entry(ASCII, len(value), value)


def directories(exif: Exif, at: int) -> bytes:
    """Both directories for a file in which they begin at ``at``."""
    main = {**exif.main, EXIF_DIRECTORY: exif.longs(0)}
    main[EXIF_DIRECTORY] = exif.longs(at + len(_directory(exif.order, main, at)))
    written = _directory(exif.order, main, at)
    return written + _directory(exif.order, exif.exif, at + len(written))


def block(exif: Exif) -> bytes:
    """A block for the segment APP1 of a JPEG."""
    mark = b"II" if exif.order == "<" else b"MM"
    return b"Exif\0\0" + struct.pack(f"{exif.order}2sHI", mark, 42, 8) + directories(exif, 8)


def _directory(order: str, entries: Mapping[int, Entry], at: int) -> bytes:
    behind = at + 2 + 12 * len(entries) + 4
    table, values = struct.pack(f"{order}H", len(entries)), b""
    for tag, entry in sorted(entries.items()):
        place = entry.value.ljust(4, b"\0")
        if len(entry.value) > 4:
            place = struct.pack(f"{order}I", behind + len(values))
            values += entry.value + b"\0" * (len(entry.value) % 2)
        table += struct.pack(f"{order}HHI", tag, entry.kind, entry.count) + place
    return table + bytes(4) + values
