"""Sends one stack, waits for it, and saves its results."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

from .._client import Client
from .._errors import PinstackError
from .._http import TEMPORARY
from .folders import StackFolder
from .journal import Journal, key_of
from .results import save_results
from .settings import Settings

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


def options_of(folder: StackFolder, settings: Settings) -> Dict[str, Any]:
    """The options that a stack is sent with."""
    options: Dict[str, Any] = {"label": folder.name[:200], **settings.options}
    if settings.scan is not None:
        options.update({"scan": settings.scan, **folder.angles})
    return options


def key(folder: StackFolder, settings: Settings) -> str:
    """The key of a stack in the journal."""
    options = options_of(folder, settings)
    return key_of(settings.server, settings.rig, settings.lens, options, folder.zip().fingerprint())


def send(
    client: Client, journal: Journal, folder: StackFolder, settings: Settings, results: Path, on_step: OnStep
) -> Outcome:
    """Does what is left to do for a stack. It raises nothing that concerns this stack alone."""
    try:
        return _send(client, journal, folder, settings, results, on_step)
    except PinstackError as error:
        states = {"unreachable": "unreachable", "source_changed": "incomplete", "timeout": "unreachable"}
        state = states.get(error.code, "failed" if error.status == 0 else "refused")
        if error.status in TEMPORARY:
            # a gateway, or a full queue: the next try may pass
            state = "unreachable"
        places = [str(place.get("file")) for place in error.errors if place.get("file")]
        return Outcome(folder.name, state, [error.detail, *[f"see {place}" for place in places[:5]]])
    except OSError as error:
        # the next run goes on where this one ended
        return Outcome(folder.name, "incomplete", [f"{error.filename or folder.path}: {error.strerror or error}"])


def _send(
    client: Client, journal: Journal, folder: StackFolder, settings: Settings, results: Path, on_step: OnStep
) -> Outcome:
    problem = folder.problem
    if problem is not None:
        return Outcome(folder.name, "refused", [f"{folder.path}: {problem}"])
    source = folder.zip()
    at = key(folder, settings)
    entry = journal.entry(at)
    if entry.ended == "done":
        return Outcome(folder.name, "known")
    if entry.ended is not None:
        return Outcome(folder.name, "failed", [entry.ended])
    job = entry.job
    if job is None:
        on_step(folder.name, "sending", 0.0)
        sent = client.send_stack(
            source,
            settings.rig,
            settings.lens,
            resume=entry.upload,
            on_created=lambda path: journal.note(at, folder.name, upload=path),
            on_bytes=lambda done, total: on_step(folder.name, "sending", done / max(total, 1)),
            **options_of(folder, settings),
        )
        job = str(sent["links"]["self"])
        journal.note(at, folder.name, job=job)
    on_step(folder.name, "waiting", 0.0)
    try:
        stack = client.wait(
            job, on_progress=lambda p: on_step(folder.name, str(p["stage"]), float(p["fraction"])), check=False
        )
    except PinstackError as error:
        if error.status in (404, 410):
            # deleted at the service: the next run sends it again
            journal.forget(at)
        raise
    if stack["state"] != "succeeded":
        problem_of_job = stack.get("error") or {}
        detail = str(problem_of_job.get("detail") or "it was cancelled at the service")
        journal.note(at, folder.name, ended=detail)
        return Outcome(folder.name, "failed", [detail], stack)
    on_step(folder.name, "saving", 0.0)
    files = save_results(client, stack, folder.name, settings.save, results)
    journal.note(at, folder.name, ended="done")
    sentences = [str(warning["detail"]) for warning in stack.get("warnings", [])]
    return Outcome(folder.name, "done", sentences, stack, files)
