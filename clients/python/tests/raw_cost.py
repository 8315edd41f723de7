"""What the conversion of camera raw files costs: prints the figures of docs/CAPTURE.md.

In ``clients/python``: ``python tests/raw_cost.py 6000 4000`` writes a raw file of that size with the noise of a sensor
(14 bits, 4 electrons per step, 12 electrons of read noise), and converts it alone and eight at a time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy
from dng import Dng

from pinstack import Member, StoredZip
from pinstack.push.converter import Converter
from pinstack.push.raws import RawOptions


class Noisy(Dng):
    """Smooth light with detail, and the noise of a sensor."""

    def samples(self) -> bytes:
        y, x = numpy.linspace(0, 1, self.height)[:, None], numpy.linspace(0, 1, self.width)[None]
        light = numpy.clip(0.05 + 0.4 * x * y + 0.1 * numpy.sin(80 * x) * numpy.sin(90 * y), 0, 1)
        light[0::2, 0::2] *= self.neutral[0]
        light[1::2, 1::2] *= self.neutral[2]
        light *= self.white - self.black
        light += numpy.random.default_rng(1).normal(size=light.shape) * numpy.sqrt(light / 4 + 9) + self.black
        return numpy.clip(numpy.round(light), 0, 16383).astype("<u2").tobytes()


def most_memory() -> float:
    """The most memory that this process had, MB."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1e3 * 1.024


def measure(folder: Path, kind: str, count: int) -> None:
    source = StoredZip([Member.of(folder / "a.dng", f"{at}.dng") for at in range(count)])
    source.members = [replace(member, path=folder / "a.dng") for member in source.members]
    converter = Converter(4.0, RawOptions(format=kind))
    before = most_memory()
    recipe = converter.recipe(source, 0, lambda: None)
    began = time.perf_counter()
    targets = {at: folder / f"{at}.{kind}" for at in range(count)}
    converter.convert(source, recipe, targets, lambda done: None)
    spent, size = time.perf_counter() - began, targets[0].stat().st_size
    memory, pixels = most_memory() - before, recipe.width * recipe.height
    bound = recipe.memory(source.members[0].size) / 1e6
    each = f"{spent / count:.1f} s and {size / 1e6:.0f} MB a file ({size / pixels:.2f} bytes/px)"
    taken = f"{memory:.0f} MB of memory ({memory * 1e6 / pixels:.1f} bytes/px; bound of one: {bound:.0f} MB)"
    print(f"{kind}, {count} files: {each}, {taken}")


def levels(folder: Path) -> None:
    import tifffile

    pixels: Any = tifffile.imread(folder / "0.tiff")
    for level in (1, 6):
        began, size = time.perf_counter(), 0
        for start in range(0, len(pixels), 64):
            strip = pixels[start : start + 64]
            differences = strip.copy()
            differences[:, 1:] -= strip[:, :-1]
            size += len(zlib.compress(differences.tobytes(), level))
        print(f"deflate, level {level}: {time.perf_counter() - began:.1f} s, {100 * size / pixels.nbytes:.1f} %")


if __name__ == "__main__":
    if len(sys.argv) == 4:
        measure(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]))
        sys.exit()
    with tempfile.TemporaryDirectory() as name:
        Noisy(int(sys.argv[1]), int(sys.argv[2])).write(Path(name) / "a.dng")
        for kind in ("tiff", "jpeg"):
            for count in ("1", "8"):
                # a process each: its memory is that of this conversion
                subprocess.run([sys.executable, __file__, name, kind, count], check=True)
        levels(Path(name))
