"""Sends several stacks at a time."""

from __future__ import annotations

import contextlib
import functools
import threading
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from pathlib import Path
from typing import Any, Callable, List, Mapping, Optional, Sequence, cast

from .._client import Client
from .._errors import PinstackError
from .causes import Site
from .folders import Ask, Found, FoundStack
from .journal import Journal
from .progress import Progress
from .sender import Outcome, Sender
from .settings import Settings
from .spool import Spool


class Stopped(Exception):
    """The user ended the run; the next one continues."""


def send_all(
    make_client: Callable[[], Client],
    journal: Journal,
    stacks: Sequence[FoundStack],
    settings: Settings,
    results: Path,
    progress: Progress,
    site: Site,
    stop: Optional[threading.Event] = None,
    ended: Optional[Callable[[FoundStack, Outcome], None]] = None,
) -> List[Outcome]:
    """Sends the stacks, at most ``settings.jobs`` at a time, and returns how each ended, in their order.

    A stack that is refused or fails does not stop the others. After ``stop`` no further stack is begun, and what is
    being sent is left as it is: the next run continues it. ``ended`` is told how each ended, at once.
    """
    stop = stop if stop is not None else threading.Event()
    local = threading.local()
    spool = Spool(journal, settings)

    def step(name: str, what: str, share: float) -> None:
        if stop.is_set():
            raise Stopped
        progress.step(name, what, share)

    def one(stack: FoundStack) -> Optional[Outcome]:
        if stop.is_set():
            return None
        client: Optional[Client] = getattr(local, "client", None)
        if client is None:
            client = local.client = make_client()
        interruptible(client, stop, progress, stack.name)
        try:
            if stack.problem is None:
                # a file that cannot be read is told when it is sent
                with contextlib.suppress(OSError, PinstackError):
                    progress.expect(stack.name, stack.zip().length)
            outcome = Sender(client, journal, settings, results, step, site, spool, progress.expect).send(stack)
        except Stopped:
            return None
        if ended is not None:
            ended(stack, outcome)
        else:
            progress.end(outcome)
        return outcome

    with ThreadPoolExecutor(max_workers=settings.jobs) as pool:
        futures = [pool.submit(one, stack) for stack in stacks]
        # on Windows, a wait without a limit cannot be interrupted
        while wait_for(futures, timeout=0.5).not_done:
            pass
        outcomes = [future.result() for future in futures]
    return [outcome for outcome in outcomes if outcome is not None]


def interruptible(client: Client, stop: threading.Event, progress: Progress, name: str = "the service") -> Client:
    """The client, whose waits between two tries are said, for ``name``, and end with :class:`Stopped` at once."""

    def sleep(seconds: float) -> None:
        if stop.wait(seconds):
            raise Stopped

    client._transport.sleep = sleep
    client._transport.on_wait = functools.partial(progress.waits, name)
    return client


def ask_of(client: Client, settings: Settings) -> Ask:
    """Groups names by the rules of the service. The same names are not asked twice in a row."""
    last: List[Any] = [None, None]

    def ask(names: Sequence[str], manifest: Optional[Mapping[str, Any]]) -> Mapping[str, Any]:
        if last[0] != (names, manifest):
            answer = client.group_names(names, manifest, **settings.names)
            last[:] = [(names, manifest), answer]
        return cast(Mapping[str, Any], last[1])

    return ask


def table(found: Found) -> str:
    """The grouping, for people."""
    lines = [f"{len(found.stacks)} stacks"]
    for stack in found.stacks:
        angles = ", ".join(f"{name[:-4]} {value:g}" for name, value in stack.angles.items())
        line = f"  {stack.name}: {len(stack.front)} front, {len(stack.back)} back" + (f", {angles}" if angles else "")
        lines.append(line + (f"  ! {stack.problem}" if stack.problem else ""))
    if found.ignored:
        lines.append(f"{len(found.ignored)} files are in no stack")
        lines.extend(f"  {path}: {reason}" for path, reason in found.ignored[:20])
        if len(found.ignored) > 20:
            lines.append(f"  ... and {len(found.ignored) - 20} more")
    return "\n".join(lines)
