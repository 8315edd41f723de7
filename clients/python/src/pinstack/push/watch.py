"""Looks at folders again and again, and sends each stack when it is complete: ``push`` until each has an outcome,
``watch`` until it is stopped.

It looks every few seconds, because notices of changes do not cross network drives. A stack is complete when none of its
files has changed, and none has come, for ``quiet_s`` seconds while this program looked, and each can be opened: on
Windows, a file that is still being written cannot. The times of files do not say it: a share has another clock, and
programs that copy set the times of the originals.

What sends a stack again is in :mod:`.causes`. ``watch`` does so by itself, with pauses that double; ``push`` sends each
stack once.
"""

from __future__ import annotations

import contextlib
import functools
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Callable, Dict, List, Optional, Tuple

from .._client import Client
from .._errors import PinstackError
from .._paths import on_disk
from .._zips import is_picture
from .causes import Again, Site, site_of
from .folders import Found, FoundStack
from .journal import Journal
from .progress import Progress, time_in
from .raws import is_raw
from .run import Stopped, interruptible, send_all
from .sender import Outcome, key
from .settings import Settings

#: Name, size and time of each file.
State = Tuple[Tuple[str, int, int], ...]

#: The first pause before a stack is sent again, after a person ended it at the service, and the longest, seconds.
FIRST_PAUSE_S, PAUSE_OF_ENDED_S, LONGEST_PAUSE_S = 4.0, 30.0, 900.0

#: Said of a stack of which a file stays held.
HELD = "a file cannot be opened: is it still being written?"

#: Looks at the folders.
Look = Callable[[], Found]


class Complete:
    """Tells which stacks have been quiet for long enough."""

    def __init__(self, quiet_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._quiet_s = quiet_s
        self._clock = clock
        self._seen: Dict[Path, Tuple[State, float]] = {}
        self._held: Dict[Path, float] = {}

    def of(self, stacks: List[FoundStack]) -> List[FoundStack]:
        """The stacks that are complete now."""
        now = self._clock()
        return [stack for stack in stacks if self._is_quiet(stack, now)]

    def is_held(self, stack: FoundStack) -> bool:
        """Whether a file could not be opened for ten times as long."""
        return self._clock() - self._held.get(place_of(stack), self._clock()) > 10 * self._quiet_s

    def _is_quiet(self, stack: FoundStack, now: float) -> bool:
        place = place_of(stack)
        try:
            state = state_of(stack)
        except OSError:
            # a file went away, or another program holds it
            self._seen.pop(place, None)
            self._held.setdefault(place, now)
            return False
        self._held.pop(place, None)
        before, since = self._seen.get(place, (None, now))
        if before != state:
            self._seen[place] = (state, now)
            since = now
        return now - since >= self._quiet_s


def place_of(stack: FoundStack) -> Path:
    """Two views of a manifest may have one name, but no picture is in both."""
    return stack.files()[0]


def state_of(stack: FoundStack) -> State:
    """What must not change while a stack is sent. Raises ``OSError`` for a file that cannot be opened."""
    state = []
    for path in stack.files():
        with on_disk(path).open("rb"):
            status = on_disk(path).stat()
        state.append((str(path), status.st_size, status.st_mtime_ns))
    return tuple(state)


@dataclass
class Try:
    """The last time that a stack was sent."""

    #: Its files before.
    state: State
    outcome: Outcome
    #: What the service was like.
    site: Site
    #: Failures with these files, and the time of the next try.
    failures: int = 0
    next_at: float = 0.0


class Rounds:
    """What ``push`` and ``watch`` share: looks, and sends what is complete."""

    def __init__(
        self,
        make_client: Callable[[], Client],
        journal: Journal,
        look: Callable[[Client], Look],
        settings: Settings,
        results: Path,
        progress: Progress,
        stop: threading.Event,
        repeats: bool,
    ) -> None:
        """``repeats``: stacks are sent again, and those without a part that may still come wait for it."""
        self.client = interruptible(make_client(), stop, progress)
        self._look = look(self.client)
        self._journal = journal
        self._send = functools.partial(send_all, make_client, journal)
        self._settings, self._results, self._progress, self._stop = settings, results, progress, stop
        self._repeats = repeats
        self._complete = Complete(settings.quiet_s)
        self._has_back_light = False
        self._told: Dict[str, str] = {}
        #: By place.
        self.tries: Dict[Path, Try] = {}
        #: What the last look found, and what the service was like then.
        self.found, self.site = Found(), Site("", "")

    def say_once(self, about: str, text: str) -> None:
        """Says something, unless it was the last thing that was said about this."""
        if self._told.get(about) != text:
            self._told[about] = text
            self._progress.say(text)

    def look(self) -> None:
        """Looks at the folders. Raises what the service says."""
        self.found = self._look()
        self._progress.total = len(self.found.stacks)
        for note in self.found.notes:
            self.say_once(note, note)
        self._has_back_light |= any(stack.front and stack.back for stack in self.found.stacks)

    def works(self) -> None:
        """The service answers: the next time that it does not is said again."""
        self._told.pop("service", None)
        self._progress.renew("the service")

    def known(self) -> List[FoundStack]:
        """The stacks that an earlier run has sent whole: they need not be quiet."""
        self.site = site_of(self.client, self._settings)
        known = []
        for stack in self.found.stacks:
            # a file that cannot be read is told later
            with contextlib.suppress(OSError, PinstackError):
                at = key(stack, self._settings, self.site).value
                if stack.problem is None and self._journal.entry(at).job is not None:
                    known.append(stack)
        return known

    def ready(self) -> List[FoundStack]:
        """The stacks that are complete."""
        for stack in self.found.stacks:
            if self._repeats and self._complete.is_held(stack):
                self.say_once(stack.name, f"{stack.name}: not sent yet: {HELD}")
        return [stack for stack in self._complete.of(self.found.stacks) if not self._waits(stack)]

    def send(self, ready: List[FoundStack]) -> List[Outcome]:
        """Sends those that are due; returns how they ended. Raises what the service says."""
        now = {place_of(stack): _state_or_nothing(stack) for stack in ready}
        if not any(self._may_be_due(stack, now[place_of(stack)]) for stack in ready):
            return []
        self.site = site = site_of(self.client, self._settings)
        due = [stack for stack in ready if self._is_due(stack, now[place_of(stack)], site)]
        for stack in due:
            before = self.tries.get(place_of(stack))
            if before is not None and before.state != now[place_of(stack)]:
                self._progress.renew(stack.name)

        def ended(stack: FoundStack, outcome: Outcome) -> None:
            self._end(stack, now[place_of(stack)], outcome, site)

        return self._send(due, self._settings, self._results, self._progress, site, self._stop, ended)

    def is_over(self) -> bool:
        """Whether each stack has an outcome, or cannot be opened for long."""
        for stack in self.found.stacks:
            done = self.tries.get(place_of(stack))
            if done is not None and done.state == _state_or_nothing(stack):
                continue
            if not self._complete.is_held(stack):
                self.say_once("quiet", f"waits until no file has changed for {self._settings.quiet_s:g} s")
                return False
            outcome = Outcome(stack.name, "incomplete", [HELD], again=Again.LATER)
            self._end(stack, (), outcome, self.site)
        return True

    def _waits(self, stack: FoundStack) -> bool:
        """Whether a part of a stack may still come. Who gives ``push`` has all of it."""
        others_have_one = self._has_back_light and self._repeats
        if stack.problem is None and not stack.back and self._settings.waits_for_back_light(others_have_one):
            stack.problem = "it has no back light; if it needs none, give --back-light never"
        if stack.problem is None or not self._repeats:
            return False
        self.say_once(stack.name, f"{stack.name}: not sent yet: {stack.problem}")
        return True

    def _may_be_due(self, stack: FoundStack, state: State) -> bool:
        last = self.tries.get(place_of(stack))
        if last is None or last.state != state:
            return True
        if not self._repeats or last.outcome.again in (None, Again.CHANGE):
            return False
        return time.monotonic() >= last.next_at

    def _is_due(self, stack: FoundStack, state: State, site: Site) -> bool:
        last = self.tries.get(place_of(stack))
        is_refused = last is not None and last.state == state and last.outcome.again is Again.PROFILE
        return self._may_be_due(stack, state) and not (is_refused and last is not None and last.site == site)

    def _end(self, stack: FoundStack, state: State, outcome: Outcome, site: Site) -> None:
        """Remembers how a stack ended, and says it."""
        before = self.tries.get(place_of(stack))
        made = Try(state, outcome, site)
        until: Optional[str] = None
        if before is not None and before.state == state:
            made.failures = before.failures
        if outcome.again is Again.LATER:
            made.failures += 1
            first_s = PAUSE_OF_ENDED_S if outcome.was_ended else FIRST_PAUSE_S
            pause_s = min(first_s * 2 ** min(made.failures - 1, 20), LONGEST_PAUSE_S)
            made.next_at = time.monotonic() + pause_s
            until = time_in(pause_s) if self._repeats else None
        self.tries[place_of(stack)] = made
        # a problem of the grouping says itself what to change
        is_told = outcome.again is not None and stack.problem is None
        self._progress.end(outcome, next_step(outcome, self._settings, until) if is_told else "")


def push(rounds: Rounds, settings: Settings, stop: threading.Event) -> List[Outcome]:
    """Sends each stack once, when it is complete, and returns how each ended. The folders were looked at once."""
    pause_s = min(settings.every_s, max(settings.quiet_s / 4, 0.05))
    rounds.send(rounds.known())
    while True:
        rounds.send(rounds.ready())
        if stop.is_set() or rounds.is_over() or stop.wait(pause_s):
            break
        rounds.look()
    done = (rounds.tries.get(place_of(stack)) for stack in rounds.found.stacks)
    return [one.outcome for one in done if one is not None]


def watch(rounds: Rounds, settings: Settings, stop: threading.Event, ended: Callable[[List[Outcome]], None]) -> None:
    """Sends what becomes complete until ``stop``. ``ended`` gets the outcomes of each round."""
    while True:
        try:
            rounds.look()
            outcomes = rounds.send(rounds.ready())
            rounds.works()
            if outcomes:
                ended(outcomes)
        except Stopped:
            return
        except PinstackError as error:
            # the service is away, or a name or manifest is wrong: the others wait for it too
            rounds.say_once("service", f"nothing is sent now: {error.detail}; it is tried again every few seconds")
        for path, reason in rounds.found.unread:
            # a picture that is still being written is told with its stack
            if not (is_picture(path) or is_raw(path)):
                rounds.say_once(f"unread {path}", f"{path} {reason}")
        if stop.wait(settings.every_s):
            return


def _state_or_nothing(stack: FoundStack) -> State:
    try:
        return state_of(stack)
    except OSError:
        return ()


def next_step(outcome: Outcome, settings: Settings, until: Optional[str]) -> str:
    """What a person should know about the next try; ``until`` is its time, if this run makes one."""
    if outcome.again is Again.LATER:
        return f"it is sent again at {until}" if until else "give the same command again to send it"
    if outcome.again is Again.PROFILE:
        what = f"the profile of rig '{settings.rig}' and lens '{settings.lens}' has a new revision"
        return f"it is sent again when {what}, or the limits of the service are others"
    return f"it is sent again when a file or an option changes, or with --again '{outcome.name}'"
