"""The commands ``pinstack push`` and ``pinstack watch``."""

from __future__ import annotations

import argparse
import functools
import io
import json
import logging
import logging.handlers
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence

from .._client import Client
from .._errors import PinstackError
from .._http import TEMPORARY, Retry
from .._paths import on_disk
from .._version import VERSION
from . import sheet
from .folders import Found, FoundStack, find, refuse_same_names
from .journal import Journal
from .progress import Progress
from .run import Stopped, ask_of, interruptible, send_all, table
from .sender import Outcome
from .settings import Settings, load, option
from .watch import wait_until_quiet, watch

#: Exit codes.
DONE, SOME_FAILED, USAGE, UNREACHABLE, INTERRUPTED = 0, 1, 2, 3, 130

EPILOG = """exit codes: 0 everything is done; 1 some stacks were refused, failed or are incomplete, or a folder cannot
be read; 2 wrong usage; 3 the service cannot be reached or is busy; 130 interrupted. A run that ended early continues
when the command is given again. With several folders, results and journal are in the first one: give them in the same
order again."""

EPILOG_OF_WATCH = """exit codes: 0 it was stopped; 2 wrong usage. When the service cannot be reached, it tries again."""


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Runs a command and returns its exit code."""
    _print_any_name()
    try:
        given = vars(_parser().parse_args(arguments))
        command = given.pop("command")
        folders = [Path(folder) for folder in given.pop("folders")]
        for folder in folders:
            if not on_disk(folder).is_dir():
                raise PinstackError("invalid_source", f"{folder} is not a folder")
        for table in ("options", "names"):
            given[table] = {name: value for text in given[table] for name, value in option(text).items()}
        settings = load(given.pop("config"), given, os.environ)
        if given.get("json") and not given.get("dry_run"):
            raise PinstackError("invalid_source", "--json shows what --dry-run finds; give both, or neither")
        if given.get("dry_run"):
            return _dry_run(folders, settings, as_json=bool(given.get("json")))
        return _push(folders, settings) if command == "push" else _watch(folders[0], settings, given.get("log"))
    except PinstackError as error:
        print(f"pinstack: {error.detail}", file=sys.stderr)
        return UNREACHABLE if error.code == "unreachable" or error.status in TEMPORARY else USAGE


def _print_any_name() -> None:
    """What a stream cannot show, such as a file name that is not valid text, is printed as an escape sequence."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="pinstack", description="Send focus stacks to a pinstack service.")
    parser.add_argument("--version", action="version", version=f"pinstack {VERSION}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    push = commands.add_parser("push", help="send all stacks in folders", epilog=EPILOG)
    push.add_argument("folders", nargs="+", metavar="DIR")
    push.add_argument("--dry-run", action="store_true", help="only show which files are which stack; sends names alone")
    push.add_argument("--json", action="store_true", help="with --dry-run: show that as JSON")
    watching = commands.add_parser(
        "watch", help="send stacks as they become complete, until stopped", epilog=EPILOG_OF_WATCH
    )
    watching.add_argument("folders", nargs=1, metavar="DIR")
    watching.add_argument("--every-s", type=float, help="seconds between two looks")
    watching.add_argument("--log", type=Path, help="also write to this file; it is rotated at 5 MB")
    for command in (push, watching):
        command.add_argument("--quiet-s", type=float, help="seconds without a change after which a stack is complete")
        command.add_argument("--gap-s", type=float, help="a pause of that many seconds between pictures begins a stack")
        command.add_argument("-n", "--name-rule", dest="names", action="append", default=[], metavar="NAME=VALUE",
                             help="what numbers in names mean, such as x_degrees_per_unit=0.225")  # fmt: skip
        command.add_argument("--config", type=Path, help="file of the rig (TOML)")
        command.add_argument("--server", help="URL of the service (default: PINSTACK_URL, http://127.0.0.1:8080)")
        command.add_argument("--token-file", type=Path, help="file with the access token (default: PINSTACK_TOKEN)")
        command.add_argument("--rig")
        command.add_argument("--lens")
        command.add_argument("--scan", help="the stacks are views of this scan; pan and tilt come from folder names")
        command.add_argument("--results", type=Path, help="folder of the results (default: DIR/results)")
        command.add_argument("--journal", type=Path, help="what was sent (default: DIR/.pinstack-journal)")
        command.add_argument("--save", nargs="*", metavar="ARTIFACT", help="results to save (default: image mask)")
        command.add_argument("--jobs", type=int, help="stacks at a time (default: 2)")
        command.add_argument("-o", "--option", dest="options", action="append", default=[], metavar="NAME=VALUE",
                             help="an option of the stacks, such as method=pyramid")  # fmt: skip
    return parser


def _dry_run(folders: List[Path], settings: Settings, as_json: bool) -> int:
    with _client(settings) as client:
        found = _found(folders, client, settings)
    if as_json:
        stacks = [
            {"name": one.name, "front": [str(path) for path in one.front], "back": [str(path) for path in one.back],
             **one.angles, "problem": one.problem}
            for one in found.stacks
        ]  # fmt: skip
        ignored = [{"file": str(path), "reason": reason} for path, reason in found.ignored]
        print(json.dumps({"stacks": stacks, "ignored": ignored}, indent=2))
    else:
        print(table(found))
    is_good = found.stacks and not found.unread and not any(one.problem for one in found.stacks)
    return DONE if is_good else SOME_FAILED


def _found(folders: List[Path], client: Client, settings: Settings) -> Found:
    found = Found()
    for folder in folders:
        results, _ = _places(folder, settings)
        one = find(folder, ask_of(client, settings), results, settings.gap_s, settings.save)
        found.stacks.extend(one.stacks)
        found.ignored.extend(one.ignored)
        found.unread.extend(one.unread)
    refuse_same_names(found, settings.save)
    return found


def _client(settings: Settings) -> Client:
    return Client(settings.server, settings.token or "", retry=Retry())


def _places(folder: Path, settings: Settings) -> tuple[Path, Path]:
    return settings.results or folder / "results", settings.journal or folder / ".pinstack-journal"


def _push(folders: List[Path], settings: Settings) -> int:
    stop = _stop_by_signals()
    try:
        with interruptible(_client(settings), stop) as client:
            found = _found(folders, client, settings)
            if found.stacks:
                client.get_profile(settings.rig, settings.lens)
    except Stopped:
        return INTERRUPTED
    if not found.stacks:
        print(table(found), file=sys.stderr)
        raise PinstackError("invalid_source", "there is no stack in these folders; --dry-run shows what was seen")
    results, at = _places(folders[0], settings)
    journal = Journal(at)
    progress = Progress(len(found.stacks))

    def is_complete(stack: FoundStack) -> bool:
        return wait_until_quiet(stack, settings.quiet_s, stop)

    make = functools.partial(_client, settings)
    try:
        outcomes = send_all(make, journal, found.stacks, settings, results, progress, stop, is_complete)
    finally:
        journal.close()
    for path, reason in found.unread:
        progress.say(f"{path} {reason}")
    good = sum(outcome.is_good for outcome in outcomes)
    said = f"{good} of {len(found.stacks)} stacks are done"
    try:
        progress.say(f"{said}; see {sheet.write(outcomes, results)}")
    except OSError as error:
        progress.say(f"{said}; the contact sheet cannot be written: {error.strerror or error}")
    if stop.is_set():
        return INTERRUPTED
    if any(outcome.state == "unreachable" for outcome in outcomes):
        return UNREACHABLE
    return DONE if good == len(found.stacks) and not found.unread else SOME_FAILED


def _stop_by_signals() -> threading.Event:
    """Is set by Ctrl-C and by SIGTERM; what is being sent is left as it is. A second signal ends the process."""
    stop = threading.Event()

    def end(number: int, _: object) -> None:
        stop.set()
        signal.signal(number, signal.SIG_DFL)

    # tests call this in other threads, which get no signals
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, end)
    return stop


def _watch(folder: Path, settings: Settings, log: Optional[Path]) -> int:
    results, at = _places(folder, settings)
    stop = _stop_by_signals()
    progress = _Logged(log) if log is not None else Progress(0)
    journal = Journal(at)
    every: Dict[str, Outcome] = {}

    def ended(outcomes: List[Outcome]) -> None:
        every.update({outcome.name: outcome for outcome in outcomes})
        sheet.write(list(every.values()), results)

    progress.say(f"watching {folder}; results are saved in {results}")
    try:
        make = functools.partial(_client, settings)
        watch(make, journal, folder, settings, results, progress, stop, ended)
    finally:
        journal.close()
    progress.say("stopped")
    return DONE


class _Logged(Progress):
    """Writes what happens to a file that is rotated, with the time, and to the terminal."""

    def __init__(self, log: Path) -> None:
        super().__init__(0)
        try:
            handler = logging.handlers.RotatingFileHandler(
                on_disk(log), maxBytes=5_000_000, backupCount=5, encoding="utf-8", errors="backslashreplace"
            )
        except OSError as error:
            detail = f"the log {log} cannot be written: {error.strerror or error}; choose another --log"
            raise PinstackError("invalid_source", detail) from error
        handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        self._log = logging.Logger("pinstack")
        self._log.addHandler(handler)

    def _print(self, text: str) -> None:
        super()._print(text)
        self._log.info(text)


def run() -> Any:
    """The entry point of the command."""
    sys.exit(main())
