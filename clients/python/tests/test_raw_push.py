"""``push`` with stacks of camera raw files: what is sent, what continues, what is said."""

from __future__ import annotations

import io
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional

import httpx
import pytest
from conftest import Service, binary
from dng import Dng
from fake import JOB, SITE, Uploads
from test_push import by_folder, make, succeeds
from test_push_cli import RIG, client
from test_push_cli import Service as InMemory

from pinstack import Client, PinstackError, Retry
from pinstack.push import cli, folders, raws
from pinstack.push import converter as converters
from pinstack.push.causes import Again
from pinstack.push.cli import main
from pinstack.push.folders import FoundStack
from pinstack.push.journal import Journal
from pinstack.push.run import Stopped
from pinstack.push.sender import OnStep, Outcome, Sender, key
from pinstack.push.settings import Settings, load
from pinstack.push.spool import Spool

pytest.importorskip("rawpy")
numpy = pytest.importorskip("numpy")
tifffile = pytest.importorskip("tifffile")
image = pytest.importorskip("PIL.Image")


def shots(root: Path, count: int = 3, suffix: str = ".ARW") -> Path:
    """A stack of front light and one of back light, in a folder each."""
    for at in range(1, count + 1):
        for light, level in (("front", 0.1), ("back", 0.2)):
            neutral = (0.5, 1.0, 0.625) if (light, at) == ("front", count // 2 + 1) else (0.8, 1.0, 0.4)
            dng = Dng(light=lambda x, y, v=level * at: v, neutral=neutral, real=(0.5, 1.0, 0.625))  # type: ignore[misc]
            dng.write(root / light / f"{at}{suffix}")
    return root


def stack_of(root: Path) -> FoundStack:
    lights = (sorted((root / light).iterdir()) for light in ("front", "back"))
    return FoundStack("view", "view", *lights)


class Sending:
    """Sends one stack to a service in memory, each time as a new process does."""

    def __init__(self, root: Path, faults: Optional[List[str]] = None) -> None:
        self.stack, self.at = stack_of(shots(root / "shots")), root / ".journal"
        self.uploads = Uploads(faults)
        self.settings = Settings(rig="r", lens="l")
        self.steps: List[str] = []

    def step(self, name: str, what: str, share: float) -> None:
        self.steps.append(what)

    def send(self, step: Optional[OnStep] = None) -> Outcome:
        journal = Journal(self.at)
        transport = httpx.MockTransport(succeeds(self.uploads))
        try:
            # a piece is smaller than a slice
            retry = Retry(attempts=2, first_s=0.0)
            with Client("http://rig", retry=retry, piece_bytes=700, transport=transport) as sender:
                results = self.at.parent / "results"
                return Sender(sender, journal, self.settings, results, step or self.step, SITE).send(self.stack)
        finally:
            journal.close()

    def sent(self) -> Dict[str, Any]:
        """The slices that the service has, by name."""
        with zipfile.ZipFile(io.BytesIO(self.uploads.stored)) as read:
            assert read.testzip() is None
            return {name: tifffile.imread(io.BytesIO(read.read(name))) for name in read.namelist()}

    def spools(self) -> List[Path]:
        return sorted(self.at.parent.glob(".pinstack-raw-*/*/*.tif"))


def is_whole(sent: Dict[str, Any]) -> bool:
    """Whether all six slices are there, converted alike."""
    assert sorted(sent) == [f"{light}/{at}.tif" for light in ("back", "front") for at in (1, 2, 3)]
    values = {name: numpy.asarray(pixels, dtype=float).reshape(-1, 3).mean(0) / 65535 for name, pixels in sent.items()}
    for name, value in values.items():
        light = (0.2 if name.startswith("back") else 0.1) * int(name[-5])
        assert numpy.allclose(((value + 0.055) / 1.055) ** 2.4, light, rtol=2e-3), name
    return True


def test_a_stack_of_raw_files_is_sent_as_pictures_that_are_converted_alike(tmp_path: Path) -> None:
    sending = Sending(tmp_path)
    assert sending.send().state == "done" and is_whole(sending.sent())
    assert [*dict.fromkeys(sending.steps)][:2] == ["sending", "converting"] or "converting" in sending.steps
    assert not list(tmp_path.glob(".pinstack-raw-*")), "what was converted is deleted"
    sending.steps.clear()
    assert sending.send().state == "known" and "converting" not in sending.steps


def test_jpeg_by_option_is_another_upload(tmp_path: Path) -> None:
    sending = Sending(tmp_path)
    sending.send()
    sending.settings.raw_format = "jpeg"
    assert sending.send().state == "done"
    with zipfile.ZipFile(io.BytesIO(sending.uploads.stored)) as read:
        assert sorted(read.namelist())[0] == "back/1.jpg" and read.read("back/1.jpg")[:3] == b"\xff\xd8\xff"


def test_a_lost_connection_continues_with_the_same_bytes_and_converts_nothing_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sending = Sending(tmp_path, ["", "", "", "no connection", "no connection"])
    ended = sending.send()
    assert (ended.state, ended.again) == ("unreachable", Again.LATER) and len(sending.spools()) == 6
    stored = sending.uploads.stored
    assert 0 < len(stored) < (sending.uploads.length or 0)

    def refuse(*_: object) -> None:
        raise AssertionError("it was converted again")

    monkeypatch.setattr(converters, "convert", refuse)
    assert sending.send().state == "done"
    assert sending.uploads.requests.count("POST") == 1 and sending.uploads.stored.startswith(stored)
    assert is_whole(sending.sent()) and not sending.spools()


@pytest.mark.parametrize("lost", ["all", "one"])
def test_without_the_converted_files_the_upload_begins_anew(tmp_path: Path, lost: str) -> None:
    sending = Sending(tmp_path, ["", "", "no connection", "no connection"])
    sending.send()
    if lost == "all":
        shutil.rmtree(sending.spools()[0].parents[1])
    else:
        sending.spools()[3].unlink()
    assert sending.send().state == "done"
    assert sending.uploads.requests.count("POST") == 2 and is_whole(sending.sent())


def test_an_interrupted_conversion_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sending, made = Sending(tmp_path), []
    monkeypatch.setattr(converters.os, "cpu_count", lambda: 1)
    convert = raws.convert

    def counted(path: Path, *rest: Any) -> None:
        convert(path, *rest)
        made.append(path)

    monkeypatch.setattr(converters, "convert", counted)

    def stop(name: str, what: str, share: float) -> None:
        if what == "converting" and len(made) >= 2:
            raise Stopped

    with pytest.raises(Stopped):
        sending.send(stop)
    kept = len(sending.spools())
    assert 0 < kept < 6 and sending.uploads.length is None
    made.clear()
    assert sending.send().state == "done" and len(made) == 6 - kept and is_whole(sending.sent())


def test_a_stack_that_changed_leaves_no_converted_files(tmp_path: Path) -> None:
    sending = Sending(tmp_path, ["no connection", "no connection"])
    sending.send()
    before = sending.spools()[0].parent
    Dng(light=lambda x, y: 0.3, orientation=1, fraction="255").write(sending.stack.front[2])
    assert sending.send().state == "done"
    assert not before.exists() and not sending.spools()


def test_what_an_earlier_run_could_not_delete_is_deleted(tmp_path: Path) -> None:
    sending = Sending(tmp_path, ["no connection", "no connection"])
    sending.send()
    folder = sending.spools()[0].parent
    shutil.copytree(folder, tmp_path / "copy")
    sending.send()
    folder.parent.mkdir(exist_ok=True)
    shutil.copytree(tmp_path / "copy", folder)
    journal = Journal(sending.at)
    Spool(journal, sending.settings)
    journal.close()
    assert not folder.exists()


def test_a_small_disk_is_told_before_anything_is_converted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(100, 99, 1000))  # type: ignore[attr-defined]
    sending = Sending(tmp_path)
    ended = sending.send()
    assert ended.again is Again.LATER and "its 6 slices take up to 0.0 GB" in ended.sentences[0]
    assert "--raw-temp" in ended.sentences[0] and not sending.spools() and sending.uploads.length is None


def test_options_of_the_conversion_are_part_of_the_key_of_raw_stacks_alone(tmp_path: Path) -> None:
    raw = stack_of(shots(tmp_path / "raw"))
    jpeg = FoundStack("v", "v", [make(tmp_path, "1.jpg") / "1.jpg"])
    one, other = Settings(rig="r", lens="l"), Settings(rig="r", lens="l", raw_exposure=1.0)
    assert key(raw, one, SITE) != key(raw, other, SITE) and key(jpeg, one, SITE) == key(jpeg, other, SITE)


def test_settings_of_the_conversion_are_checked(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    for line, reason in [
        ('raw_format = "png"', "tiff or jpeg"), ("raw_quality = 0", "1 to 100"), ("raw_memory_gb = 0", "more than 0"),
        ('raw_exposure = "bright"', "wrong type"), ('prefer = "nef"', "raw, picture"),
    ]:  # fmt: skip
        file.write_text(f'rig = "r"\nlens = "l"\n{line}\n')
        with pytest.raises(PinstackError, match=reason):
            load(file, {}, {})


# -- which files are a stack ----------------------------------------------------------------------------------------


def found(root: Path, prefer: Optional[str] = None) -> folders.Found:
    return folders.find(root, by_folder, prefer=prefer)


def names(found: folders.Found) -> List[str]:
    return sorted(path.name for stack in found.stacks for path in stack.files())


def test_a_raw_file_and_a_picture_of_one_shot_count_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = make(tmp_path, "v/1.ARW", "v/1.JPG", "v/2.arw", "v/2.jpg", "v/2.dng", "v/notes.txt")
    one = found(root)
    assert names(one) == ["1.ARW", "2.arw", "notes.txt"] and one.notes == [] and len(one.stacks) == 1
    assert sorted((path.name, reason) for path, reason in one.ignored) == [
        ("1.JPG", "the raw file of the same name is used, 1.ARW"),
        ("2.dng", "another raw file of the same name is used, 2.arw"),
        ("2.jpg", "the raw file of the same name is used, 2.arw"),
    ]
    assert names(found(root, "picture")) == ["1.JPG", "2.jpg", "notes.txt"]
    monkeypatch.setattr(raws, "is_supported", lambda: False)
    monkeypatch.setattr(folders, "is_supported", lambda: False)
    without = found(root)
    assert names(without) == ["1.JPG", "2.jpg", "notes.txt"]
    assert len(without.notes) == 1 and "3 camera raw files" in without.notes[0] and "pip install" in without.notes[0]


def test_without_the_extra_a_stack_of_raw_files_alone_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = make(tmp_path, "a/1.ARW", "a/2.ARW", "b/1.jpg", "b/2.jpg")
    monkeypatch.setattr(folders, "is_supported", lambda: False)
    problems = {stack.name: stack.problem for stack in found(root).stacks}
    assert problems["b"] is None
    assert "1.ARW is a camera raw file" in str(problems["a"]) and "pip install rawpy pillow" in str(problems["a"])


def test_a_stack_of_raw_files_and_pictures_is_refused(tmp_path: Path) -> None:
    (stack,) = found(make(tmp_path, "1.ARW", "2.ARW", "3.jpg")).stacks
    assert stack.problem is not None and "1.ARW" in stack.problem and "3.jpg" in stack.problem


def test_the_service_groups_the_names_of_the_pictures(tmp_path: Path) -> None:
    asked: List[Any] = []

    def ask(sent: Any, manifest: Any) -> Any:
        asked[:] = [sorted(sent), manifest]
        return by_folder(sent, manifest)

    make(tmp_path, "v/a.1.NEF", "v/b.nef", "v/c.jpg", "v/a.1.jpg")
    manifest = {"views": [{"name": "v", "front": ["v/a.1.NEF", "v/b.NEF", "v/c.jpg"], "pan_deg": 3}]}
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    folders.find(tmp_path, ask, raw_suffix=".jpg")
    assert asked[0] == ["manifest.json", "v/a.1.jpg", "v/b.jpg", "v/c.jpg"]
    assert asked[1] == {"views": [{"name": "v", "front": ["v/a.1.jpg", "v/b.jpg", "v/c.jpg"], "pan_deg": 3}]}


def test_bursts_of_raw_files_are_told_apart(tmp_path: Path) -> None:
    for at, taken in enumerate(["10:00:00", "10:00:01", "10:05:00", "10:05:01"]):
        Dng(taken=f"2026:11:23 {taken}").write(tmp_path / f"{at}.DNG")
    stacks = folders.find(tmp_path, by_folder, gap_s=60).stacks
    assert [[path.name for path in stack.front] for stack in stacks] == [["0.DNG", "1.DNG"], ["2.DNG", "3.DNG"]]


def test_converted_files_are_no_stacks(tmp_path: Path) -> None:
    make(tmp_path, "v/1.jpg", ".pinstack-raw-12345678/abc/00001.tif", ".other/1.jpg")
    one = found(tmp_path)
    assert names(one) == ["1.jpg"] and [path.name for path, _ in one.ignored] == [".other"]


# -- the command ----------------------------------------------------------------------------------------------------


def test_other_stacks_go_on_after_a_damaged_raw_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = InMemory()
    monkeypatch.setattr(cli, "_client", lambda _: client(service))
    for view in ("a", "b", "c"):
        for at in (1, 2, 3):
            Dng(width=32 if (view, at) == ("c", 3) else 64).write(tmp_path / view / f"{at}.CR3")
    (tmp_path / "a/3.CR3").write_bytes(Dng().bytes()[:3000])
    assert main(["push", str(tmp_path), *RIG, "--save", "image"]) == 1
    told = capsys.readouterr().err
    assert "3.CR3 is damaged, or ends before the picture does; copy it again from the camera" in told
    assert "3.CR3 has 32 x 48 px, but 2.CR3 has 64 x 48 px" in told
    assert "b: done" in told and "1 of 3 stacks are done" in told and service.made == 1
    assert "it is sent again when a file or an option changes" in told


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Service]:
    binary()
    (tmp_path / "service").mkdir()
    running = Service(tmp_path / "service")
    yield running
    running.kill()


def as_raw(picture: Path, to: Path, **more: Any) -> None:
    """A raw file that shows the green of a picture."""
    with image.open(picture) as opened:
        green = numpy.asarray(opened.convert("RGB"), dtype=float)[:, :, 1] / 255
    light = numpy.where(green <= 0.04045, green / 12.92, ((green + 0.055) / 1.055) ** 2.4)
    height, width = light.shape
    Dng(width, height, lambda x, y: float(light[y, x]), **more).write(to)


def test_the_service_fuses_raw_files_and_keeps_how_they_were_converted(
    own: Service, zips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Client(own.url) as service:
        service.calibrate("bench-1", "macro65", zips / "target.zip", focal_mm=65.0, pixel_pitch_mm=0.02)
    for light in ("front", "back"):
        for picture in sorted((zips / "stack" / light).iterdir()):
            as_raw(picture, tmp_path / "shots/view" / light / f"{picture.stem}.NEF")
            as_raw(picture, tmp_path / "turned/view" / light / f"{picture.stem}.NEF", orientation=8)
    rig = ["--server", own.url, "--rig", "bench-1", "--lens", "macro65", "--quiet-s", "0.05"]
    assert main(["push", str(tmp_path / "shots"), *rig, "-o", "format=tiff", "-o", "bit_depth=auto"]) == 0
    assert main(["push", str(tmp_path / "turned"), *rig]) == 1
    told = capsys.readouterr().err
    assert "orientation" in told, "as JPEG files of a turned camera"
    with Client(own.url) as service:
        stack = next(iter(service.list_stacks()))
        stack = service.get_stack(stack["id"])
    assert stack["state"] == "succeeded", stack
    codes = {warning["code"] for warning in stack["warnings"]}
    assert not codes & {"files_passed_over", "raw_passed_over", "mixed_colour_spaces", "unknown_colour_space"}, codes
    assert stack["metrics"]["alignment"]["residual_p95_px"] < 1
    result = tmp_path / "shots/results/view.tif"
    assert tifffile.imread(result).dtype == numpy.uint16
    with image.open(result) as opened:
        exif = dict(opened.getexif().get_ifd(0x8769))
    comment = exif[0x9286]
    settings = json.loads((comment if isinstance(comment, bytes) else comment.encode())[8:])
    assert settings["white_balance"] == [2.0, 1.0, 1.6, 1.0] and settings["demosaicing"] == "AHD"
    assert exif[42036] == "Macro 65mm f/2.8"
    assert JOB not in told
