"""``push`` and ``watch`` with a running service: the binary in ``PINSTACK_TEST_BINARY``."""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Callable, Iterator, List

import pytest
from conftest import Service

from pinstack import Client, Retry
from pinstack.push.cli import main
from pinstack.push.folders import find
from pinstack.push.journal import Journal
from pinstack.push.progress import Progress
from pinstack.push.run import send_all
from pinstack.push.sender import Outcome, key
from pinstack.push.settings import Settings
from pinstack.push.watch import watch

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
    return ["push", str(root), "--server", service.url, "--rig", "bench-1", "--lens", "macro65", *more]


def settings(service: Service) -> Settings:
    return Settings(server=service.url, rig="bench-1", lens="macro65", jobs=1, quiet_s=0.05, every_s=0.02)


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
    assert main(command) == 2
    assert "bench-1" in capsys.readouterr().err, "the service names the rig that is there"


#: Sends the stacks of a folder in small pieces, and dies in the midst of an upload as by kill -9.
DIES = """
import os, sys
from pathlib import Path
from pinstack import Client
from pinstack.push.folders import find
from pinstack.push.journal import Journal
from pinstack.push.sender import send
from pinstack.push.settings import Settings

root, url = Path(sys.argv[1]), sys.argv[2]
settings = Settings(server=url, rig="bench-1", lens="macro65")

def step(name, what, share):
    if what == "sending" and share > 0.5:
        os._exit(9)

journal = Journal(root / ".pinstack-journal")
for stack in find(root).stacks:
    send(Client(url, piece_bytes=10_000), journal, stack, settings, root / "results", step)
"""


def test_after_a_crash_an_upload_goes_on_and_makes_one_stack(own: Service, shots: Path) -> None:
    died = subprocess.run([sys.executable, "-c", DIES, str(shots), own.url], check=False)
    assert died.returncode == 9
    chosen = settings(own)
    stacks = find(shots).stacks
    journal = Journal(shots / ".pinstack-journal")
    before = journal.entry(key(stacks[0], chosen))
    assert before.upload is not None and before.job is None
    shares: List[float] = []

    class Watched(Progress):
        def step(self, name: str, what: str, share: float) -> None:
            if name == stacks[0].name and what == "sending" and share > 0:
                shares.append(share)

    def make() -> Client:
        return Client(own.url, piece_bytes=10_000)

    outcomes = send_all(make, journal, stacks, chosen, shots / "results", Watched(2, io.StringIO()))
    assert [outcome.state for outcome in outcomes] == ["done", "done"]
    assert min(shares) > 0.4, "the upload went on where it was"
    assert journal.entry(key(stacks[0], chosen)).upload == before.upload
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

    everything = (make, journal, root, settings(own), root / "results", Progress(0, log), stop, keep)
    thread = threading.Thread(target=watch, args=everything)
    thread.start()
    try:
        shutil.copytree(zips / "stack", root / "one")
        until(lambda: (root / "results/one.png").exists())
        own.kill()
        shutil.copytree(zips / "stack", root / "two")
        until(lambda: any(outcome.state == "unreachable" for outcome in ended))
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
