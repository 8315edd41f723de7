"""Sends several stacks at a time."""

from __future__ import annotations

import contextlib
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Callable, List, Optional, Sequence

from .._client import Client
from .folders import Found, StackFolder
from .journal import Journal
from .progress import Progress
from .sender import Outcome, send
from .settings import Settings


class Stopped(Exception):
    """The user ended the run; the next one goes on."""


def send_all(
    make_client: Callable[[], Client],
    journal: Journal,
    stacks: Sequence[StackFolder],
    settings: Settings,
    results: Path,
    progress: Progress,
    stop: Optional[threading.Event] = None,
) -> List[Outcome]:
    """Sends the stacks, at most ``settings.jobs`` at a time, and returns how each ended, in their order.

    A stack that is refused or fails does not stop the others. After ``stop`` no further stack is begun, and what is
    being sent is left as it is: the next run goes on there.
    """
    stop = stop if stop is not None else threading.Event()
    local = threading.local()

    def step(name: str, what: str, share: float) -> None:
        if stop.is_set():
            raise Stopped
        progress.step(name, what, share)

    def one(folder: StackFolder) -> Optional[Outcome]:
        if stop.is_set():
            return None
        client: Optional[Client] = getattr(local, "client", None)
        if client is None:
            client = local.client = make_client()
        if folder.problem is None:
            # a file that cannot be read is told when it is sent
            with contextlib.suppress(OSError):
                progress.expect(folder.name, folder.zip().length)
        try:
            outcome = send(client, journal, folder, settings, results, step)
        except Stopped:
            return None
        progress.end(outcome)
        return outcome

    with ThreadPoolExecutor(max_workers=settings.jobs) as pool:
        futures = [pool.submit(one, folder) for folder in stacks]
        try:
            outcomes = [future.result() for future in futures]
        except KeyboardInterrupt:
            stop.set()
            outcomes = [future.result() for future in futures]
    return [outcome for outcome in outcomes if outcome is not None]


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
