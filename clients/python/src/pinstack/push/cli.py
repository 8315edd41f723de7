"""The commands ``pinstack push``, ``pinstack watch`` and ``pinstack convert``."""

from __future__ import annotations

import argparse
import contextlib
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
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence

import httpx

from .._client import Client
from .._errors import PinstackError
from .._http import Retry
from .._paths import on_disk
from .._version import VERSION
from . import sheet
from .causes import Again, again_after
from .convert import add_options, convert
from .folders import Found, find, refuse_same_names
from .gone import gone_views
from .journal import Journal
from .progress import Progress
from .raws import SUFFIXES
from .run import Stopped, ask_of, interruptible, table
from .sender import Outcome
from .settings import BACK_LIGHTS, PREFERENCES, Settings, load, option
from .watch import Look, Rounds, push, watch

#: Exit codes.
DONE, SOME_FAILED, USAGE, UNREACHABLE, INTERRUPTED = 0, 1, 2, 3, 130

EPILOG = """exit codes: 0 everything is done; 1 some stacks were refused, failed or are incomplete, or a folder cannot
be read; 2 wrong usage; 3 the service cannot be reached, is busy, or refuses for a reason that is not in the files and
options, such as a token or a missing profile; 130 interrupted. A run that ended early continues when the command is
given again. With several folders, results and journal are in the first one: give them in the same
order again."""

EPILOG_OF_CONVERT = """exit codes: 0 everything is converted; 1 some stacks are not; 2 wrong usage; 130 interrupted."""

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
        if command == "convert":
            return convert(folders, given, _stop_by_signals())
        for table in ("options", "names"):
            given[table] = {name: value for text in given[table] for name, value in option(text).items()}
        settings = load(given.pop("config"), given, os.environ)
        if given.get("json") and not given.get("dry_run"):
            raise PinstackError("invalid_source", "--json shows what --dry-run finds; give both, or neither")
        if given.get("dry_run"):
            return _dry_run(folders, settings, as_json=bool(given.get("json")))
        again = given.pop("again")
        if command == "push":
            return _push(folders, settings, again)
        return _watch(folders[0], settings, again, given.get("log"))
    except Stopped:
        return INTERRUPTED
    except PinstackError as error:
        print(f"pinstack: {error.detail}", file=sys.stderr)
        return USAGE if again_after(error.code) is Again.CHANGE else UNREACHABLE


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
    converting = commands.add_parser(
        "convert", help="convert camera raw files as push does, into another folder", epilog=EPILOG_OF_CONVERT
    )
    add_options(converting)
    watching = commands.add_parser(
        "watch", help="send stacks as they become complete, until stopped", epilog=EPILOG_OF_WATCH
    )
    watching.add_argument("folders", nargs=1, metavar="DIR")
    watching.add_argument("--every-s", type=float, help="seconds between two looks")
    watching.add_argument("--log", type=Path, help="also write to this file; it is rotated at 5 MB")
    for command in (push, watching):
        command.add_argument("--quiet-s", type=float, help="seconds without a change after which a stack is complete")
        command.add_argument("--gap-s", type=float, help="a pause of that many seconds between pictures begins a stack")
        command.add_argument("--prefer", choices=PREFERENCES, help="which is sent of a raw file and a picture of "
                             "the same name (default: raw, where it can be converted)")  # fmt: skip
        command.add_argument(
            "--raw-format", choices=sorted(SUFFIXES), help="format of converted raw files (default: tiff)"
        )
        command.add_argument("--raw-quality", type=int, help="quality with --raw-format jpeg, 1 to 100 (default: 95)")
        command.add_argument("--raw-exposure", type=float, metavar="STOPS", help="make raw files brighter (default: 0)")
        command.add_argument("--raw-memory-gb", type=float, help="memory that conversions may take (default: 4)")
        command.add_argument("--raw-temp", type=Path, metavar="FOLDER",
                             help="where converted files wait to be sent (default: beside the journal)")  # fmt: skip
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
        command.add_argument("--again", action="append", default=[], metavar="NAME",
                             help="send this stack again, however it ended; repeat it for more")  # fmt: skip
        command.add_argument("--back-light", choices=BACK_LIGHTS, help="whether each stack has one (default auto: "
                             "watch waits for it where another stack of the folder has one)")  # fmt: skip
        command.add_argument("-o", "--option", dest="options", action="append", default=[], metavar="NAME=VALUE",
                             help="an option of the stacks, such as method=pyramid")  # fmt: skip
    return parser


def _dry_run(folders: List[Path], settings: Settings, as_json: bool) -> int:
    with interruptible(_client(settings), _stop_by_signals(), Progress(0)) as client:
        found = _look(folders, settings)(client)()
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


def _look(folders: List[Path], settings: Settings) -> Callable[[Client], Look]:
    """Looks at all folders, with the grouping of a service."""

    def by(client: Client) -> Look:
        asks = [ask_of(client, settings) for _ in folders]

        def look() -> Found:
            found = Found()
            for folder, ask in zip(folders, asks):
                results, _ = _places(folder, settings)
                suffix = settings.raw_options().suffix
                one = find(folder, ask, results, settings.gap_s, settings.save, settings.prefer, suffix)
                found.notes.extend(one.notes)
                found.stacks.extend(one.stacks)
                found.ignored.extend(one.ignored)
                found.unread.extend(one.unread)
            refuse_same_names(found, settings.save)
            return found

        return look

    return by


def _client(settings: Settings) -> Client:
    file = settings.token_file
    if file is None:
        return Client(settings.server, settings.token or "", retry=Retry())

    def with_token(request: httpx.Request) -> httpx.Request:
        request.headers["authorization"] = f"Bearer {file.token()}"
        return request

    return Client(settings.server, "", retry=Retry(), auth=with_token)


def _places(folder: Path, settings: Settings) -> tuple[Path, Path]:
    return settings.results or folder / "results", settings.journal or folder / ".pinstack-journal"


@contextlib.contextmanager
def _rounds(
    folders: List[Path], settings: Settings, again: List[str], progress: Progress, repeats: bool
) -> Iterator[tuple[Rounds, Journal, Path, threading.Event]]:
    """What sends the stacks, with its journal and the folder of the results, until a signal sets the event."""
    stop = _stop_by_signals()
    results, at = _places(folders[0], settings)
    if settings.token_file is not None:
        settings.token_file.on_change = progress.say
    journal = Journal(at)
    try:
        unknown = [name for name in again if not journal.forget_name(name)]
        make, look = functools.partial(_client, settings), _look(folders, settings)
        rounds = Rounds(make, journal, look, settings, results, progress, stop, repeats)
        if unknown:
            # one that was never sent, or failed for a reason that passes, is sent anyway
            rounds.look()
            for name in set(unknown) - {stack.name for stack in rounds.found.stacks}:
                detail = f"there is no stack '{name}'; --again takes a name as push and watch print it"
                raise PinstackError("invalid_source", detail)
        yield rounds, journal, results, stop
    finally:
        journal.close()


def _push(folders: List[Path], settings: Settings, again: List[str]) -> int:
    progress = Progress(0)
    with _rounds(folders, settings, again, progress, repeats=False) as (rounds, journal, results, stop):
        rounds.look()
        if not rounds.found.stacks:
            print(table(rounds.found), file=sys.stderr)
            raise PinstackError("invalid_source", "there is no stack in these folders; --dry-run shows what was seen")
        outcomes = push(rounds, settings, stop)
        found = rounds.found
        for sentence in gone_views(rounds.client, journal, settings, rounds.site, found, only_renamed=False):
            progress.say(sentence)
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
    if any(outcome.again is Again.LATER and outcome.state != "incomplete" for outcome in outcomes):
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


def _watch(folder: Path, settings: Settings, again: List[str], log: Optional[Path]) -> int:
    progress = _Logged(log) if log is not None else Progress(0)
    every: Dict[str, Outcome] = {}
    with _rounds([folder], settings, again, progress, repeats=True) as (rounds, journal, results, stop):

        def ended(outcomes: List[Outcome]) -> None:
            every.update({outcome.name: outcome for outcome in outcomes})
            try:
                sheet.write(list(every.values()), results)
            except OSError as error:
                progress.say(f"the contact sheet cannot be written: {error.strerror or error}")
            for sentence in gone_views(rounds.client, journal, settings, rounds.site, rounds.found, only_renamed=True):
                rounds.say_once(sentence, sentence)

        progress.say(f"watching {folder}; results are saved in {results}")
        watch(rounds, settings, stop, ended)
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
