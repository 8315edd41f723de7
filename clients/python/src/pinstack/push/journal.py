"""What was sent, on disk.

A SQLite file: it survives a crash at any moment, is in the standard library of Python, and its lock ends with the
process that holds it, on every system. One process at a time uses a journal.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Mapping, Optional

from .._errors import PinstackError
from .._paths import on_disk


@dataclass(frozen=True)
class Entry:
    """What is known of a stack."""

    #: Path of its upload at the service.
    upload: Optional[str] = None
    #: Path of the stack at the service.
    job: Optional[str] = None
    #: How it ended, once its results are saved: ``done``, or the sentence of the error.
    ended: Optional[str] = None


class Journal:
    """The journal in a file. Each change is on the disk when the method returns."""

    def __init__(self, path: Path) -> None:
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
            self._rows.execute(
                "CREATE TABLE IF NOT EXISTS stacks (key TEXT PRIMARY KEY, name TEXT, upload TEXT, job TEXT, ended TEXT)"
            )
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

    def entry(self, key: str) -> Entry:
        """What is known of the stack with this key."""
        row = self._rows.execute("SELECT upload, job, ended FROM stacks WHERE key = ?", (key,)).fetchone()
        return Entry(*row) if row is not None else Entry()

    def note(self, key: str, name: str, **values: Optional[str]) -> None:
        """Stores ``upload``, ``job`` or ``ended``."""
        self._rows.execute("INSERT OR IGNORE INTO stacks (key, name) VALUES (?, ?)", (key, name))
        for column in ("upload", "job", "ended"):
            if column in values:
                self._rows.execute(f"UPDATE stacks SET {column} = ? WHERE key = ?", (values[column], key))

    def forget(self, key: str) -> None:
        """The stack will be sent as a new one."""
        self._rows.execute("DELETE FROM stacks WHERE key = ?", (key,))


def _not_written(path: Path, error: Exception) -> PinstackError:
    reason = (error.strerror if isinstance(error, OSError) else None) or error
    detail = f"the journal {path} cannot be written: {reason}; choose another place with --journal"
    return PinstackError("invalid_source", detail)


def key_of(server: str, rig: str, lens: str, options: Mapping[str, Any], fingerprint: str) -> str:
    """The same for the same files, service, rig, lens and options."""
    text = json.dumps([server.rstrip("/"), rig, lens, dict(options), fingerprint], sort_keys=True)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
