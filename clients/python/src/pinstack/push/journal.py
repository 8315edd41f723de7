"""What was sent, on disk.

A SQLite file: it survives a crash at any moment, is in the standard library of Python, and its lock ends with the
process that holds it, on every system. One process at a time uses a journal.

A stack is known again by what is sent and to which service: names, sizes and content of its files, its options, and the
identity of the service. Not by the address of the service, and not by times: equal times only save the reading. Nor by
the name of its folder, where that is only the label: the folder may have been renamed.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, List, Mapping, Optional

from .._errors import PinstackError
from .._paths import on_disk
from .._zips import StoredZip


@dataclass(frozen=True)
class Entry:
    """What is known of a stack."""

    #: Path of its upload at the service.
    upload: Optional[str] = None
    #: Path of the stack at the service.
    job: Optional[str] = None
    #: How it ended, once its results are saved: ``done``, or the sentence of the error.
    ended: Optional[str] = None
    #: The code of that error.
    code: Optional[str] = None
    #: The ``state`` of the :class:`.causes.Site` that it was sent to.
    seen: Optional[str] = None
    #: The identity of the converted files that its upload was begun with.
    spool: Optional[str] = None


@dataclass(frozen=True)
class View:
    """A view of a scan that was sent."""

    key: str
    name: str
    job: str
    #: Its first file.
    place: Path
    #: The same for the same pictures.
    content: Optional[str]


@dataclass(frozen=True)
class Key:
    """By what a stack is found in the journal."""

    #: The same for the same service, rig, lens, options, label, and names, sizes and times of files.
    value: str
    #: The same without the times, and without a label that is only the name of the folder.
    shape: str
    #: The value in a journal of an earlier version: with the address of the service, and the label.
    earlier: str


#: The columns of a stack beside its key.
COLUMNS = ("name", "upload", "job", "ended", "code", "seen", "shape", "content", "scan", "place", "spool")


class Journal:
    """The journal in a file. Each change is on the disk when the method returns."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            on_disk(path.parent).mkdir(parents=True, exist_ok=True)
            self._rows = sqlite3.connect(on_disk(path), timeout=0.5, isolation_level=None, check_same_thread=False)
        except (OSError, sqlite3.Error) as error:
            raise _not_written(path, error) from error
        try:
            # held until the process ends
            self._rows.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._rows.execute("PRAGMA synchronous = FULL")
            self._rows.execute("BEGIN EXCLUSIVE")
            self._rows.execute("CREATE TABLE IF NOT EXISTS stacks (key TEXT PRIMARY KEY)")
            there = {row[1] for row in self._rows.execute("PRAGMA table_info(stacks)")}
            for column in COLUMNS:
                if column not in there:
                    self._rows.execute(f"ALTER TABLE stacks ADD COLUMN {column} TEXT")
            self._rows.execute("COMMIT")
        except sqlite3.OperationalError as error:
            self._rows.close()
            if "locked" in str(error):
                detail = f"another push or watch uses the journal {path}; wait for it, or choose another --journal"
                raise PinstackError("invalid_source", detail) from error
            raise _not_written(path, error) from error
        except sqlite3.DatabaseError as error:
            self._rows.close()
            detail = f"{path} is damaged or no journal ({error}); move it away: stacks may then be sent again"
            raise PinstackError("invalid_source", detail) from error

    def close(self) -> None:
        """Ends the lock."""
        self._rows.close()

    def recognise(self, key: Key, name: str, place: Path, content: Callable[[], str]) -> Entry:
        """What is known of a stack, by its key or by its content. It is known by this key and name from now on.

        ``place`` is its first file. ``content`` reads the files. It is called only if a stack was sent whose files have
        these names and sizes, but other times, or were in a folder of another name that is not there any more.
        """
        if not self._is_there(key.value):
            self._rename(key.earlier, key.value)
        if not self._is_there(key.value):
            select = "SELECT key, content, name, place FROM stacks WHERE shape = ? AND content IS NOT NULL"
            alike = self._rows.execute(select, (key.shape,)).fetchall()
            # a folder that was renamed is the same stack, a copy of one is another
            alike = [row for row in alike if row[2] == name or not on_disk(Path(row[3])).exists()]
            own = content() if alike else None
            self._rename(next((row[0] for row in alike if row[1] == own), None), key.value)
        update = "UPDATE stacks SET name = ?, place = ?, shape = ? WHERE key = ?"
        self._rows.execute(update, (name, str(place), key.shape, key.value))
        return self.entry(key.value)

    def _rename(self, key: Optional[str], to: str) -> None:
        self._rows.execute("UPDATE stacks SET key = ? WHERE key = ?", (to, key))

    def _is_there(self, key: str) -> bool:
        return self._rows.execute("SELECT 1 FROM stacks WHERE key = ?", (key,)).fetchone() is not None

    def entry(self, key: str) -> Entry:
        """What is known of the stack with this key."""
        select = "SELECT upload, job, ended, code, seen, spool FROM stacks WHERE key = ?"
        row = self._rows.execute(select, (key,)).fetchone()
        return Entry(*row) if row is not None else Entry()

    def note(self, key: str, name: str, **values: Optional[str]) -> None:
        """Stores columns of a stack."""
        self._rows.execute("INSERT OR IGNORE INTO stacks (key, name) VALUES (?, ?)", (key, name))
        for column in COLUMNS:
            if column in values:
                self._rows.execute(f"UPDATE stacks SET {column} = ? WHERE key = ?", (values[column], key))

    def forget(self, key: str) -> None:
        """The stack will be sent as a new one."""
        self._rows.execute("DELETE FROM stacks WHERE key = ?", (key,))

    def forget_name(self, name: str) -> bool:
        """The stack of this name will be sent as a new one, however it ended. Returns whether there is one."""
        return self._rows.execute("DELETE FROM stacks WHERE name = ?", (name,)).rowcount > 0

    def views(self, scan: str) -> List[View]:
        """The views of a scan that were done."""
        select = "SELECT min(key), name, job, place, content FROM stacks WHERE scan = ? AND ended = 'done' GROUP BY job"
        found = self._rows.execute(select, (scan,))
        return [View(key, name, job, Path(at), content) for key, name, job, at, content in found]


def _not_written(path: Path, error: Exception) -> PinstackError:
    reason = (error.strerror if isinstance(error, OSError) else None) or error
    detail = f"the journal {path} cannot be written: {reason}; choose another place with --journal"
    return PinstackError("invalid_source", detail)


def key_of(
    service: str, server: str, rig: str, lens: str, options: Mapping[str, Any], files: StoredZip, has_own_label: bool
) -> Key:
    """The key of a stack at a service, by its identity. ``server`` is its address.

    Without ``has_own_label``, the label is only the name of the folder.
    """
    counted = {name: value for name, value in options.items() if name != "label" or has_own_label}
    shape = _digest([service, rig, lens, counted, files.shape()])
    earlier = _digest([server.rstrip("/"), rig, lens, dict(options), _earlier_fingerprint(files)])
    return Key(_digest([shape, files.times(), options.get("label")]), shape, earlier)


def _earlier_fingerprint(files: StoredZip) -> str:
    crc = 0
    for member in files.members:
        text = f"{member.name}\0{member.size}\0{member.modified_ns}\n"
        crc = zlib.crc32(text.encode("utf-8", "surrogatepass"), crc)
    return f"{len(files.members)}-{files.length}-{crc:08x}"


def _digest(values: List[Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode("utf-8", "surrogatepass")).hexdigest()
