"""Which files below a folder are the slices of which stack.

In: a folder. Out: a :class:`Found` with its stacks and all files that belong to none, each with the reason. The
service groups the names (``POST /v1/groupings``), so the rules exist once: folders, words for the lights in six
languages, focus steps, pan and tilt in names, ``manifest.json``. Nothing is sent but names.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path, PurePath, PurePosixPath
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Set, Tuple

from .._errors import PinstackError
from .._paths import on_disk, shown, walk
from .._zips import StoredZip, is_picture, is_skipped_folder, utf8
from .bursts import by_bursts
from .names import result_stems
from .raws import INSTALL, is_raw, is_supported, one_of_each_shot

#: Groups names, with the content of their ``manifest.json``; returns what ``Client.group_names`` does.
Ask = Callable[[Sequence[str], Optional[Mapping[str, Any]]], Mapping[str, Any]]

#: Files that systems put beside pictures, in lower case.
OF_SYSTEMS = frozenset({"thumbs.db", "ehthumbs.db", "desktop.ini"})
#: How the names of folders with converted slices begin.
SPOOLS = ".pinstack-raw"


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
        """The zip that is sent, of raw files before their conversion; nothing is copied."""
        return StoredZip.of_slices(self.front, self.back, is_ordered=self.is_ordered)

    def files(self) -> List[Path]:
        """All slices."""
        return [*self.front, *self.back]

    def has_raws(self) -> bool:
        """Whether its slices are converted before they are sent."""
        return any(is_raw(path) for path in self.files())


@dataclass
class Found:
    """What a folder holds."""

    stacks: List[FoundStack] = field(default_factory=list)
    #: Files and folders that belong to no stack, and why.
    ignored: List[Tuple[Path, str]] = field(default_factory=list)
    #: Those of ``ignored`` that cannot be read: stacks or slices may be missing.
    unread: List[Tuple[Path, str]] = field(default_factory=list)
    #: What people should know about the folder.
    notes: List[str] = field(default_factory=list)


def find(
    root: Path,
    ask: Ask,
    results: Optional[Path] = None,
    gap_s: Optional[float] = None,
    save: Sequence[str] = ("image", "mask"),
    prefer: Optional[str] = None,
    raw_suffix: str = ".tif",
) -> Found:
    """The stacks in a folder and below it. ``results`` is passed over.

    ``gap_s``: files of a folder that were taken more than this time apart belong to different stacks.
    ``save``: the artifacts that will be saved; those of two stacks must not have the same file name.
    ``prefer``: as in :class:`.settings.Settings`. ``raw_suffix``: the ending of converted raw files.
    """
    found = Found()
    files = _shots(root, files_below(root, results, found), prefer, found)
    manifest = _manifest(files, raw_suffix)
    names = {_sent_name(path.relative_to(root), raw_suffix): path for path in files}
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
        if stack.problem is None and stack.has_raws():
            stack.problem = _problem_of_raws(stack)
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


def _shots(root: Path, files: List[Path], prefer: Optional[str], found: Found) -> List[Path]:
    """The files, with one of each raw file and picture of the same name."""
    supported = is_supported()
    prefers_raw = supported if prefer is None else prefer == "raw"
    kept, left_out = one_of_each_shot(files, prefers_raw, supported)
    found.ignored.extend(left_out)
    count = sum(is_raw(path) for path, _ in left_out)
    if count and not supported and prefer is None:
        found.notes.append(f"{root}: the pictures beside {count} camera raw files are sent; {INSTALL}")
    return kept


def _sent_name(relative: PurePath, raw_suffix: str) -> str:
    """The name that the service groups: that of the converted file for a raw file."""
    return (relative.with_suffix(raw_suffix) if is_raw(relative) else relative).as_posix()


def _problem_of_raws(stack: FoundStack) -> Optional[str]:
    """Why a stack with raw files cannot be sent; None if it can."""
    raws = [path for path in stack.files() if is_raw(path)]
    other = next((path for path in stack.files() if not is_raw(path)), None)
    if other is not None:
        both = f"{raws[0].name} is a camera raw file, and {other.name} is none"
        return f"{both}; send all slices of the stack, of both lights, as raw files, or none (--prefer picture)"
    return None if is_supported() else f"{raws[0].name} is a camera raw file; {INSTALL}"


def files_below(root: Path, results: Optional[Path], found: Found) -> List[Path]:
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
                is_own = name.startswith(SPOOLS)
                if name.startswith(".") and not is_own and _has_pictures(here / name):
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


def _manifest(files: Sequence[Path], raw_suffix: str) -> Optional[Mapping[str, Any]]:
    """The content of the manifest that the service will look for, the least deep one, with the names that are sent."""
    named = [path for path in files if path.name.lower() == "manifest.json"]
    if not named:
        return None
    path = min(named, key=lambda path: len(path.parts))
    try:
        content = json.loads(on_disk(path).read_bytes())
    except (OSError, ValueError) as error:
        raise PinstackError("invalid_source", f"{path} cannot be read as JSON: {error}") from error
    shots = {path.stem.casefold() for path in files if is_raw(path)}
    return _with_sent_names(content, shots, raw_suffix) if isinstance(content, dict) else {}


def _with_sent_names(content: Any, shots: Set[str], raw_suffix: str) -> Any:
    """The content of a manifest in which the files that are raw files here have the names that are sent."""
    if isinstance(content, dict):
        return {key: _with_sent_names(value, shots, raw_suffix) for key, value in content.items()}
    if isinstance(content, list):
        return [_with_sent_names(value, shots, raw_suffix) for value in content]
    path = PurePosixPath(content) if isinstance(content, str) else PurePosixPath()
    is_shot = (is_raw(path) or is_picture(path)) and path.stem.casefold() in shots
    return str(path.with_suffix(raw_suffix)) if is_shot else content


def _have_same_names(slices: Sequence[Path]) -> bool:
    """Whether slices of several folders have the same name."""
    return len({path.name.casefold() for path in slices}) < len(slices)
