"""When ``push`` and ``watch`` send a stack, and when again, with a service in memory and a clock that tests move."""

from __future__ import annotations

import io
import os
import re
import shutil
import threading
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

import httpx
import pytest
from fake import problem
from test_push import make
from test_push_cli import RIG, Service, client

from pinstack import Client, PinstackError
from pinstack.push import cli, settings
from pinstack.push import watch as module
from pinstack.push.journal import Journal
from pinstack.push.progress import Progress
from pinstack.push.sender import Outcome
from pinstack.push.watch import Rounds, watch


class Bench:
    """Rounds over a folder."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, repeats: bool, **chosen: Any) -> None:
        self.root = tmp_path / "shots"
        self.root.mkdir()
        self.service = Service()
        self.chosen = settings.Settings(server="http://rig", rig="r", lens="l", **{"quiet_s": 20.0, **chosen})
        self.out = io.StringIO()
        self.stop = threading.Event()
        self.journal = Journal(tmp_path / "journal")
        self.now = 1000.0
        self.rounds = Rounds(
            lambda: client(self.service),
            self.journal,
            cli._look([self.root], self.chosen),
            self.chosen,
            self.root / "results",
            Progress(1, self.out),
            self.stop,
            repeats,
        )
        self.rounds._complete._clock = lambda: self.now
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)

    def look(self, after_s: float = 0.0) -> List[Outcome]:
        """What one look, after this time, sends."""
        self.now += after_s
        self.rounds.look()
        return self.rounds.send(self.rounds.ready())

    def states(self, after_s: float = 0.0) -> List[str]:
        return [outcome.state for outcome in self.look(after_s)]

    @property
    def lines(self) -> List[str]:
        return self.out.getvalue().splitlines()


Make = Callable[..., Bench]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    def made(repeats: bool = True, **chosen: Any) -> Bench:
        return Bench(tmp_path, monkeypatch, repeats, **chosen)

    return made


@pytest.mark.parametrize("age_s", [0.0, 3600.0, -3600.0, 86400.0])
def test_a_stack_is_sent_when_nothing_changes_while_it_is_watched(bench: Make, age_s: float) -> None:
    on = bench(repeats=False)

    def write(name: str, data: bytes) -> None:
        (on.root / "v").mkdir(exist_ok=True)
        (on.root / "v" / name).write_bytes(data)
        # as the clock of a share, or a program that copies, sets it
        os.utime(on.root / "v" / name, (1e9 - age_s, 1e9 - age_s))

    for name in ("1.jpg", "2.jpg", "3.jpg"):
        write(name, name.encode())
    assert on.states() == []
    write("3.jpg", b"it grows")
    assert on.states(19.0) == [] and on.states(19.0) == []
    # a slice that comes while it waits counts too
    write("4.jpg", b"4")
    assert on.states(2.0) == [] and not on.rounds.is_over()
    assert on.states(20.0) == ["done"] and on.rounds.is_over()
    (stack,) = on.rounds.found.stacks
    assert len(stack.files()) == 4 and on.service.made == 1
    assert on.lines[0] == "waits until no file has changed for 20 s"


def test_a_stack_that_changes_after_it_was_sent_is_not_done(bench: Make) -> None:
    on = bench(repeats=False)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.look()
    assert on.states(20.0) == ["done"]
    make(on.root, "v/3.jpg")
    assert on.states() == [] and not on.rounds.is_over()
    assert on.states(20.0) == ["done"] and on.rounds.is_over() and on.service.made == 2


def test_a_file_that_stays_held_ends_push_and_not_watch(bench: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    on = bench(repeats=False)
    make(on.root, "v/1.jpg", "v/2.jpg")
    opened = Path.open

    def held(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == "2.jpg":
            raise PermissionError(13, "The process cannot access the file", str(path))
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", held)
    assert on.states() == [] and not on.rounds.is_over()
    assert on.states(200.0) == [] and not on.rounds.is_over()
    assert on.states(1.0) == [] and on.rounds.is_over()
    (only,) = on.rounds.tries.values()
    assert only.outcome.state == "incomplete" and "still being written" in on.lines[-1]


REFUSED = [
    problem(507, "insufficient_storage", "the disk is full"),
    problem(500, "internal", "an internal error"),
    problem(401, "unauthorized", "the token is not valid"),
    problem(403, "forbidden", "the token may only read"),
    problem(404, "scan_not_found", "there is no scan s"),
    problem(422, "scan_mismatch", "the scan is of another lens"),
    httpx.Response(403, text="<html>a proxy</html>"),
    httpx.Response(404, text="<html>a proxy</html>"),
    httpx.Response(413, text="<html>a proxy</html>"),
]


@pytest.mark.parametrize("answer", REFUSED)
def test_watch_sends_again_what_was_refused_for_another_reason(bench: Make, answer: httpx.Response) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.fault_of_upload = answer
    assert on.states() == ["refused"]
    assert re.search(r"^v: refused: .*; it is sent again at \d\d:\d\d:\d\d$", on.lines[-1])
    said = len(on.lines)
    assert on.states(3.9) == [], "not at once"
    assert on.states(0.2) == ["refused"] and len(on.lines) == said, "it is said once"
    assert on.states(7.9) == [] and on.states(0.2) == ["refused"], "pauses double"
    for _ in range(20):
        on.look(10_000.0)
    on.service.fault_of_upload = None
    assert on.states(899.0) == [] and on.states(1.1) == ["done"], "and end at a quarter of an hour"
    assert on.lines[-1] == "v: done" and len(on.lines) == said + 1
    assert on.states(10_000.0) == []


def test_a_change_of_a_file_begins_anew_and_is_said(bench: Make) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.fault_of_upload = problem(507, "insufficient_storage", "the disk is full")
    on.look()
    on.look(5.0)
    said = len(on.lines)
    make(on.root, "v/3.jpg")
    assert on.states() == ["refused"] and len(on.lines) == said + 2
    assert on.states(4.1) == ["refused"], "the first pause again"


@pytest.mark.parametrize("code", ["invalid_image", "invalid_archive", "mask_failed", "invalid_request"])
def test_watch_sends_what_follows_from_the_files_once(bench: Make, code: str) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.fault_of_upload = problem(422, code, "it is wrong")
    assert on.states() == ["refused"] and "a file or an option changes, or with --again 'v'" in on.lines[-1]
    assert on.states(100_000.0) == []
    on.service.revision += 1
    assert on.states(100_000.0) == []
    on.service.fault_of_upload = None
    make(on.root, "v/3.jpg")
    assert on.states() == ["done"]


def test_a_profile_with_another_number_of_slices_is_waited_for(bench: Make) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.fault_of_upload = problem(422, "slice_count_mismatch", "the profile has 4 slices")
    assert on.states() == ["refused"] and "has a new revision" in on.lines[-1]
    made = on.service.made
    assert on.states(100_000.0) == [] and on.service.made == made, "all bytes would be sent to be refused again"
    on.service.fault_of_upload = None
    on.service.revision += 1
    assert on.states(1.0) == ["done"]


def test_a_stack_that_was_cancelled_or_deleted_is_sent_again_after_a_longer_pause(bench: Make) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.ended = {"state": "cancelled", "error": None}
    assert on.states() == ["failed"] and "it was cancelled at the service; it is sent again at" in on.lines[-1]
    on.service.ended = {}
    assert on.states(29.0) == [] and on.states(1.1) == ["done"]


def test_without_a_profile_nothing_is_sent_and_a_new_one_is_seen(bench: Make) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.revision = 0
    with pytest.raises(PinstackError, match="there is no profile") as caught:
        on.look()
    assert caught.value.code == "profile_not_found" and on.service.made == 0
    on.service.revision = 1
    assert on.states() == ["done"]


def test_a_service_that_refuses_everything_is_said_once(bench: Make) -> None:
    on = bench(quiet_s=0.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    on.service.revision = 0
    looks = 0

    class Looks(threading.Event):
        def wait(self, timeout: Optional[float] = None) -> bool:
            nonlocal looks
            looks += 1
            on.service.revision = 1 if looks == 3 else 0
            return looks == 6

    watch(on.rounds, on.chosen, Looks(), lambda _: None)
    said = [line for line in on.lines if line.startswith("nothing is sent now: there is no profile")]
    assert len(said) == 1 and on.lines[-1] == "v: done"


def test_watch_says_that_a_file_stays_held(bench: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    on = bench(quiet_s=1.0)
    make(on.root, "v/1.jpg", "v/2.jpg")
    opened = Path.open

    def held(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == "2.jpg":
            raise PermissionError(13, "The process cannot access the file", str(path))
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", held)
    for _ in range(30):
        assert on.states(1.0) == []
    assert on.lines == ["v: not sent yet: a file cannot be opened: is it still being written?"]
    monkeypatch.setattr(Path, "open", opened)
    assert on.states() == [] and on.states(1.0) == ["done"]


def lights(names: List[str]) -> Dict[str, Any]:
    """Groups ``view/light/file``."""
    views: Dict[str, Dict[str, List[str]]] = {}
    for name in names:
        view, light, _ = name.split("/")
        views.setdefault(view, {"front": [], "back": []})[light].append(name)
    shown = [{"name": view, "pan_deg": None, "tilt_deg": None, "problem": None, **of} for view, of in views.items()]
    return {"views": shown, "ignored": [], "warnings": []}


@pytest.mark.parametrize(
    ("chosen", "has_others", "waits"),
    [
        ({}, True, True),
        ({}, False, False),
        ({"back_light": "never"}, True, False),
        ({"back_light": "always"}, False, True),
        ({"options": {"mask": "required"}}, False, True),
        ({"options": {"mask": "none"}}, True, False),
        ({"back_light": "always", "options": {"mask": "none"}}, False, True),
    ],
)
def test_watch_waits_for_the_back_light(bench: Make, chosen: Dict[str, Any], has_others: bool, waits: bool) -> None:
    on = bench(quiet_s=0.0, **chosen)
    on.service.group = lights
    if has_others:
        make(on.root, "a/front/1.jpg", "a/front/2.jpg", "a/back/1.jpg", "a/back/2.jpg")
        assert on.states() == ["done"]
        # it may be moved away once it is done
        shutil.rmtree(on.root / "a")
    make(on.root, "v/front/1.jpg", "v/front/2.jpg")
    assert on.states(100.0) == ([] if waits else ["done"])
    if waits:
        assert on.lines[-1] == "v: not sent yet: it has no back light; if it needs none, give --back-light never"
        make(on.root, "v/back/1.jpg", "v/back/2.jpg")
        assert on.states() == ["done"] and on.service.made == 1 + has_others, "it is sent once"


def test_push_sends_front_light_alone_unless_told_otherwise(bench: Make) -> None:
    on = bench(repeats=False, quiet_s=0.0)
    on.service.group = lights
    make(on.root, "a/front/1.jpg", "a/back/1.jpg", "v/front/1.jpg")
    assert on.states() == ["done", "done"]
    on.chosen.back_light = "always"
    make(on.root, "w/front/1.jpg")
    assert on.states() == ["refused"] and "it has no back light" in on.lines[-1]


def push(root: Path, *more: str) -> int:
    return cli.main(["push", str(root), *RIG, *more])


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Service:
    own = Service()
    monkeypatch.setattr(cli, "_client", lambda _: client(own))
    return own


def test_a_done_stack_need_not_be_quiet(tmp_path: Path, service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    assert push(tmp_path) == 0

    class Impatient(threading.Event):
        def wait(self, timeout: Optional[float] = None) -> bool:
            raise AssertionError("it waits")

    monkeypatch.setattr(cli, "_stop_by_signals", Impatient)
    assert cli.main(["push", str(tmp_path), *RIG[:-1], "1000"]) == 0
    # only what is to be sent is watched
    make(tmp_path, "v/3.jpg")
    with pytest.raises(AssertionError, match="it waits"):
        cli.main(["push", str(tmp_path), *RIG[:-1], "1000"])


def test_one_failed_stack_is_sent_again_by_its_name(
    tmp_path: Path, service: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "w/1.jpg", "w/2.jpg")
    service.ended = {"state": "failed", "error": {"code": "invalid_image", "detail": "it is torn"}}
    assert push(tmp_path) == 1 and service.made == 2
    assert push(tmp_path) == 1 and service.made == 2
    assert "it is sent again when a file or an option changes, or with --again 'v'" in capsys.readouterr().err
    service.ended = {}
    assert push(tmp_path, "--again", "v") == 1 and service.made == 3
    told = capsys.readouterr().err
    assert "v: done" in told and "w: failed: it is torn" in told
    assert push(tmp_path, "--again", "w") == 0 and service.made == 4
    assert push(tmp_path, "--again", "w") == 0 and service.made == 5, "also what is done"
    assert push(tmp_path, "--again", "x") == 2 and "there is no stack 'x'" in capsys.readouterr().err


def test_what_is_not_in_the_files_is_exit_code_3(
    tmp_path: Path, service: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    service.fault_of_upload = problem(507, "insufficient_storage", "the disk is full")
    assert push(tmp_path) == 3 and "give the same command again to send it" in capsys.readouterr().err
    service.fault_of_upload = problem(422, "invalid_image", "it is torn")
    assert push(tmp_path) == 1
    service.fault_of_upload, service.revision = None, 0
    assert push(tmp_path) == 3 and "there is no profile" in capsys.readouterr().err
    service.revision = 1
    assert push(tmp_path) == 0


def test_push_names_a_view_whose_folder_is_gone(
    tmp_path: Path, service: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, "pan000/1.jpg", "pan060/1.jpg")
    assert push(tmp_path, "--scan", "s") == 0
    (tmp_path / "pan060").rename(tmp_path / "pan040")
    capsys.readouterr()
    assert push(tmp_path, "--scan", "s") == 0
    told = capsys.readouterr().err
    stack = next(path for path in service.labels if service.labels[path] == "pan060")
    assert "pan060 was sent to the scan s, but its folder is not there any more, and pan040 has the same" in told
    assert f"delete {stack}" in told and "pan000 was" not in told
    # another scan, and a service that has the stack no longer
    assert push(tmp_path, "--scan", "t") == 0
    assert "pan060 was" not in capsys.readouterr().err
    service.deleted.add(stack)
    assert push(tmp_path, "--scan", "s") == 0
    assert "pan060 was" not in capsys.readouterr().err


def test_a_token_file_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "token"
    file.write_text("one\n")
    seen: List[Optional[str]] = []

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request.headers.get("authorization"))
        return httpx.Response(200, json={})

    given = {"rig": "r", "lens": "l", "token_file": file}
    loaded = settings.load(None, given, {})
    told: List[str] = []
    assert loaded.token_file is not None
    loaded.token_file.on_change = told.append
    # the variable of another service must not win
    monkeypatch.setenv("PINSTACK_TOKEN", "of the environment")
    made = Client.__init__

    def init(self: Client, *arguments: Any, **options: Any) -> None:
        made(self, *arguments, **options, transport=httpx.MockTransport(answer))

    monkeypatch.setattr(Client, "__init__", init)
    own = cli._client(loaded)
    own.info()
    file.write_text("")
    own.info()
    file.unlink()
    own.info()
    file.write_text("two\n")
    own.info()
    own.info()
    assert seen == ["Bearer one"] * 3 + ["Bearer two"] * 2
    assert told == [f"the token in {file} has changed; it is used from now on"] and "two" not in told[0]
    with pytest.raises(PinstackError, match="is empty"):
        file.write_text(" \n")
        settings.load(None, given, {})


def test_names_are_not_grouped_anew_while_they_are_the_same(bench: Make) -> None:
    on = bench()
    make(on.root, "v/1.jpg", "v/2.jpg")
    for _ in range(3):
        on.look(1.0)
    assert on.service.grouped == 1
    make(on.root, "v/3.jpg")
    on.look()
    assert on.service.grouped == 2
