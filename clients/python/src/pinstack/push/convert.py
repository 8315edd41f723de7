"""The command ``pinstack convert``: camera raw files become pictures in a folder of the same layout.

In: folders. Out: a picture for each raw file, below the folder of the results. A stack is a folder of raw files, with
the raw files of both lights where they are in folders such as ``front`` and ``back``; its files are converted as
``push`` does it. No service is needed.
"""

from __future__ import annotations

import argparse
import re
import threading
from pathlib import Path, PurePath
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from .._errors import PinstackError
from .._paths import on_disk, shown
from .._zips import Member, StoredZip, member_name
from .converter import Converter
from .folders import Found, files_below
from .lights import is_back, stack_of
from .progress import Progress
from .raws import SUFFIXES, RawOptions, is_raw, one_of_each_shot, require_support
from .run import Stopped


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument("folders", nargs="+", metavar="DIR")
    parser.add_argument("-o", "--out", type=Path, help="folder of the pictures (default: DIR-converted; with several "
                        "folders, one in it for each)")  # fmt: skip
    parser.add_argument(
        "--format", choices=sorted(SUFFIXES), default="tiff", help="16-bit TIFF or JPEG (default: tiff)"
    )
    parser.add_argument("--quality", type=int, default=95, help="quality of JPEG, 1 to 100 (default: 95)")
    parser.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="make brighter (default: 0)")
    parser.add_argument("--memory-gb", type=float, default=4.0, help="memory that it may take (default: 4)")
    parser.add_argument("--force", action="store_true", help="write files again that are there already")


def convert(folders: Sequence[Path], given: Mapping[str, Any], stop: threading.Event) -> int:
    """Runs the command and returns its exit code. Raises ``invalid_source`` for wrong usage, and ``Stopped``."""
    require_support()
    options = RawOptions(given["format"], given["quality"], given["exposure"])
    options.check()
    if given["memory_gb"] <= 0:
        raise PinstackError("invalid_source", "memory_gb must be more than 0")
    progress, found = Progress(0), Found()
    stacks: Dict[Path, List[Tuple[Path, Path]]] = {}
    for folder in folders:
        out = _out(folder, given["out"], len(folders) > 1)
        files, left_out = one_of_each_shot(files_below(folder, out, found), prefers_raw=True, supported=True)
        found.ignored.extend(left_out)
        for path in sorted(filter(is_raw, files), key=_natural):
            to = (out / path.relative_to(folder)).with_suffix(options.suffix)
            # the files of the folder itself are one stack, whatever its name
            stacks.setdefault(Path(stack_of(path)) if path.parent != folder else folder, []).append((path, to))
    _refuse(folders, stacks, given["force"])
    for path, reason in [*found.unread, *((path, why) for path, why in found.ignored if is_raw(path))]:
        progress.say(f"{path} {reason}")
    progress.total = len(stacks)
    converter = Converter(given["memory_gb"], options)
    failed = sum(not _convert_stack(stack, files, converter, progress, stop) for stack, files in stacks.items())
    progress.say(f"{len(stacks) - failed} of {len(stacks)} stacks are converted")
    return 1 if failed or found.unread else 0


def _convert_stack(
    stack: Path, files: Sequence[Tuple[Path, Path]], converter: Converter, progress: Progress, stop: threading.Event
) -> bool:
    """Converts a stack; False if it failed, which is said."""
    front = [path for path, _ in files if not is_back(path)] or [path for path, _ in files]
    reference = front[len(front) // 2]

    def check(done: int = 0) -> None:
        if stop.is_set():
            raise Stopped
        progress.step(str(stack), "converting", done / len(files))

    try:
        source = StoredZip(Member.of(path, member_name(path)) for path, _ in files)
        indices = {member.path: index for index, member in enumerate(source.members)}
        recipe = converter.recipe(source, indices[reference], check)
        for _, to in files:
            on_disk(to.parent).mkdir(parents=True, exist_ok=True)
        converter.convert(source, recipe, {indices[path]: to for path, to in files}, check)
    except PinstackError as error:
        progress.say(f"{stack}: failed: {error.detail}")
        return False
    except OSError as error:
        progress.say(f"{stack}: failed: {shown(error.filename or stack)}: {error.strerror or error}")
        return False
    progress.say(f"{stack}: {len(files)} files, with the white balance of {reference.name}")
    return True


def _out(folder: Path, chosen: Optional[Path], is_one_of_several: bool) -> Path:
    name = folder.resolve().name or "pictures"
    if chosen is None:
        return folder.resolve().with_name(f"{name}-converted")
    return chosen / name if is_one_of_several else chosen


def _refuse(folders: Sequence[Path], stacks: Mapping[Path, List[Tuple[Path, Path]]], force: bool) -> None:
    """Raises ``invalid_source`` if there is nothing to convert, or if a file would replace another."""
    if not stacks:
        told = ", ".join(str(folder) for folder in folders)
        raise PinstackError("invalid_source", f"there are no camera raw files in {told}")
    targets: Dict[Path, Path] = {}
    for path, to in (pair for pairs in stacks.values() for pair in pairs):
        other = targets.setdefault(to, path)
        if other != path:
            raise PinstackError("invalid_source", f"{other} and {path} would both become {to}; convert one by one")
        if not force and on_disk(to).exists():
            detail = f"{to} is there already; give --force to write it again, or another folder with --out"
            raise PinstackError("invalid_source", detail)


def _natural(path: PurePath) -> List[Tuple[int, str]]:
    """Sorts ``img_2`` before ``img_10``."""
    parts = re.split(r"(\d+)", str(path).casefold())
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]
