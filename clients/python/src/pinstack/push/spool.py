"""Converted slices of the stacks that are being sent, on disk.

An upload needs its length before its first byte, and the same bytes when it continues. So the slices of a stack are
converted before its upload begins, while other stacks are sent, and stay here until the service has the last byte.

| what happens | what then |
|---|---|
| the connection or this program ends while a stack is converted | the next run converts the slices that are missing |
| ... while it is sent | the next run continues the upload, from the same files |
| the files here were deleted | they are converted again, and the upload begins anew |
| the service has the stack, or the stack has changed | its files are deleted |
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
import uuid
from pathlib import Path, PurePosixPath
from typing import Any, Callable, Dict, Iterator, Optional, Tuple

from .._errors import PinstackError
from .._paths import on_disk
from .._zips import Member, StoredZip
from .converter import Converter
from .folders import SPOOLS, FoundStack
from .journal import Journal
from .raws import Recipe, require_support, versions
from .settings import Settings

#: What a folder of the spool is for.
INFO = "stack.json"
#: Age after which files of a stack are deleted that is not there any more, seconds.
OLD_S = 7 * 86_400.0


class Spool:
    """The converted slices of the stacks of a journal."""

    def __init__(self, journal: Journal, settings: Settings) -> None:
        own = hashlib.sha256(str(journal.path.absolute()).encode("utf-8", "surrogatepass")).hexdigest()[:8]
        self._root = (settings.raw_temp or journal.path.parent) / f"{SPOOLS}-{own}"
        self._journal = journal
        self._converter = Converter(settings.raw_memory_gb, settings.raw_options())
        self._remove_old()

    def converted(
        self, found: FoundStack, source: StoredZip, key: str, on_share: Callable[[float], None]
    ) -> Tuple[StoredZip, str]:
        """The zip of a stack of raw files, and the identity of its files: another one means other bytes.

        ``source`` is the zip of the raw files, and ``key`` the key of the stack in the journal. ``on_share`` is called
        with the share of the slices that are converted; it may raise to end the conversion.
        """
        require_support()
        folder = self._root / key[:16]
        suffix = self._converter.options.suffix
        targets = {index: folder / f"{index:05d}{suffix}" for index in range(len(source.members))}
        info = self._begun(found, folder, key, targets)
        missing = {index: to for index, to in targets.items() if not on_disk(to).exists()}
        if missing:
            before = len(targets) - len(missing)
            reference = found.front[len(found.front) // 2]
            at = next(at for at, member in enumerate(source.members) if member.path == reference)
            recipe = self._converter.recipe(source, at, lambda: on_share(0.0))
            self._refuse_small_disk(found, recipe, len(missing))
            self._converter.convert(source, recipe, missing, lambda done: on_share((before + done) / len(targets)))
        info["complete"] = True
        _write(folder, info)
        members = [
            Member.of(targets[index], str(PurePosixPath(member.name).with_suffix(suffix)))
            for index, member in enumerate(source.members)
        ]
        return StoredZip(members, name=source.name), str(info["id"])

    def remove(self, key: str) -> None:
        """Deletes the files of a stack."""
        shutil.rmtree(on_disk(self._root / key[:16]), ignore_errors=True)
        if on_disk(self._root).is_dir() and not any(on_disk(self._root).iterdir()):
            shutil.rmtree(on_disk(self._root), ignore_errors=True)

    def _begun(self, found: FoundStack, folder: Path, key: str, targets: Dict[int, Path]) -> Dict[str, Any]:
        """What is known of the files of a stack; they are deleted where they cannot be continued."""
        place = str(found.files()[0].absolute())
        for other, info in self._folders():
            # the stack has changed
            if info.get("place") == place and info.get("key") != key:
                shutil.rmtree(on_disk(other), ignore_errors=True)
        known = _read(folder)
        if known is not None:
            is_whole = all(on_disk(to).exists() for to in targets.values())
            if is_whole if known.get("complete") else known.get("made_by") == versions():
                return known
            shutil.rmtree(on_disk(folder))
        on_disk(folder).mkdir(parents=True, exist_ok=True)
        begun = {"id": uuid.uuid4().hex, "key": key, "place": place, "made_by": versions(), "complete": False}
        _write(folder, begun)
        return begun

    def _refuse_small_disk(self, found: FoundStack, recipe: Recipe, count: int) -> None:
        needed, free = recipe.disk() * count, shutil.disk_usage(on_disk(self._root)).free
        if needed > free:
            detail = (
                f"{found.name}: its {count} slices take up to {needed / 1e9:.1f} GB when they are converted, but "
                f"{self._root} has {free / 1e9:.1f} GB left; free some, choose another disk with --raw-temp, fewer "
                "stacks at a time with --jobs, or --raw-format jpeg"
            )
            raise PinstackError("insufficient_storage", detail)

    def _folders(self) -> Iterator[Tuple[Path, Dict[str, Any]]]:
        if on_disk(self._root).is_dir():
            for entry in sorted(on_disk(self._root).iterdir()):
                yield self._root / entry.name, _read(self._root / entry.name) or {}

    def _remove_old(self) -> None:
        """Deletes what no upload needs: this program ended before it could."""
        for folder, info in self._folders():
            entry = self._journal.entry(str(info.get("key")))
            is_gone = not on_disk(Path(str(info.get("place")))).exists()
            is_old = time.time() - on_disk(folder).stat().st_mtime > OLD_S
            if entry.job is not None or (is_gone and is_old):
                shutil.rmtree(on_disk(folder), ignore_errors=True)


def _read(folder: Path) -> Optional[Dict[str, Any]]:
    try:
        info = json.loads(on_disk(folder / INFO).read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return info if isinstance(info, dict) else None


def _write(folder: Path, info: Dict[str, Any]) -> None:
    part = on_disk(folder / f"{INFO}.part")
    part.write_text(json.dumps(info), "utf-8")
    part.replace(on_disk(folder / INFO))
