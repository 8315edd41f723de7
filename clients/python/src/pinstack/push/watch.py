"""Sends stacks as they become complete.

It looks every few seconds, because notices of changes do not cross network drives. A stack is complete when none of its
files has changed for ``quiet_s`` seconds and each can be opened: on Windows, a file that is still being written
cannot.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Callable, Dict, List, Set, Tuple

from .._client import Client
from .folders import StackFolder, find
from .journal import Journal
from .progress import Progress
from .run import send_all
from .sender import Outcome
from .settings import Settings

#: Name, size and time of each file.
State = Tuple[Tuple[str, int, int], ...]


class Complete:
    """Tells which stacks have been quiet for long enough."""

    def __init__(self, quiet_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._quiet_s = quiet_s
        self._clock = clock
        self._seen: Dict[str, Tuple[State, float]] = {}

    def of(self, stacks: List[StackFolder]) -> List[StackFolder]:
        """The stacks that are complete now."""
        now = self._clock()
        return [stack for stack in stacks if self._is_quiet(stack, now)]

    def _is_quiet(self, stack: StackFolder, now: float) -> bool:
        try:
            state = state_of(stack)
        except OSError:
            # a file went away, or another program holds it
            self._seen.pop(str(stack.path), None)
            return False
        before, since = self._seen.get(str(stack.path), (None, now))
        if before != state:
            self._seen[str(stack.path)] = (state, now)
            since = now
        return now - since >= self._quiet_s


def state_of(stack: StackFolder) -> State:
    """What must not change while a stack is sent. Raises ``OSError`` for a file that cannot be opened."""
    state = []
    for path in stack.files():
        with path.open("rb"):
            status = path.stat()
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
    told: Set[str] = set()
    while True:
        ready = []
        for stack in complete.of(find(root, results).stacks):
            if stack.problem is not None:
                # pictures of the other light may still come
                if stack.name not in told:
                    told.add(stack.name)
                    progress.say(f"{stack.name}: not sent yet: {stack.problem}")
                continue
            if settled.get(stack.name) != _quiet_state(stack):
                ready.append(stack)
        outcomes = send_all(make_client, journal, ready, settings, results, progress, stop)
        for stack, outcome in ((s, o) for s in ready for o in outcomes if o.name == s.name):
            if outcome.state not in ("unreachable", "incomplete"):
                settled[stack.name] = _quiet_state(stack)
        if outcomes:
            ended(outcomes)
        if stop.wait(settings.every_s):
            return


def _quiet_state(stack: StackFolder) -> State:
    try:
        return state_of(stack)
    except OSError:
        return ()
