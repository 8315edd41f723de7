"""Which files below a folder are the slices of which stack.

In: a folder. Out: a :class:`Found` with its stacks and all files that belong to none, each with the reason. The
service groups the names (``POST /v1/groupings``), so the rules exist once: folders, words for the lights in six
languages, focus steps, pan and tilt in names, ``manifest.json``. Nothing is sent but names.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple

from .._errors import PinstackError
from .._paths import on_disk, shown, walk
from .._zips import StoredZip, is_picture, is_skipped_folder, utf8
from .bursts import by_bursts
from .names import result_stems

#: Groups names, with the content of their ``manifest.json``; returns what ``Client.group_names`` does.
Ask = Callable[[Sequence[str], Optional[Mapping[str, Any]]], Mapping[str, Any]]

#: Files that systems put beside pictures, in lower case.
OF_SYSTEMS = frozenset({"thumbs.db", "ehthumbs.db", "desktop.ini"})


@dataclass
class FoundStack:
    """The slices of one stack."""

    #: What the service calls the view: folders and the part of the file names that name it.
    view: str
    #: The label of the stack and of its results.
    name: str
    front: List[Path]
    back: List[Path] = field(default_factory=list)
    #: ``pan_deg`` and ``tilt_deg``, if names tell both.
    angles: Dict[str, float] = field(default_factory=dict)
    #: Why it cannot be sent as it is; None if it can.
    problem: Optional[str] = None
    #: The order of the lists is not that of the names, or several slices have the same name.
    is_ordered: bool = False

    def zip(self) -> StoredZip:
        """The zip that is sent; nothing is copied."""
        return StoredZip.of_slices(self.front, self.back, is_ordered=self.is_ordered)

    def files(self) -> List[Path]:
        """All slices."""
        return [*self.front, *self.back]


@dataclass
class Found:
    """What a folder holds."""

    stacks: List[FoundStack] = field(default_factory=list)
    #: Files and folders that belong to no stack, and why.
    ignored: List[Tuple[Path, str]] = field(default_factory=list)
    #: Those of ``ignored`` that cannot be read: stacks or slices may be missing.
    unread: List[Tuple[Path, str]] = field(default_factory=list)


def find(
    root: Path,
    ask: Ask,
    results: Optional[Path] = None,
    gap_s: Optional[float] = None,
    save: Sequence[str] = ("image", "mask"),
) -> Found:
    """The stacks in a folder and below it. ``results`` is passed over.

    ``gap_s``: files of a folder that were taken more than this time apart belong to different stacks.
    ``save``: the artifacts that will be saved; those of two stacks must not have the same file name.
    """
    found = Found()
    files = _files(root, results, found)
    manifest = _manifest(files)
    names = {path.relative_to(root).as_posix(): path for path in files}
    times: Dict[Path, float] = {}
    unread: Dict[Path, Path] = {}
    if gap_s is not None:
        bursts = by_bursts(names, gap_s)
        names, times = bursts.names, bursts.times
        found.ignored.extend(bursts.untimed)
        found.unread.extend(one for one in bursts.untimed if one[0] in bursts.unread)
        unread = {path.parent: path for path in bursts.unread}
    if not names:
        return found
    grouping = ask(list(names), manifest)
    for view in grouping["views"]:
        # with times, their order: the numbers of a camera begin anew after 9999
        front, back = (
            sorted((names[name] for name in view[light]), key=lambda path: times.get(path, 0.0))
            for light in ("front", "back")
        )
        if not front and not back:
            found.ignored.append((root, f"the view {view['name']} of the manifest has no picture"))
            continue
        angles = {angle: float(view[angle]) for angle in ("pan_deg", "tilt_deg") if view[angle] is not None}
        found.stacks.append(
            FoundStack(
                str(view["name"]),
                str(view["name"]).replace("/", "_") or utf8(root.resolve().name).decode() or "stack",
                front,
                back,
                angles if len(angles) == 2 else {},
                view["problem"],
                is_ordered=manifest is not None or bool(times) or _have_same_names(front) or _have_same_names(back),
            )
        )
    for stack in found.stacks:
        # it may be a slice of this stack, and the number of a burst may be another
        held = next((unread[path.parent] for path in stack.files() if path.parent in unread), None)
        if held is not None and stack.problem is None:
            stack.problem = f"{held} cannot be read, so its stack is not known; is it still being written?"
    found.ignored.extend((names[file["name"]], str(file["reason"])) for file in grouping["ignored"])
    refuse_same_names(found, save)
    return found


def refuse_same_names(found: Found, save: Sequence[str]) -> None:
    """Results of two stacks with the same file name would replace each other: the later stack is refused.

    ``save``: the artifacts that will be saved.
    """
    owners: Dict[str, FoundStack] = {}
    for stack in found.stacks:
        stems = {stem.casefold(): stem for stem in result_stems(stack.name, save)}
        taken = next((key for key in stems if key in owners), None)
        if taken is None:
            owners.update(dict.fromkeys(stems, stack))
            continue
        other = owners[taken]
        if other.name.casefold() == stack.name.casefold():
            stack.problem = f"the stack of {other.files()[0]} has the same name, {stack.name}; rename one"
        else:
            both = f"the stacks {other.name} and {stack.name}"
            stack.problem = f"results of {both} would have the same file name, {stems[taken]}; rename one of the stacks"


def _files(root: Path, results: Optional[Path], found: Found) -> List[Path]:
    """All files that may matter, in a stable order."""
    passed_over = results.resolve() if results is not None else None
    files: List[Path] = []

    def unreadable(error: OSError) -> None:
        found.unread.append((Path(shown(error.filename or root)), f"cannot be read: {error.strerror or error}"))
        found.ignored.append(found.unread[-1])

    for here, names, file_names in walk(root, unreadable):
        for name in list(names):
            if is_skipped_folder(name) or (here / name).resolve() == passed_over:
                names.remove(name)
                if name.startswith(".") and _has_pictures(here / name):
                    found.ignored.append((here / name, "a hidden folder; rename it to send its pictures"))
        names.sort()
        for name in sorted(file_names):
            if name.startswith(".") or name.lower() in OF_SYSTEMS:
                continue
            if _can_be_sent((here / name).relative_to(root)):
                files.append(here / name)
            else:
                reason = "its name cannot be sent: it has control characters or a backslash, or is not valid text"
                found.ignored.append((here / name, reason))
    return files


def _can_be_sent(relative: PurePath) -> bool:
    # what is not valid text is not printable either
    return all(part.isprintable() and "\\" not in part for part in relative.parts)


def _has_pictures(folder: Path) -> bool:
    return any(is_picture(PurePath(name)) for _, _, names in walk(folder) for name in names)


def _manifest(files: Sequence[Path]) -> Optional[Mapping[str, Any]]:
    """The content of the manifest that the service will look for: the least deep one."""
    named = [path for path in files if path.name.lower() == "manifest.json"]
    if not named:
        return None
    path = min(named, key=lambda path: len(path.parts))
    try:
        content = json.loads(on_disk(path).read_bytes())
    except (OSError, ValueError) as error:
        raise PinstackError("invalid_source", f"{path} cannot be read as JSON: {error}") from error
    return content if isinstance(content, dict) else {}


def _have_same_names(slices: Sequence[Path]) -> bool:
    """Whether slices of several folders have the same name."""
    return len({path.name.casefold() for path in slices}) < len(slices)
