"""Converts the raw files of a stack, several at once within a limit of memory.

In: a zip of raw files that was not made yet, and where the pictures go. Out: the pictures; each appears when it is
complete.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import FIRST_EXCEPTION, CancelledError, ThreadPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Callable, Iterator, Mapping

from .._paths import on_disk
from .._zips import StoredZip
from .raws import BYTES_BESIDE, RawOptions, Recipe, convert, recipe_of

#: Called with the number of files that are converted; it may raise to end the conversion.
OnFile = Callable[[int], None]


class Memory:
    """Memory that conversions share, in bytes. One that needs more than all of it runs alone."""

    def __init__(self, most: int) -> None:
        self._most, self._used = most, 0
        self._freed = threading.Condition()

    @contextmanager
    def taken(self, size: int, check: Callable[[], None]) -> Iterator[None]:
        """Waits until there is so much. ``check`` is called meanwhile; it may raise to end the waiting."""
        with self._freed:
            while self._used > 0 and self._used + size > self._most:
                self._freed.wait(0.5)
                check()
            self._used += size
        try:
            yield
        finally:
            with self._freed:
                self._used -= size
                self._freed.notify_all()


class Converter:
    """Converts files of several stacks. LibRaw and zlib run beside the lock of Python, so threads are enough."""

    def __init__(self, memory_gb: float, options: RawOptions) -> None:
        self.options = options
        self._memory = Memory(int(memory_gb * 1e9))

    def recipe(self, source: StoredZip, reference: int, check: Callable[[], None]) -> Recipe:
        """The recipe of a stack of which this member is the reference slice."""
        member = source.members[reference]
        # LibRaw unpacks the sensor alone
        with self._memory.taken(4 * member.size + BYTES_BESIDE, check):
            return recipe_of(member.path, source.member_bytes(reference), self.options)

    def convert(self, source: StoredZip, recipe: Recipe, targets: Mapping[int, Path], on_file: OnFile) -> None:
        """Writes a picture for each member in ``targets``. The first that fails ends all of them."""
        done, is_ended = 0, threading.Event()

        def check() -> None:
            if is_ended.is_set():
                raise CancelledError
            on_file(done)

        def one(index: int, to: Path) -> None:
            member = source.members[index]
            part = on_disk(to.with_name(f"{to.name}.part"))
            try:
                with self._memory.taken(recipe.memory(member.size), check), part.open("wb") as file:
                    convert(member.path, source.member_bytes(index), recipe, file, check)
                part.replace(on_disk(to))
            except BaseException:
                with suppress(OSError):
                    part.unlink()
                raise

        with ThreadPoolExecutor(max_workers=min(os.cpu_count() or 1, 16)) as pool:
            futures = [pool.submit(one, index, to) for index, to in targets.items()]
            try:
                waiting = True
                while waiting:
                    # on Windows, a wait without a limit cannot be interrupted
                    ended, rest = wait_for(futures, timeout=0.5, return_when=FIRST_EXCEPTION)
                    for future in ended:
                        future.result()
                    done, waiting = len(ended), bool(rest)
                    check()
            finally:
                is_ended.set()
                for future in futures:
                    future.cancel()
