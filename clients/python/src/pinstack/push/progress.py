"""What a person sees while stacks are sent: one line that changes in a terminal, a line per event elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from typing import Callable, Dict, Optional, TextIO, Tuple

from .sender import Outcome


class Progress:
    """Shows how far the stacks are. Every thread may call it."""

    def __init__(self, total: int, out: Optional[TextIO] = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.total = total
        self.ended = 0
        self._out = out if out is not None else sys.stderr
        self._is_terminal = self._out.isatty()
        self._clock = clock
        self._lock = threading.Lock()
        self._steps: Dict[str, Tuple[str, float]] = {}
        self._sizes: Dict[str, int] = {}
        self._began: Dict[str, float] = {}
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
            if before != what:
                self._began[name] = self._clock()
                if not self._is_terminal and what in ("sending", "waiting"):
                    self._print(f"{name}: {what}")
            if self._is_terminal and self._clock() - self._shown > 0.2:
                self._show()

    def end(self, outcome: Outcome) -> None:
        """A stack ended."""
        with self._lock:
            self.ended += 1
            self._steps.pop(outcome.name, None)
            text = "; ".join(outcome.sentences)
            self._print(f"{outcome.name}: {outcome.state}" + (f": {text}" if text else ""))
            if self._is_terminal:
                self._show()

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
        parts = [self._line(name, *step) for name, step in self._steps.items()]
        line = f"{self.ended} of {self.total} · " + " · ".join(parts)
        self._out.write(f"\r\x1b[K{line[:150]}")
        self._out.flush()

    def _line(self, name: str, what: str, share: float) -> str:
        text = f"{name} {what} {100 * share:.0f} %"
        size, spent = self._sizes.get(name), self._clock() - self._began.get(name, self._clock())
        if what == "sending" and size and spent > 1.0 and share > 0.0:
            speed = share * size / spent
            text += f", {speed / 1e6:.1f} MB/s, {duration((1 - share) * size / speed)} left"
        return text


def duration(seconds: float) -> str:
    """``45 s``, ``3 min``, ``2 h 05 min``."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes = round(whole / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
