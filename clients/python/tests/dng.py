"""Camera raw files for the tests: uncompressed Bayer DNG files of an even grey, or of any light."""

from __future__ import annotations

import array
import struct
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Dict, List, Sequence, Tuple, Union

Value = Union[bytes, str, Sequence[float]]
#: Types of TIFF: byte, text, 16 bits, 32 bits, fraction, bytes of another meaning, signed fraction.
BYTE, ASCII, SHORT, LONG, RATIONAL, UNDEFINED, SRATIONAL = 1, 2, 3, 4, 5, 7, 10


@dataclass
class Dng:
    """A picture of the light ``light(x, y)`` from 0 to 1, as a sensor sees it whose white is ``neutral``."""

    width: int = 64
    height: int = 48
    light: Callable[[int, int], float] = lambda x, y: 0.25
    #: What a white surface is in red, green and blue: ``AsShotNeutral``.
    neutral: Tuple[float, float, float] = (0.5, 1.0, 0.625)
    #: The neutral of the light that was really there, if the camera was wrong.
    real: Tuple[float, float, float] = (0.0, 0.0, 0.0)
    black: int = 512
    white: int = 15871
    orientation: int = 1
    taken: str = "2026:11:23 10:00:00"
    fraction: str = "25"
    #: Columns and rows around the picture that cameras leave out.
    border: int = 0
    order: str = "<"
    more: Dict[int, Tuple[int, Value]] = field(default_factory=dict)

    def samples(self) -> bytes:
        """The sensor: red and green in even rows, green and blue in odd ones."""
        red, green, blue = self.real if any(self.real) else self.neutral
        pattern = ((red, green), (green, blue))
        scale = self.white - self.black
        values = array.array("H", (
            min(round(self.black + self.light(x, y) * pattern[y % 2][x % 2] * scale), 65535)
            for y in range(self.height) for x in range(self.width)
        ))  # fmt: skip
        if (self.order == "<") != (sys.byteorder == "little"):
            values.byteswap()
        return values.tobytes()

    def bytes(self) -> bytes:
        """The file."""
        data = self.samples()
        edge, inner = self.border, (self.width - 2 * self.border, self.height - 2 * self.border)
        exif: Dict[int, Tuple[int, Value]] = {
            33434: (RATIONAL, [1, 60]), 33437: (RATIONAL, [8, 1]), 34855: (SHORT, [200]),
            36864: (UNDEFINED, b"0230"), 36867: (ASCII, self.taken), 37521: (ASCII, self.fraction),
            37386: (RATIONAL, [65, 1]), 37500: (UNDEFINED, b"maker note"), 42036: (ASCII, "Macro 65mm f/2.8"),
        }  # fmt: skip
        main: Dict[int, Tuple[int, Value]] = {
            254: (LONG, [0]), 256: (LONG, [self.width]), 257: (LONG, [self.height]), 258: (SHORT, [16]),
            259: (SHORT, [1]), 262: (SHORT, [32803]), 271: (ASCII, "Lab"), 272: (ASCII, "Bench 1"),
            273: (LONG, [8]), 274: (SHORT, [self.orientation]), 277: (SHORT, [1]), 278: (LONG, [self.height]),
            279: (LONG, [len(data)]), 284: (SHORT, [1]), 306: (ASCII, "2026:11:24 09:00:00"), 315: (ASCII, "Ada"),
            33421: (SHORT, [2, 2]), 33422: (BYTE, bytes([0, 1, 1, 2])), 34665: (LONG, [0]),
            50706: (BYTE, bytes([1, 4, 0, 0])), 50707: (BYTE, bytes([1, 1, 0, 0])), 50708: (ASCII, "Lab Bench 1"),
            50714: (SHORT, [self.black]), 50717: (LONG, [self.white]),
            50719: (LONG, [edge, edge]), 50720: (LONG, list(inner)),
            # XYZ to camera: sRGB primaries, so neutral is what is left
            50721: (SRATIONAL, fractions([3.2405, -1.5371, -0.4985, -0.9693, 1.876, 0.0416, 0.0556, -0.204, 1.0572])),
            50728: (RATIONAL, fractions(self.neutral)), 50778: (SHORT, [21]),
            **self.more,
        }  # fmt: skip
        # the pixels are last, as in the files of most cameras
        size, exif_size = (len(directory(tags, 0, self.order)) for tags in (main, exif))
        main[34665], main[273] = (LONG, [8 + size]), (LONG, [8 + size + exif_size])
        head = struct.pack(f"{self.order}2sHI", b"II" if self.order == "<" else b"MM", 42, 8)
        return head + directory(main, 8, self.order) + directory(exif, 8 + size, self.order) + data

    def write(self, path: Path) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(self.bytes())
        return path


def fractions(values: Sequence[float]) -> List[int]:
    return [part for value in values for part in (round(value * 10_000), 10_000)]


def directory(tags: Dict[int, Tuple[int, Value]], at: int, order: str) -> bytes:
    """A directory of TIFF that is written at ``at``, with its values behind it."""
    entries, values = b"", b""
    behind = at + 2 + 12 * len(tags) + 4
    for tag, (kind, value) in sorted(tags.items()):
        if isinstance(value, str):
            value = value.encode() + b"\0"
        if isinstance(value, bytes):
            packed, count = value, len(value)
        else:
            letter = {SHORT: "H", LONG: "I", RATIONAL: "I", SRATIONAL: "i"}[kind]
            packed = struct.pack(f"{order}{len(value)}{letter}", *(int(one) for one in value))
            count = len(value) // 2 if kind in (RATIONAL, SRATIONAL) else len(value)
        place = packed.ljust(4, b"\0") if len(packed) <= 4 else struct.pack(f"{order}I", behind + len(values))
        values += (packed + b"\0" * (len(packed) % 2)) if len(packed) > 4 else b""
        entries += struct.pack(f"{order}HHI", tag, kind, count) + place
    return struct.pack(f"{order}H", len(tags)) + entries + bytes(4) + values
