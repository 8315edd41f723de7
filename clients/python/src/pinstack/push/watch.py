"""Sends stacks as they become complete.

It looks every few seconds, because notices of changes do not cross network drives. A stack is complete when none of its
files has changed for ``quiet_s`` seconds and each can be opened: on Windows, a file that is still being written
cannot.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Callable, Dict, List, Tuple

from .._client import Client
from .._errors import PinstackError
from .._paths import on_disk
from .._zips import is_picture
from .folders import Found, FoundStack, find
from .journal import Journal
from .progress import Progress
from .run import Stopped, ask_of, interruptible, send_all
from .sender import Outcome
from .settings import Settings

#: Name, size and time of each file.
State = Tuple[Tuple[str, int, int], ...]


class Complete:
    """Tells which stacks have been quiet for long enough."""

    def __init__(self, quiet_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._quiet_s = quiet_s
        self._clock = clock
        self._seen: Dict[Path, Tuple[State, float]] = {}

    def of(self, stacks: List[FoundStack]) -> List[FoundStack]:
        """The stacks that are complete now."""
        now = self._clock()
        return [stack for stack in stacks if self._is_quiet(stack, now)]

    def _is_quiet(self, stack: FoundStack, now: float) -> bool:
        # two views of a manifest may have one name, but no picture is in both
        place = stack.files()[0]
        try:
            state = state_of(stack)
        except OSError:
            # a file went away, or another program holds it
            self._seen.pop(place, None)
            return False
        before, since = self._seen.get(place, (None, now))
        if before != state:
            self._seen[place] = (state, now)
            since = now
        return now - since >= self._quiet_s


def wait_until_quiet(stack: FoundStack, quiet_s: float, stop: threading.Event) -> bool:
    """Waits while files of a stack may still be written: while one is younger than ``quiet_s``, or cannot be opened.

    Files that are older are complete at once. The clock of a network drive may differ from that of this computer, so a
    young file is one that changes while it is watched, or changed just now. Returns False after ``stop``, and when a
    file could not be opened for ten times as long.
    """
    began, complete = time.monotonic(), Complete(quiet_s)
    while True:
        try:
            newest = max(on_disk(path).stat().st_mtime for path in stack.files())
            state_of(stack)
            if abs(time.time() - newest) >= quiet_s:
                return True
            can_be_opened = True
        except OSError:
            can_be_opened = False
        if complete.of([stack]):
            return True
        if stop.wait(min(1.0, quiet_s / 4)):
            return False
        if not can_be_opened and time.monotonic() - began > 10 * quiet_s:
            return False


def state_of(stack: FoundStack) -> State:
    """What must not change while a stack is sent. Raises ``OSError`` for a file that cannot be opened."""
    state = []
    for path in stack.files():
        with on_disk(path).open("rb"):
            status = on_disk(path).stat()
        state.append((str(path), status.st_size, status.st_mtime_ns))
    return tuple(state)


def watch(
    make_client: Callable[[], Client],
    journal: Journal,
    root: Path,
    settings: Settings,
    results: Path,
    progress: Progress,
    stop: threading.Event,
    ended: Callable[[List[Outcome]], None],
) -> None:
    """Sends what becomes complete below ``root`` until ``stop``. ``ended`` gets the outcomes of each round.

    A stack that was refused or failed is tried again only after one of its files has changed; one that the service
    could not be reached for is tried again at once.
    """
    complete = Complete(settings.quiet_s)
    settled: Dict[str, State] = {}
    told: Dict[str, str] = {}

    def say_once(name: str, text: str) -> None:
        if told.get(name) != text:
            told[name] = text
            progress.say(text)

    client = interruptible(make_client(), stop)
    while True:
        try:
            found = find(root, ask_of(client, settings), results, settings.gap_s, settings.save)
            told.pop("service", None)
        except Stopped:
            return
        except PinstackError as error:
            # the service is away, or a name or manifest is wrong: the others wait for it too
            say_once("service", f"nothing is sent now: {error.detail}")
            found = Found()
        for path, reason in found.unread:
            # a picture that is still being written is told with its stack
            if not is_picture(path):
                say_once(f"unread {path}", f"{path} {reason}")
        ready = []
        for stack in complete.of(found.stacks):
            if stack.problem is not None:
                # pictures of the other light may still come
                say_once(stack.name, f"{stack.name}: not sent yet: {stack.problem}")
            elif settled.get(stack.name) != _quiet_state(stack):
                ready.append(stack)
        outcomes = send_all(make_client, journal, ready, settings, results, progress, stop)
        for stack, outcome in ((s, o) for s in ready for o in outcomes if o.name == s.name):
            if outcome.state not in ("unreachable", "incomplete"):
                settled[stack.name] = _quiet_state(stack)
        if outcomes:
            try:
                ended(outcomes)
            except OSError as error:
                progress.say(f"the contact sheet cannot be written: {error.strerror or error}")
        if stop.wait(settings.every_s):
            return


def _quiet_state(stack: FoundStack) -> State:
    try:
        return state_of(stack)
    except OSError:
        return ()
