"""Sends one stack, waits for it, and saves its results."""

from __future__ import annotations

import sqlite3
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

from .._client import Client
from .._errors import PinstackError
from .._http import TEMPORARY
from .._paths import shown
from .folders import FoundStack
from .journal import Entry, Journal, key_of
from .results import missing, save_results
from .settings import Settings

#: Codes of stacks that failed because of the machine of the service, so they may succeed when they are sent again.
OF_THE_MACHINE = frozenset({"unavailable", "insufficient_storage", "worker_lost", "internal"})

#: Called with a stack's name, what happens to it, and how far it is (0 to 1).
OnStep = Callable[[str, str, float], None]


@dataclass
class Outcome:
    """How a stack ended."""

    name: str
    #: ``done``, ``refused``, ``failed``, ``unreachable``, ``incomplete``, or ``known`` if its results were there.
    state: str
    #: What a person should know: an error, or warnings.
    sentences: List[str] = field(default_factory=list)
    #: The stack at the service.
    stack: Optional[Dict[str, Any]] = None
    files: List[Path] = field(default_factory=list)

    @property
    def is_good(self) -> bool:
        """Whether the results are there."""
        return self.state in ("done", "known")


def options_of(stack: FoundStack, settings: Settings) -> Dict[str, Any]:
    """The options that a stack is sent with."""
    options: Dict[str, Any] = {"label": stack.name[:200], **settings.options}
    if settings.scan is not None:
        options.update({"scan": settings.scan, **stack.angles})
    return options


def key(stack: FoundStack, settings: Settings) -> str:
    """The key of a stack in the journal."""
    options = options_of(stack, settings)
    return key_of(settings.server, settings.rig, settings.lens, options, stack.zip().fingerprint())


def send(
    client: Client, journal: Journal, found: FoundStack, settings: Settings, results: Path, on_step: OnStep
) -> Outcome:
    """Does what is left to do for a stack. It raises nothing that concerns this stack alone."""
    try:
        return _send(client, journal, found, settings, results, on_step)
    except PinstackError as error:
        states = {"unreachable": "unreachable", "source_changed": "incomplete", "timeout": "unreachable"}
        state = states.get(error.code, "failed" if error.status == 0 else "refused")
        if isinstance(error.__cause__, PermissionError):
            # another program holds a slice: the next try may pass
            state = "incomplete"
        if error.status in TEMPORARY or error.code == "locked":
            # a gateway, a full queue, or another request that works on the upload: the next try may pass
            state = "unreachable"
        places = [str(place.get("file")) for place in error.errors if place.get("file")]
        return Outcome(found.name, state, [error.detail, *[f"see {place}" for place in places[:5]]])
    except sqlite3.Error as error:
        # what was sent before this is known to the service: the next run asks it
        return Outcome(found.name, "incomplete", [f"the journal cannot be written: {error}; is its disk full?"])
    except OSError as error:
        # the next run continues where this one ended
        return Outcome(found.name, "incomplete", [f"{shown(error.filename or found.view)}: {error.strerror or error}"])


def _send(
    client: Client, journal: Journal, found: FoundStack, settings: Settings, results: Path, on_step: OnStep
) -> Outcome:
    if found.problem is not None:
        return Outcome(found.name, "refused", [found.problem])
    source = found.zip()
    at = key(found, settings)
    entry = journal.entry(at)
    if entry.ended == "done":
        return _known(client, entry, found.name, settings, results, on_step)
    if entry.ended is not None:
        not_again = "it was not sent again; change a file or an option, or remove the journal"
        return Outcome(found.name, "failed", [entry.ended, not_again])
    job = entry.job
    if job is None:
        on_step(found.name, "sending", 0.0)
        sent = client.send_stack(
            source,
            settings.rig,
            settings.lens,
            resume=entry.upload,
            on_created=lambda path: journal.note(at, found.name, upload=path),
            on_bytes=lambda done, total: on_step(found.name, "sending", done / max(total, 1)),
            **options_of(found, settings),
        )
        job = str(sent["links"]["self"])
        journal.note(at, found.name, job=job)
    on_step(found.name, "waiting", 0.0)
    try:
        stack = client.wait(
            job, on_progress=lambda p: on_step(found.name, str(p["stage"]), float(p["fraction"])), check=False
        )
    except PinstackError as error:
        if error.status in (404, 410):
            # deleted at the service: the next run sends it again
            journal.forget(at)
        raise
    if stack["state"] != "succeeded":
        problem_of_job = stack.get("error") or {}
        detail = str(problem_of_job.get("detail") or "it was cancelled at the service")
        if problem_of_job.get("code") in OF_THE_MACHINE:
            journal.forget(at)
            return Outcome(found.name, "failed", [detail, "the next run sends it again"], stack)
        journal.note(at, found.name, ended=detail)
        return Outcome(found.name, "failed", [detail], stack)
    on_step(found.name, "saving", 0.0)
    files = save_results(client, stack, found.name, settings.save, results)
    journal.note(at, found.name, ended="done")
    sentences = [str(warning["detail"]) for warning in stack.get("warnings", [])]
    return Outcome(found.name, "done", sentences, stack, files)


def _known(client: Client, entry: Entry, name: str, settings: Settings, results: Path, on_step: OnStep) -> Outcome:
    """A stack that was done in an earlier run: results that are not there any more are fetched again."""
    wanted = missing(name, settings.save, results)
    if entry.job is None or not wanted:
        return Outcome(name, "known")
    try:
        stack = client.get_stack(entry.job)
    except PinstackError as error:
        if error.status not in (404, 410):
            raise
        # it may never have had some of them, such as the mask of a stack without back light
        if len(wanted) < len(settings.save):
            return Outcome(
                name, "known", [f"the service has it no longer, so there is no {', '.join(wanted)} to fetch"]
            )
        sentence = (
            "its results are missing here, and the service has it no longer; to send it again, remove the journal"
        )
        return Outcome(name, "failed", [sentence])
    on_step(name, "saving", 0.0)
    return Outcome(name, "known", [], dict(stack), save_results(client, stack, name, wanted, results))
