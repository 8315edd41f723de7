"""Which folders below a folder are stacks.

In: a folder. Out: a :class:`Found` with its stacks and all files that belong to none, each with the reason. A stack is

| folders | example |
|---|---|
| with a folder per light | ``view_01/front/1.jpg``, ``view_01/back/1.jpg`` |
| beside one for the back light | ``view_01/1.jpg``, ``view_01_back/1.jpg`` |
| with front light only | ``view_01/1.jpg`` |

Only folders are looked at. Where views are told apart by file names, send the folder as one scan
(``Client.send_scan``): the service takes it apart.
"""

from __future__ import annotations

import os
import re
import unicodedata
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Optional, Tuple

from .._zips import StoredZip, is_picture

#: Names of folders with front-light slices, without separators and accents; those of the service.
FRONT = frozenset(
    [
        "front", "frontlight", "frontlit", "fg", "foreground", "withoutbacklight", "vorne", "vordergrund",
        "vorderlicht", "frontlicht", "auflicht", "beleuchtet", "ohnegegenlicht", "avant", "devant",
        "lumiereavant", "eclairageavant", "sanscontrejour", "frente", "frontal", "delante", "luzfrontal",
        "sincontraluz", "fronte", "frontale", "davanti", "lucefrontale", "senzacontroluce", "voor", "voorkant",
        "voorgrond", "voorlicht", "opvallendlicht", "zondertegenlicht",
    ]
)  # fmt: skip
#: The same for back-light slices.
BACK = frozenset(
    [
        "back", "backlight", "backlit", "bg", "background", "withbacklight", "hinten", "hintergrund",
        "hintergrundlicht", "gegenlicht", "durchlicht", "rucklicht", "ruecklicht", "mitgegenlicht", "arriere",
        "derriere", "fond", "contrejour", "aveccontrejour", "lumierearriere", "eclairagearriere",
        "retroeclairage", "contraluz", "concontraluz", "fondo", "detras", "trasera", "luztrasera",
        "retroiluminacion", "controluce", "concontroluce", "dietro", "retro", "sfondo", "retroilluminazione",
        "achter", "achterkant", "achtergrond", "achterlicht", "tegenlicht", "doorvallendlicht",
    ]
)  # fmt: skip
#: Names of folders that hold results or pictures of a target, in lower case; those of the service.
NO_SLICES = frozenset(
    [
        "stacked", "fused", "edof", "mask", "masks", "masked", "cutout", "cutouts", "thumbs", "thumbnails",
        "preview", "previews", "result", "results", "output", "outputs", "calibration", "calib", "target",
        "dots",
    ]
)  # fmt: skip


@dataclass
class StackFolder:
    """The slices of one stack."""

    #: Its folder.
    path: Path
    #: Path below the folder that was searched, with ``_`` for ``/``: the label of the stack and of its results.
    name: str
    front: List[Path]
    back: List[Path] = field(default_factory=list)
    #: A folder above it that is named after a light, as in a tree per light.
    above: Optional[str] = None

    @property
    def problem(self) -> Optional[str]:
        """Why it cannot be sent as it is; None if it can."""
        if self.above is not None:
            return f"the folder {self.above} names a light for several views; send the whole as one scan"
        if _are_several([path.stem for path in self.front]):
            return "its file names seem to tell several views or lights, or formats, apart; send it as one scan"
        if len(self.front) < 2:
            return f"{len(self.front)} front-light picture; a focus stack has at least 2"
        if self.back and len(self.back) != len(self.front):
            return f"{len(self.front)} front-light and {len(self.back)} back-light pictures; the counts must be equal"
        return None

    @property
    def angles(self) -> Dict[str, float]:
        """``pan_deg`` and ``tilt_deg`` if its name has both: ``pan020p5_tilt-06``, ``x=6/y=120`` (tilt, pan)."""
        return angles(self.name)

    def zip(self) -> StoredZip:
        """The zip that is sent; nothing is copied."""
        return StoredZip.of_slices(self.front, self.back)

    def files(self) -> List[Path]:
        """All slices."""
        return [*self.front, *self.back]


@dataclass
class Found:
    """What a folder holds."""

    stacks: List[StackFolder] = field(default_factory=list)
    #: Files that belong to no stack, and why.
    ignored: List[Tuple[Path, str]] = field(default_factory=list)


def find(root: Path, results: Optional[Path] = None) -> Found:
    """The stacks in a folder and below it, in natural order of their names. ``results`` is passed over."""
    found = Found()
    passed_over = results.resolve() if results is not None else None
    pictures: Dict[Path, List[Path]] = {}
    for folder, names, files in os.walk(root):
        names.sort(key=natural)
        here = Path(folder)
        hidden = [name for name in names if name.startswith(".") or name == "__MACOSX"]
        for name in [*hidden, *(name for name in names if (here / name).resolve() == passed_over)]:
            names.remove(name)
        below = here.relative_to(root)
        for name in sorted(files, key=natural):
            reason = _no_slice(below, name)
            if reason is None:
                pictures.setdefault(here, []).append(here / name)
            elif reason:
                found.ignored.append((here / name, reason))
    found.stacks = _stacks(root, pictures)
    return found


def _no_slice(below: Path, name: str) -> Optional[str]:
    """Why a file is no slice: None if it is one, an empty text if that needs no mention."""
    if name.startswith(".") or name.lower() in ("thumbs.db", "desktop.ini"):
        return ""
    if not is_picture(Path(name)):
        return "not a JPEG, PNG or TIFF picture"
    for part in below.parts:
        if part.lower() in NO_SLICES:
            return f"the folder {part} holds results or pictures of a target"
    return None


def _stacks(root: Path, pictures: Dict[Path, List[Path]]) -> List[StackFolder]:
    stacks: Dict[str, StackFolder] = {}
    shown = {folder: light(folder.name) if folder != root else None for folder in pictures}
    paired = _pairs(root, pictures)
    for folder, files in pictures.items():
        view, which = paired.get(folder, (folder, "front"))
        if shown[folder] is not None:
            view, which = folder.parent, str(shown[folder])
        # case makes no other folder on Windows
        key = str(view).casefold()
        above = next((part for part in view.relative_to(root).parts if light(part) is not None), None)
        stack = stacks.setdefault(key, StackFolder(view, _name(root, view), [], above=above))
        (stack.back if which == "back" else stack.front).extend(files)
    for stack in stacks.values():
        stack.front.sort(key=lambda path: natural(path.name))
        stack.back.sort(key=lambda path: natural(path.name))
    return sorted(stacks.values(), key=lambda stack: natural(stack.name))


def _are_several(stems: List[str]) -> bool:
    """Whether file names differ in more than their last number, twice or more each, or two have the same stem."""
    views: Dict[str, int] = {}
    for stem in stems:
        view = re.sub(r"[-+]?\d+(?=\D*$)", "", stem.lower())
        views[view] = views.get(view, 0) + 1
    twins = len({stem.lower() for stem in stems}) < len(stems)
    return twins or sum(count > 1 for count in views.values()) > 1


def _pairs(root: Path, pictures: Dict[Path, List[Path]]) -> Dict[Path, Tuple[Path, str]]:
    """View and light of folders such as ``bee_back`` beside ``bee`` or ``bee_front``."""
    read: Dict[Path, Tuple[Path, str]] = {}
    for folder in pictures:
        parts = re.fullmatch(r"(.+?)[_\-. ]+([^\W\d]+(?:[_\- ][^\W\d]+)?)", folder.name)
        which = light(parts.group(2)) if parts is not None and folder != root else None
        if parts is not None and which is not None:
            read[folder] = (folder.with_name(parts.group(1)), which)
    lights: Dict[Path, set[str]] = {}
    for folder in pictures:
        view, which = read.get(folder, (folder, "front"))
        lights.setdefault(view, set()).add(which)
    return {folder: place for folder, place in read.items() if lights[place[0]] == {"front", "back"}}


def light(name: str) -> Optional[str]:
    """``front`` or ``back`` if a folder of this name stands for a light. Case, accents and separators do not matter."""
    plain = unicodedata.normalize("NFKD", name.lower())
    plain = "".join(c for c in plain if not unicodedata.combining(c) and c not in " _-")
    if plain in FRONT:
        return "front"
    return "back" if plain in BACK else None


def _name(root: Path, view: Path) -> str:
    parts = view.relative_to(root).parts or (root.resolve().name or "stack",)
    return safe_name("_".join(parts))


#: Names that Windows reserves for devices.
DEVICES = frozenset({"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(1, 10))})


def safe_name(name: str) -> str:
    """A name that every system allows for a file, and that shells need not quote."""
    text = re.sub(r"[^\w.=+-]+", "_", name).strip("._ ")
    stem = text.split(".")[0].lower()
    return f"_{text}" if stem in DEVICES or not text else text[:120]


def natural(name: str) -> List[Tuple[int, int, str]]:
    """Sorts names as the service does: numbers by value, with their sign after ``_``, ``=`` and at the start."""
    pieces = re.split(r"((?:(?<=[_=/])[-+]|^[-+])?\d+)", name)
    # every second piece is a number
    return [(0, int(piece), "") if at % 2 else (1, 0, piece.lower()) for at, piece in enumerate(pieces) if piece]


NUMBER = r"[_= ]?([-+]?\d+(?:[.p]\d+)?)"


def angles(name: str) -> Dict[str, float]:
    """Pan and tilt in the name of a view, in degrees; empty unless it has both exactly once."""
    found: Dict[str, float] = {}
    for words in (("pan", "tilt"), ("y=", "x=")):
        for word, option in zip(words, ("pan_deg", "tilt_deg")):
            numbers = re.findall(rf"(?<![^\W\d_])(?<!\d){word}{NUMBER}", name.lower())
            if len(numbers) == 1:
                found.setdefault(option, float(numbers[0].replace("p", ".")))
    return found if len(found) == 2 else {}
