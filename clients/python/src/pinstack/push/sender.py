"""Sends one stack, waits for it, and saves its results."""

from __future__ import annotations

import contextlib
import sqlite3
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

from .._client import Client
from .._errors import PinstackError
from .._http import TEMPORARY
from .._paths import shown
from .._zips import StoredZip
from .causes import Again, Site, again_after
from .folders import FoundStack
from .journal import Entry, Journal, Key, key_of
from .results import missing, save_results
from .settings import Settings
from .spool import Spool

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
    #: What sends it again; None if its results are there.
    again: Optional[Again] = None
    #: A person ended it at the service, so it is not sent again at once.
    was_ended: bool = False

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


def key(stack: FoundStack, settings: Settings, site: Site) -> Key:
    """The key of a stack in the journal."""
    options = options_of(stack, settings)
    # the name of a view is its label
    has_own_label = "label" in settings.options or "scan" in options
    if stack.has_raws():
        options["raw"] = asdict(settings.raw_options())
    server, rig, lens = settings.server, settings.rig, settings.lens
    return key_of(site.id, server, rig, lens, options, stack.zip(), has_own_label)


@dataclass
class Sender:
    """Sends stacks, one at a time."""

    client: Client
    journal: Journal
    settings: Settings
    results: Path
    on_step: OnStep
    site: Site
    #: Where the slices of stacks of raw files are converted.
    spool: Optional[Spool] = None
    #: Called with a stack's name and the bytes that are sent for it, where they become known.
    on_size: Callable[[str, int], None] = lambda name, size: None

    def send(self, found: FoundStack) -> Outcome:
        """Does what is left to do for a stack. It raises nothing that concerns this stack alone."""
        try:
            return self._send(found)
        except PinstackError as error:
            places = [str(place.get("file")) for place in error.errors if place.get("file")]
            sentences = [error.detail, *[f"see {place}" for place in places[:5]]]
            if error.code == "source_changed" or isinstance(error.__cause__, PermissionError):
                # a file changes, or another program holds it: the next try may pass
                return Outcome(found.name, "incomplete", sentences, again=Again.LATER)
            state = "failed" if error.status == 0 else "refused"
            if error.status in TEMPORARY or error.code in ("unreachable", "timeout", "locked"):
                state = "unreachable"
            again, was_ended = again_after(error.code), is_gone(error)
            return Outcome(found.name, state, sentences, again=again, was_ended=was_ended)
        except sqlite3.Error as error:
            # what was sent before this is known to the service: the next try asks it
            sentence = f"the journal cannot be written: {error}; is its disk full?"
        except OSError as error:
            # the next try continues where this one ended
            sentence = f"{shown(error.filename or found.view)}: {error.strerror or error}"
        return Outcome(found.name, "incomplete", [sentence], again=Again.LATER)

    def _send(self, found: FoundStack) -> Outcome:
        if found.problem is not None:
            return Outcome(found.name, "refused", [found.problem], again=Again.CHANGE)
        source, at = found.zip(), key(found, self.settings, self.site)

        def content() -> str:
            self.on_step(found.name, "comparing", 0.0)
            return source.content()

        entry = self.journal.recognise(at, found.name, found.files()[0].absolute(), content)
        if entry.ended == "done":
            return self._known(entry, found.name)
        if entry.ended is not None:
            again = again_after(entry.code) if entry.code is not None else Again.CHANGE
            if again is Again.CHANGE or (again is Again.PROFILE and entry.seen == self.site.state):
                return Outcome(found.name, "failed", [entry.ended], again=again)
            self.journal.forget(at.value)
            entry = Entry()
        job = entry.job
        if job is None:
            job = self._upload(found, source, at, entry.upload)
            entry = self.journal.entry(at.value)
        self.on_step(found.name, "waiting", 0.0)
        try:
            stack = self.client.wait(
                job, on_progress=lambda p: self.on_step(found.name, str(p["stage"]), float(p["fraction"])), check=False
            )
        except PinstackError as error:
            if is_gone(error):
                # deleted at the service
                self.journal.forget(at.value)
            raise
        if stack["state"] != "succeeded":
            return self._failed(found, at, dict(stack), entry.seen)
        self.on_step(found.name, "saving", 0.0)
        files = save_results(self.client, stack, found.name, self.settings.save, self.results)
        self.journal.note(at.value, found.name, ended="done")
        sentences = [str(warning["detail"]) for warning in stack.get("warnings", [])]
        return Outcome(found.name, "done", sentences, dict(stack), files)

    def _upload(self, found: FoundStack, source: StoredZip, at: Key, resume: Optional[str]) -> str:
        """Sends the files, or the rest of them, and returns the path of the stack."""
        self.on_step(found.name, "sending", 0.0)
        options = options_of(found, self.settings)
        scan = scan_key(self.site, str(options["scan"])) if "scan" in options else None
        place = str(found.files()[0].absolute())
        self.journal.note(at.value, found.name, shape=at.shape, seen=self.site.state, scan=scan, place=place)
        spool = self.spool or Spool(self.journal, self.settings) if found.has_raws() else None
        zipped = source
        if spool is not None:
            zipped, made = spool.converted(
                found, source, at.value, lambda share: self.on_step(found.name, "converting", share)
            )
            if made != self.journal.entry(at.value).spool:
                # of an earlier upload are other bytes there
                self.journal.note(at.value, found.name, spool=made, upload=None)
                resume = None
            self.on_size(found.name, zipped.length)
            self.on_step(found.name, "sending", 0.0)
        sent = self.client.send_stack(
            zipped,
            self.settings.rig,
            self.settings.lens,
            resume=resume,
            on_created=lambda path: self.journal.note(at.value, found.name, upload=path),
            on_bytes=lambda done, total: self.on_step(found.name, "sending", done / max(total, 1)),
            **options,
        )
        job = str(sent["links"]["self"])
        self.journal.note(at.value, found.name, job=job)
        if spool is not None:
            spool.remove(at.value)
        with contextlib.suppress(OSError, PinstackError):
            # without it, the stack is only not known again by other times
            self.journal.note(at.value, found.name, content=source.content())
        return job

    def _failed(self, found: FoundStack, at: Key, stack: Dict[str, Any], seen: Optional[str]) -> Outcome:
        """The outcome of a stack that ended without results; ``seen``: of the service that it was sent to."""
        problem = stack.get("error") or {"code": "cancelled"}
        code, detail = str(problem["code"]), str(problem.get("detail") or "it was cancelled at the service")
        again = again_after(code)
        if again is Again.PROFILE and seen != self.site.state:
            # the profile is another already
            again = Again.LATER
        if again is Again.LATER:
            self.journal.forget(at.value)
        else:
            self.journal.note(at.value, found.name, ended=detail, code=code)
        return Outcome(found.name, "failed", [detail], stack, again=again, was_ended=code == "cancelled")

    def _known(self, entry: Entry, name: str) -> Outcome:
        """A stack that was done in an earlier run: results that are not there any more are fetched again."""
        wanted = missing(name, self.settings.save, self.results)
        if entry.job is None or not wanted:
            return Outcome(name, "known")
        try:
            stack = self.client.get_stack(entry.job)
        except PinstackError as error:
            if not is_gone(error):
                raise
            # it may never have had some of them, such as the mask of a stack without back light
            if len(wanted) < len(self.settings.save):
                sentence = f"the service has it no longer, so there is no {', '.join(wanted)} to fetch"
                return Outcome(name, "known", [sentence])
            sentence = "its results are missing here, and the service has it no longer"
            return Outcome(name, "failed", [sentence], again=Again.CHANGE)
        self.on_step(name, "saving", 0.0)
        return Outcome(name, "known", [], dict(stack), save_results(self.client, stack, name, wanted, self.results))


def scan_key(site: Site, scan: str) -> str:
    """A scan of a service, in the journal."""
    return f"{site.id} {scan}"


def is_gone(error: PinstackError) -> bool:
    """Whether the service, and not a proxy, says that it has the stack no longer."""
    return error.code in ("not_found", "upload_removed")
