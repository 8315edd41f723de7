"""Tells stacks apart by the times at which their pictures were taken.

For cameras that number pictures through: a stack is a burst, and the next one begins after a pause. Each burst becomes
a folder in the names that the service groups, so front and back light are paired as folders are: the first burst of
``front`` with the first of ``back``.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path, PurePosixPath
from typing import Dict, List, Mapping, Optional, Tuple

from .._paths import on_disk
from .._zips import is_picture
from .exif import FRACTION, TAKEN, read_exif
from .raws import is_raw


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
        if not (is_picture(path) or is_raw(path)):
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
    """When a picture or raw file was taken, in seconds, by its EXIF data; None if it does not say."""
    with on_disk(path).open("rb") as file:
        exif = read_exif(file)
    if exif is None or TAKEN not in exif.exif:
        return None
    try:
        # the zone does not matter: only differences count
        taken = datetime.strptime(exif.text(TAKEN), "%Y:%m:%d %H:%M:%S").replace(tzinfo=timezone.utc)
        fraction = exif.text(FRACTION)
    except ValueError:
        # foreign
        return None
    return taken.timestamp() + (float(f"0.{fraction}") if fraction.isdigit() else 0.0)
