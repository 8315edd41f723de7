"""Settings of a push: the command line wins over the environment, and that over the file of the rig (TOML).

The file has the names of the options of the command line, with ``_`` for ``-``, a table ``options`` for those of the
stacks, and a table ``names`` for what numbers in names mean::

    server = "http://stacker:8080"
    token_file = "C:/pinstack/token.txt"
    rig = "bench-1"
    lens = "macro65-1x"
    results = "D:/results"

    [options]
    method = "pyramid"
"""

from __future__ import annotations

import contextlib
import re
import sys
import threading
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional

from .._errors import PinstackError
from .._operations import RULES
from .._paths import on_disk
from .raws import RawOptions

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: Options of stacks that are texts, also when they look like numbers.
TEXTS = frozenset({"label", "scan"})
#: Values of ``back_light``.
BACK_LIGHTS = ("auto", "always", "never")
#: Values of ``prefer``.
PREFERENCES = ("raw", "picture")
#: A number as JSON writes it. Others, such as ``007`` and ``1_000``, are texts.
NUMBER = re.compile(r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]+)?")


class TokenFile:
    """A file with the access token. It is read for every request, so a new token counts at once.

    A file that is empty or missing for a moment, because it is being written, keeps the last token.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._token = self._read()
        self._lock = threading.Lock()
        #: Called with a sentence when the file has a new token.
        self.on_change: Callable[[str], None] = lambda _: None

    def _read(self) -> str:
        try:
            token = on_disk(self._path).read_text("utf-8-sig").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise _wrong(f"the token in {self._path} cannot be read: {error}") from error
        if not token:
            raise _wrong(f"the token file {self._path} is empty")
        return token

    def token(self) -> str:
        """The token as it is now."""
        with self._lock, contextlib.suppress(PinstackError):
            token = self._read()
            if token != self._token:
                self._token = token
                self.on_change(f"the token in {self._path} has changed; it is used from now on")
        return self._token


@dataclass
class Settings:
    """Everything a push needs to know."""

    server: str = "http://127.0.0.1:8080"
    #: Of the environment; never shown.
    token: Optional[str] = field(default=None, repr=False)
    #: The file of the token, which wins over ``token``.
    token_file: Optional[TokenFile] = None
    rig: str = ""
    lens: str = ""
    scan: Optional[str] = None
    #: Folder of the results; None: a folder ``results`` in the folder that is sent.
    results: Optional[Path] = None
    #: The journal; None: a file in the folder that is sent.
    journal: Optional[Path] = None
    #: Artifacts that are saved.
    save: List[str] = field(default_factory=lambda: ["image", "mask"])
    #: Stacks at a time.
    jobs: int = 2
    #: How long nothing may change in a folder before it is sent, seconds.
    quiet_s: float = 20.0
    #: A pause between two pictures of a folder after which another stack begins, seconds; None: none does.
    gap_s: Optional[float] = None
    #: How often ``watch`` looks, seconds.
    every_s: float = 5.0
    #: Whether each stack has a back light: ``always``, ``never``, or ``auto``: ``watch`` waits for it where another
    #: stack of the folder has one.
    back_light: str = "auto"
    #: Which is sent of a raw file and a picture of the same name, ``raw`` or ``picture``; None: the raw file where
    #: it can be converted.
    prefer: Optional[str] = None
    #: How raw files are converted: :class:`.raws.RawOptions`.
    raw_format: str = "tiff"
    raw_quality: int = 95
    raw_exposure: float = 0.0
    #: Memory that conversions take together, GB.
    raw_memory_gb: float = 4.0
    #: Folder of converted slices while they are sent; None: that of the journal.
    raw_temp: Optional[Path] = None
    #: What numbers in names mean, such as ``x_degrees_per_unit``.
    names: Dict[str, Any] = field(default_factory=dict)
    #: Options of the stacks.
    options: Dict[str, Any] = field(default_factory=dict)

    def waits_for_back_light(self, other_stacks_have_one: bool) -> bool:
        """Whether a stack of front light alone is not complete."""
        of_mask = {"required": "always", "none": "never"}
        chosen = of_mask.get(str(self.options.get("mask")), "auto") if self.back_light == "auto" else self.back_light
        return chosen == "always" or (chosen == "auto" and other_stacks_have_one)

    def raw_options(self) -> RawOptions:
        """How raw files are converted."""
        return RawOptions(self.raw_format, self.raw_quality, float(self.raw_exposure))

    def check(self, is_dry_run: bool = False) -> None:
        """Raises ``invalid_source`` with what is missing or out of range. To group files needs no rig and lens."""
        for name in () if is_dry_run else ("rig", "lens"):
            if not getattr(self, name):
                raise _wrong(f"{name} is missing: give --{name}, or {name} in the file of the rig")
        if not 1 <= self.jobs <= 16:
            raise _wrong(f"jobs is {self.jobs}; it must be 1 to 16")
        if self.gap_s is not None and self.gap_s <= 0:
            raise _wrong("gap_s must be more than 0")
        if self.back_light not in BACK_LIGHTS:
            raise _wrong(f"back_light is {self.back_light!r}; it must be one of {', '.join(BACK_LIGHTS)}")
        if self.prefer not in (None, *PREFERENCES):
            raise _wrong(f"prefer is {self.prefer!r}; it must be one of {', '.join(PREFERENCES)}")
        if self.raw_memory_gb <= 0:
            raise _wrong("raw_memory_gb must be more than 0")
        self.raw_options().check()
        unknown = sorted(set(self.names) - RULES)
        if unknown:
            raise _wrong(f"names: there is no rule {unknown[0]!r}; there are {', '.join(sorted(RULES))}")
        if self.quiet_s < 0 or self.every_s <= 0:
            raise _wrong("quiet_s must not be negative, and every_s must be more than 0")
        unknown = sorted(set(self.save) - {"image", "mask", "depth", "backlight", "height", "height-sigma", "preview"})
        if unknown:
            raise _wrong(f"save: there is no artifact {unknown[0]!r}")


def load(file: Optional[Path], given: Mapping[str, Any], environment: Mapping[str, str]) -> Settings:
    """The settings from the file of the rig, the environment and the command line, the last first.

    ``PINSTACK_URL`` and ``PINSTACK_TOKEN`` are read from the environment.
    """
    values: Dict[str, Any] = _read(file) if file is not None else {}
    of_rig = values.pop("token_file", None)
    if "PINSTACK_URL" in environment:
        values["server"] = environment["PINSTACK_URL"]
    if given.get("token_file") is not None:
        values["token_file"] = TokenFile(Path(given["token_file"]))
    elif "PINSTACK_TOKEN" in environment:
        values["token"] = environment["PINSTACK_TOKEN"]
    elif of_rig is not None:
        values["token_file"] = TokenFile(Path(str(of_rig)))
    options = {**values.pop("options", {}), **(given.get("options") or {})}
    names = {**values.pop("names", {}), **(given.get("names") or {})}
    known = {one.name: one for one in fields(Settings)}
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise _wrong(
            f"{file}: there is no setting {unknown[0]!r}; there are {', '.join(sorted({*known, 'token_file'}))}"
        )
    own = set(known) - {"token_file"}
    values.update({name: value for name, value in given.items() if name in own and value is not None})
    for name in ("results", "journal", "raw_temp"):
        if values.get(name) is not None:
            values[name] = Path(str(values[name])).expanduser()
    settings = Settings(**{**values, "options": options, "names": names})
    for name, kind in (
        ("jobs", int),
        ("quiet_s", (int, float)),
        ("gap_s", (int, float)),
        ("every_s", (int, float)),
        ("save", list),
        ("raw_quality", int),
        ("raw_exposure", (int, float)),
        ("raw_memory_gb", (int, float)),
    ):
        if getattr(settings, name) is not None and not isinstance(getattr(settings, name), kind):
            raise _wrong(f"{name} has the wrong type in {file or 'the settings'}")
    settings.check(bool(given.get("dry_run")))
    return settings


def _read(file: Path) -> Dict[str, Any]:
    try:
        # Notepad and PowerShell write a byte order mark before UTF-8
        return tomllib.loads(on_disk(file).read_text("utf-8-sig"))
    except OSError as error:
        raise _wrong(f"the settings {file} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise _wrong(f"the settings {file} are not in UTF-8 (byte {error.start}); save the file as UTF-8") from error
    except tomllib.TOMLDecodeError as error:
        raise _wrong(f"the settings {file} are not valid TOML: {error}") from error


def option(text: str) -> Dict[str, Any]:
    """An option of a stack from the command line: ``method=pyramid``, ``r1=30``, ``mask_threshold=0.4``."""
    name, sign, value = text.partition("=")
    if not sign or not name:
        raise _wrong(f"{text!r} is no option; write name=value, such as method=pyramid")
    if name in TEXTS:
        return {name: value}
    number = NUMBER.fullmatch(value)
    if number is not None:
        return {name: float(value) if number[2] or number[3] else int(value)}
    return {name: {"true": True, "false": False}.get(value, value)}


def _wrong(detail: str) -> PinstackError:
    return PinstackError("invalid_source", detail)
