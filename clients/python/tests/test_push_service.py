"""``push`` and ``watch`` with a running service: the binary in ``PINSTACK_TEST_BINARY``."""

from __future__ import annotations

import io
import json
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable, Iterator, List, Optional

import pytest
from conftest import Service, binary, elsewhere

from pinstack import Client, Retry
from pinstack.push.causes import Site, site_of
from pinstack.push.cli import _look, main
from pinstack.push.folders import FoundStack, find
from pinstack.push.journal import Journal
from pinstack.push.progress import Progress
from pinstack.push.run import send_all
from pinstack.push.sender import Outcome, key
from pinstack.push.settings import Settings
from pinstack.push.watch import Rounds, watch

LONGEST_S = 120


@pytest.fixture
def own(tmp_path: Path, zips: Path) -> Iterator[Service]:
    """A service of the test's own, with a profile that fits the stack."""
    folder = tmp_path / "service"
    folder.mkdir()
    running = Service(folder)
    with Client(running.url) as client:
        client.calibrate("bench-1", "macro65", zips / "target.zip", focal_mm=65.0, pixel_pitch_mm=0.02)
    yield running
    running.kill()


@pytest.fixture
def shots(tmp_path: Path, zips: Path) -> Path:
    """Two views as a capture program leaves them."""
    root = tmp_path / "shots"
    for name in ("pan000_tilt10", "pan020_tilt10"):
        shutil.copytree(zips / "stack", root / name)
    return root


def arguments(service: Service, root: Path, *more: str) -> List[str]:
    common = ["--server", service.url, "--rig", "bench-1", "--lens", "macro65", "--quiet-s", "0.1"]
    return ["push", str(root), *common, *more]


def settings(service: Service) -> Settings:
    return Settings(server=service.url, rig="bench-1", lens="macro65", jobs=1, quiet_s=0.05, every_s=0.02)


def found(service: Service, root: Path) -> List[FoundStack]:
    with Client(service.url) as client:
        return find(root, client.group_names).stacks


def site(service: Service, chosen: Settings) -> Site:
    with Client(service.url) as client:
        return site_of(client, chosen)


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + LONGEST_S
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        threading.Event().wait(0.02)


def test_folders_are_sent_once_and_their_results_saved(
    own: Service, shots: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(own, shots, "-o", "method=pyramid")) == 0
    results = sorted(path.name for path in (shots / "results").iterdir())
    names = [f"pan0{pan}_tilt10{tail}.png" for pan in ("00", "20") for tail in ("", "_mask")]
    assert results == sorted(["contact-sheet", "contact-sheet.html", *names])
    page = (shots / "results/contact-sheet.html").read_text("utf-8")
    assert page.count("<img") == 2 and "sharpness" in page
    with Client(own.url) as client:
        stacks = client.list_stacks()
        assert sorted(str(stack["options"]["label"]) for stack in stacks) == ["pan000_tilt10", "pan020_tilt10"]
        assert {stack["options"]["method"] for stack in stacks} == {"pyramid"}
        # the results are not taken for stacks, and nothing is sent again
        assert main(arguments(own, shots, "-o", "method=pyramid")) == 0
        assert len(client.list_stacks()) == 2
    assert "2 of 2 stacks are done" in capsys.readouterr().err


def test_stacks_and_results_are_reached_by_the_path_for_calls_alone(
    own: Service, zips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = elsewhere(tmp_path, monkeypatch)
    disk = tmp_path / "disk"
    shutil.copytree(zips / "stack", disk / "bee")
    assert main(arguments(own, root, "-o", "method=pyramid")) == 0
    names = sorted(path.name for path in (disk / "results").iterdir())
    assert names == ["bee.png", "bee_mask.png", "contact-sheet", "contact-sheet.html"]
    assert (disk / ".pinstack-journal").exists() and not root.exists()


def test_views_of_a_scan_have_their_angles(own: Service, shots: Path) -> None:
    with Client(own.url) as client:
        client.put_scan("bee", "bench-1", "macro65")
        assert main(arguments(own, shots, "--scan", "bee")) == 0
        views = client.get_scan("bee")["views"]
    assert [(view["pan_deg"], view["tilt_deg"], view["state"]) for view in views] == [
        (0, 10, "succeeded"),
        (20, 10, "succeeded"),
    ]


def test_a_stack_that_is_refused_does_not_stop_the_others(
    own: Service, shots: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for light in ("front", "back"):
        slices = sorted((shots / "pan000_tilt10" / light).iterdir())
        slices[-1].unlink()
    assert main(arguments(own, shots)) == 1
    told = capsys.readouterr().err
    assert "pan000_tilt10: refused" in told and "the profile" in told and "pan020_tilt10: done" in told
    assert (shots / "results/pan020_tilt10.png").exists()


def test_a_wrong_rig_is_told_before_anything_is_sent(
    own: Service, shots: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = arguments(own, shots)
    command[command.index("bench-1")] = "bench-2"
    assert main(command) == 3, "somebody may calibrate it"
    assert "bench-1" in capsys.readouterr().err, "the service names the rig that is there"


#: Sends the stacks of a folder in small pieces, and dies in the midst of an upload as by kill -9.
DIES = """
import os, sys
from pathlib import Path
from pinstack import Client
from pinstack.push.folders import FoundStack, find
from pinstack.push.journal import Journal
from pinstack.push.causes import site_of
from pinstack.push.sender import Sender
from pinstack.push.settings import Settings

root, url = Path(sys.argv[1]), sys.argv[2]
settings = Settings(server=url, rig="bench-1", lens="macro65")

def step(name, what, share):
    if what == "sending" and share > 0.5:
        os._exit(9)

journal = Journal(root / ".pinstack-journal")
client = Client(url, piece_bytes=10_000)
sender = Sender(client, journal, settings, root / "results", step, site_of(client, settings))
for stack in find(root, client.group_names).stacks:
    sender.send(stack)
"""


def test_after_a_crash_an_upload_goes_on_and_makes_one_stack(own: Service, shots: Path) -> None:
    died = subprocess.run([sys.executable, "-c", DIES, str(shots), own.url], check=False)
    assert died.returncode == 9
    chosen = settings(own)
    stacks = found(own, shots)
    journal = Journal(shots / ".pinstack-journal")
    where = site(own, chosen)
    before = journal.entry(key(stacks[0], chosen, where).value)
    assert before.upload is not None and before.job is None
    shares: List[float] = []

    class Watched(Progress):
        def step(self, name: str, what: str, share: float) -> None:
            if name == stacks[0].name and what == "sending" and share > 0:
                shares.append(share)

    def make() -> Client:
        return Client(own.url, piece_bytes=10_000)

    outcomes = send_all(make, journal, stacks, chosen, shots / "results", Watched(2, io.StringIO()), where)
    assert [outcome.state for outcome in outcomes] == ["done", "done"]
    assert min(shares) > 0.4, "the upload went on where it was"
    assert journal.entry(key(stacks[0], chosen, where).value).upload == before.upload
    journal.close()
    with Client(own.url) as client:
        assert len(client.list_stacks()) == 2


def test_watching_sends_what_becomes_complete_also_after_the_service_was_away(
    own: Service, zips: Path, tmp_path: Path
) -> None:
    root = tmp_path / "watched"
    root.mkdir()
    stop, ended = threading.Event(), []  # type: ignore[var-annotated]
    journal = Journal(root / ".pinstack-journal")
    log = io.StringIO()

    def keep(outcomes: List[Outcome]) -> None:
        ended.extend(outcomes)

    def make() -> Client:
        return Client(own.url, retry=Retry(attempts=2, first_s=0.01))

    chosen = settings(own)
    look = _look([root], chosen)
    rounds = Rounds(make, journal, look, chosen, root / "results", Progress(0, log), stop, repeats=True)
    thread = threading.Thread(target=watch, args=(rounds, chosen, stop, keep))
    thread.start()
    try:
        shutil.copytree(zips / "stack", root / "one")
        until(lambda: (root / "results/one.png").exists())
        own.kill()
        shutil.copytree(zips / "stack", root / "two")
        until(lambda: "nothing is sent now" in log.getvalue())
        own.start()
        until(lambda: any(outcome.name == "two" and outcome.state == "done" for outcome in ended))
    finally:
        stop.set()
        thread.join(LONGEST_S)
    assert not thread.is_alive()
    journal.close()
    assert (root / "results/two_mask.png").exists()
    with Client(own.url) as client:
        assert len(client.list_stacks()) == 2


def test_results_that_are_missing_are_fetched_again(own: Service, shots: Path) -> None:
    assert main(arguments(own, shots)) == 0
    results = shots / "results"
    picture = (results / "pan000_tilt10.png").read_bytes()
    (results / "pan000_tilt10.png").unlink()
    assert main(arguments(own, shots, "--save", "image", "mask", "depth")) == 0
    assert (results / "pan000_tilt10.png").read_bytes() == picture
    assert (results / "pan020_tilt10_depth.png").exists(), "asked for later"
    with Client(own.url) as client:
        stacks = client.list_stacks()
        assert len(stacks) == 2, "nothing was sent again"
        for stack in stacks:
            client.delete(stack)
    # what is left is no failure: a stack may never have had a mask
    (results / "pan000_tilt10_mask.png").unlink()
    assert main(arguments(own, shots)) == 0
    (results / "pan000_tilt10.png").unlink()
    assert main(arguments(own, shots)) == 1


def test_views_in_file_names_and_focus_steps_with_signs(own: Service, zips: Path, tmp_path: Path) -> None:
    root = tmp_path / "RAW"
    root.mkdir()
    for view in (0, 100):
        for light in ("front", "back"):
            for at, path in enumerate(sorted((zips / "stack" / light).iterdir())):
                shutil.copy(path, root / f"_x_00000_y_{view:05d}_{light}_step_{400 * at - 800:06d}_{path.suffix}")
    with Client(own.url) as client:
        client.put_scan("bee", "bench-1", "macro65")
        rules = ["-n", "x_degrees_per_unit=1", "-n", "y_degrees_per_unit=0.1", "--scan", "bee"]
        assert main(arguments(own, root, *rules)) == 0
        views = client.get_scan("bee")["views"]
    assert [(view["pan_deg"], view["tilt_deg"], view["state"]) for view in views] == [
        (0, 0, "succeeded"),
        (10, 0, "succeeded"),
    ]


def test_a_dry_run_shows_the_grouping(own: Service, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "shots"
    for name in ("pan000_tilt15/front/1.jpg", "pan000_tilt15/front/2.jpg", "lonely/1.jpg", "readme.txt", ".x/1.jpg",
                 "results/1.jpg", "Fotos/Käfer 1/vorne/1.jpg", "Fotos/Käfer 1/vorne/2.jpg", "a\\b/1.jpg"):  # fmt: skip
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(b"x")
    command = ["push", str(root), "--server", own.url, "--dry-run"]
    assert main(command) == 1
    told = capsys.readouterr().out
    assert "pan000_tilt15: 2 front, 0 back, pan 0, tilt 15" in told and "Fotos_Käfer 1: 2 front, 0 back" in told
    assert "lonely: 1 front, 0 back  ! lonely has one front-light slice" in told
    assert "readme.txt: neither a JPEG" in told and ".x: a hidden folder" in told and "has control characters" in told
    assert "results" not in told
    assert main([*command, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert [stack["name"] for stack in document["stacks"]] == ["pan000_tilt15", "Fotos_Käfer 1", "lonely"]


def test_every_picture_is_in_exactly_one_place(own: Service, tmp_path: Path) -> None:
    words = ["front", "back", "bee", "bee_back", "bee front", "x=6", "y=120", "masks", "View 01", "fond"]
    with Client(own.url) as client:
        for seed in range(40):
            chance = random.Random(seed)
            root = tmp_path / str(seed)
            names = {"/".join([*chance.choices(words, k=chance.randrange(4)), f"img_{at}.jpg"]) for at in range(25)}
            for name in names:
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_bytes(name.encode())
            grouping = find(root, client.group_names)
            placed = [path for stack in grouping.stacks for path in stack.files()]
            placed += [path for path, _ in grouping.ignored]
            assert sorted(placed) == sorted(root / name for name in names), seed


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("command", ["push", "watch"])
def test_a_signal_ends_a_run_at_once_also_while_the_service_is_away(
    own: Service, shots: Path, command: str, number: int
) -> None:
    own.kill()
    given = [sys.executable, "-m", "pinstack", command, *arguments(own, shots)[1:]]
    running = subprocess.Popen(given, stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    try:
        if command == "watch":
            while "nothing is sent now" not in running.stderr.readline():
                assert running.poll() is None
        else:
            until(lambda: _is_waiting(running.pid))
        began = time.monotonic()
        running.send_signal(number)
        assert running.wait(LONGEST_S) == (0 if command == "watch" else 130)
        # without the signal it would wait for half a minute and more
        assert time.monotonic() - began < 20
    finally:
        running.kill()
        running.stderr.close()


def _is_waiting(pid: int) -> bool:
    """Whether a process handles SIGTERM by itself, so that a signal does not meet it while it starts."""
    caught = [line for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("SigCgt")]
    return bool(int(caught[0].split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def test_a_full_disk_or_a_held_contact_sheet_ends_no_watch(own: Service, zips: Path, tmp_path: Path) -> None:
    root = tmp_path / "watched"
    shutil.copytree(zips / "stack", root / "one")
    # a folder in the place of the sheet: it cannot be written
    (root / "results/contact-sheet.html.part").mkdir(parents=True)
    given = [sys.executable, "-m", "pinstack", "watch", *arguments(own, root)[1:], "--every-s", "0.05"]
    running = subprocess.Popen(given, stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    try:
        while "the contact sheet cannot be written" not in running.stderr.readline():
            assert running.poll() is None
        assert (root / "results/one.png").exists()
        shutil.copytree(zips / "stack", root / "two")
        until(lambda: (root / "results/two.png").exists())
        running.send_signal(signal.SIGTERM)
        assert running.wait(LONGEST_S) == 0
    finally:
        running.kill()
        running.stderr.close()


def test_a_journal_that_cannot_be_written_is_told_and_the_next_run_sends_nothing_twice(
    own: Service, shots: Path
) -> None:
    class Full(Journal):
        is_full = True

        def note(self, key: str, name: str, **values: Optional[str]) -> None:
            if self.is_full and "job" in values:
                raise sqlite3.OperationalError("database or disk is full")
            super().note(key, name, **values)

    journal = Full(shots / ".pinstack-journal")
    stacks, chosen = found(own, shots), settings(own)
    shown = Progress(2, io.StringIO())
    everything = (lambda: Client(own.url), journal, stacks, chosen, shots / "results", shown, site(own, chosen))
    first = send_all(*everything)
    assert [outcome.state for outcome in first] == ["incomplete", "incomplete"]
    assert "disk is full" in first[0].sentences[0]
    journal.is_full = False
    assert [outcome.state for outcome in send_all(*everything)] == ["done", "done"]
    journal.close()
    with Client(own.url) as client:
        assert len(client.list_stacks()) == 2


def test_a_stack_is_known_at_every_address_and_by_other_times(own: Service, shots: Path) -> None:
    assert main(arguments(own, shots)) == 0
    with Client(own.url) as client:
        identity = client.info()["id"]
        for path in shots.rglob("front/*"):
            later = path.stat().st_mtime + 3600
            os.utime(path, (later, later))
        command = arguments(own, shots)
        command[command.index(own.url)] = own.url.replace("127.0.0.1", "localhost")
        assert main(command) == 0
        assert len(client.list_stacks()) == 2
        own.kill()
        own.start()
        assert client.info()["id"] == identity
        assert main(arguments(own, shots)) == 0
        assert len(client.list_stacks()) == 2


def test_a_stack_that_failed_for_its_profile_is_sent_again_with_a_new_one(
    own: Service, shots: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Client(own.url) as client:
        good = client.get_profile("bench-1", "macro65")
        bad = {name: good[name] for name in ("image_width", "image_height", "reference_index")}  # type: ignore[literal-required]
        count, width = good["slice_count"], good["image_width"]
        # no pixel is in all slices
        shifts = [width * 0.6 * (at - (count - 1) / 2) for at in range(count)]
        bad["homographies"] = [[1, 0, shift, 0, 1, 0, 0, 0, 1] for shift in shifts]
        client.put_profile("bench-1", "macro65", bad)
        command = arguments(own, shots, "-o", "crop=valid")
        assert main(command) == 1
        sent = len(client.list_stacks())
        assert "has a new revision" in capsys.readouterr().err
        assert main(command) == 1 and len(client.list_stacks()) == sent
        client.put_profile("bench-1", "macro65", {name: good[name] for name in bad})  # type: ignore[literal-required]
        assert main(command) == 0


def test_watch_uses_a_new_token_of_its_file(own: Service, zips: Path, tmp_path: Path) -> None:
    def token(name: str) -> str:
        command = [binary(), "token", "add", name, "--scope", "admin", "--data-dir", str(own.folder / "data")]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    own.kill()
    own.arguments += ["--auth", "tokens"]
    file = tmp_path / "token"
    file.write_text(token("one"))
    own.start()
    root = tmp_path / "watched"
    shutil.copytree(zips / "stack", root / "one")
    given = [sys.executable, "-m", "pinstack", "watch", *arguments(own, root)[1:], "--every-s", "0.05"]
    running = subprocess.Popen([*given, "--token-file", str(file)], stderr=subprocess.PIPE, text=True)
    assert running.stderr is not None
    try:
        until(lambda: (root / "results/one.png").exists())
        new = token("two")
        revoke = [binary(), "token", "revoke", "one", "--data-dir", str(own.folder / "data")]
        subprocess.run(revoke, check=True, capture_output=True)
        shutil.copytree(zips / "stack", root / "two")
        while "nothing is sent now" not in running.stderr.readline():
            assert running.poll() is None
        file.write_text(new)
        until(lambda: (root / "results/two.png").exists())
    finally:
        running.kill()
        running.wait()
        running.stderr.close()
