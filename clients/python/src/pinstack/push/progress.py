"""What a person sees while stacks are sent: one line that changes in a terminal, a line per event elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from typing import Callable, Dict, Optional, Set, TextIO, Tuple

from .._errors import PinstackError
from .sender import Outcome


class Progress:
    """Shows how far the stacks are. Every thread may call it."""

    def __init__(self, total: int, out: Optional[TextIO] = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.total = total
        self._ended: Set[str] = set()
        self._out = out if out is not None else sys.stderr
        self._is_terminal = self._out.isatty()
        self._clock = clock
        self._lock = threading.Lock()
        self._steps: Dict[str, Tuple[str, float]] = {}
        self._sizes: Dict[str, int] = {}
        self._began: Dict[str, float] = {}
        #: How each stack that is tried again ended the last time, and the codes for which each waits: said already.
        self._said: Dict[str, str] = {}
        self._waits: Dict[str, Set[str]] = {}
        #: When each that waits is tried again.
        self._until: Dict[str, str] = {}
        self._shown = 0.0

    def expect(self, name: str, size: int) -> None:
        """The bytes that a stack will send, for its speed."""
        with self._lock:
            self._sizes[name] = size

    def step(self, name: str, what: str, share: float) -> None:
        """A stack got further."""
        with self._lock:
            before = self._steps.get(name, ("", 0.0))[0]
            self._steps[name] = (what, share)
            self._until.pop(name, None)
            if before != what:
                self._began[name] = self._clock()
                if not self._is_terminal and what in ("converting", "sending", "waiting") and name not in self._said:
                    self._print(f"{name}: {what}")
            if self._is_terminal and self._clock() - self._shown > 0.2:
                self._show()

    def waits(self, name: str, reason: PinstackError, seconds: float) -> None:
        """Something is tried again after this time. Each reason is said once."""
        with self._lock:
            until = self._until[name] = time_in(seconds)
            if reason.code not in self._waits.setdefault(name, set()):
                self._waits[name].add(reason.code)
                self._print(f"{name}: {reason.detail}; it is tried again at {until}")
            if self._is_terminal:
                self._show()

    def end(self, outcome: Outcome, next_step: str = "") -> None:
        """A stack ended. What was said of it the last time is not said again; ``next_step`` is what comes then."""
        with self._lock:
            self._ended.add(outcome.name)
            self._steps.pop(outcome.name, None)
            self._until.pop(outcome.name, None)
            text = "; ".join(outcome.sentences)
            if outcome.is_good or self._said.get(outcome.name) != text:
                shown = "; ".join(one for one in (text, next_step) if one)
                self._print(f"{outcome.name}: {outcome.state}" + (f": {shown}" if shown else ""))
            if outcome.is_good:
                self._renew(outcome.name)
            else:
                self._said[outcome.name] = text
            if self._is_terminal:
                self._show()

    def renew(self, name: str) -> None:
        """A stack has changed, or something works again: what happens to it is said anew."""
        with self._lock:
            self._renew(name)

    def _renew(self, name: str) -> None:
        self._said.pop(name, None)
        self._waits.pop(name, None)
        self._until.pop(name, None)

    def say(self, text: str) -> None:
        """A line of its own."""
        with self._lock:
            self._print(text)

    def _print(self, text: str) -> None:
        if self._is_terminal:
            self._out.write("\r\x1b[K")
        self._out.write(f"{text}\n")
        self._out.flush()

    def _show(self) -> None:
        self._shown = self._clock()
        parts = [self._line(name, *step) for name, step in self._steps.items() if name not in self._until]
        parts += [f"{name} tries again at {until}" for name, until in self._until.items()]
        line = f"{len(self._ended)} of {self.total} · " + " · ".join(parts)
        self._out.write(f"\r\x1b[K{line[:150]}")
        self._out.flush()

    def _line(self, name: str, what: str, share: float) -> str:
        text = f"{name} {what} {100 * share:.0f} %"
        size, spent = self._sizes.get(name), self._clock() - self._began.get(name, self._clock())
        if what == "sending" and size and spent > 1.0 and share > 0.0:
            speed = share * size / spent
            text += f", {speed / 1e6:.1f} MB/s, {duration((1 - share) * size / speed)} left"
        return text


def time_in(seconds: float) -> str:
    """The time of day after these seconds."""
    return time.strftime("%H:%M:%S", time.localtime(time.time() + seconds))


def duration(seconds: float) -> str:
    """``45 s``, ``3 min``, ``2 h 05 min``."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes = round(whole / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
