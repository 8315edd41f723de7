"""``push`` and ``watch`` without a service: times of pictures, the journal, the settings, completeness."""

from __future__ import annotations

import io
import os
import re
import struct
import threading
from collections import Counter
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Dict, List, Mapping, Optional, Sequence

import httpx
import pytest
from fake import JOB, UPLOAD, Uploads

from pinstack import Client, PinstackError, Retry
from pinstack.push import folders, names, settings, sheet
from pinstack.push.bursts import by_bursts, time_taken
from pinstack.push.cli import main
from pinstack.push.folders import FoundStack
from pinstack.push.journal import Journal, key_of
from pinstack.push.progress import Progress, duration
from pinstack.push.sender import Outcome, key, send
from pinstack.push.watch import Complete, wait_until_quiet


def make(root: Path, *names: str) -> Path:
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(name.encode())
    return root


def by_folder(names: Sequence[str], manifest: Optional[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Groups names as the service does those of folders with front light alone."""
    views: Dict[str, List[str]] = {}
    for name in names:
        views.setdefault(str(PurePosixPath(name).parent), []).append(name)
    shown = [
        {"name": view, "pan_deg": None, "tilt_deg": None, "front": front, "back": [], "problem": None}
        for view, front in views.items()
    ]
    return {"views": shown, "ignored": [], "warnings": []}


def find(root: Path) -> List[FoundStack]:
    return folders.find(root, by_folder).stacks


def test_a_token_of_the_environment_wins_over_that_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("of the rig")
    file = tmp_path / "rig.toml"
    file.write_text(f'rig = "r"\nlens = "l"\ntoken_file = "{tmp_path}/token"\n')
    assert settings.load(file, {}, {}).token == "of the rig"
    assert settings.load(file, {}, {"PINSTACK_TOKEN": "t"}).token == "t"
    assert settings.load(file, {"token_file": tmp_path / "token"}, {"PINSTACK_TOKEN": "t"}).token == "of the rig"


def test_of_two_stacks_with_one_name_the_later_is_refused(tmp_path: Path) -> None:
    first, second = find(make(tmp_path, "a/b/1.jpg", "a/b/2.jpg", "A_b/1.jpg", "A_b/2.jpg"))
    assert first.problem is None and second.problem is not None and "the same name" in second.problem


def test_a_view_of_a_manifest_without_pictures_is_no_stack(tmp_path: Path) -> None:
    def empty(names: Sequence[str], manifest: Optional[Mapping[str, Any]]) -> Mapping[str, Any]:
        view = {"name": "v", "pan_deg": None, "tilt_deg": None, "front": [], "back": [], "problem": "no slices"}
        return {"views": [view], "ignored": []}

    found = folders.find(make(tmp_path, "1.jpg"), empty)
    assert found.stacks == [] and "has no picture" in found.ignored[0][1]


def test_stacks_whose_names_meet_become_complete(tmp_path: Path) -> None:
    make(tmp_path, "a/b/1.jpg", "a/b/2.jpg", "a_b/1.jpg", "a_b/2.jpg")
    complete = Complete(0.0, lambda: 0.0)
    complete.of(find(tmp_path))
    assert len(complete.of(find(tmp_path))) == 2


@pytest.mark.parametrize("name", ["con", "AUX.1", "a:b", "x?*", "..", "nul", "Bücher 3", "a/b", "trailing. "])
def test_result_names_are_allowed_on_windows(name: str) -> None:
    safe = names.safe_name(name)
    assert safe and not PureWindowsPath(f"{safe}.png").is_reserved()
    assert PureWindowsPath("D:/results", safe).name == safe and not re.search(r'[<>:"/\\|?*]', safe)
    assert not safe.endswith((".", " "))


def test_a_journal_survives_and_is_used_by_one_process_at_a_time(tmp_path: Path) -> None:
    at = tmp_path / "deep/journal"
    journal = Journal(at)
    journal.note("k", "bee", upload="/v1/uploads/1")
    with pytest.raises(PinstackError, match="another push or watch"):
        Journal(at)
    journal.note("k", "bee", job="/v1/stacks/1")
    journal.close()
    again = Journal(at)
    entry = again.entry("k")
    assert (entry.upload, entry.job, entry.ended) == ("/v1/uploads/1", "/v1/stacks/1", None)
    again.forget("k")
    assert again.entry("k").upload is None
    again.close()
    at.write_bytes(b"no journal at all, but long enough to have a header" * 40)
    with pytest.raises(PinstackError, match="damaged"):
        Journal(at)


def test_another_service_rig_or_option_is_another_key() -> None:
    first = key_of("http://a", "rig", "lens", {"r1": 3}, "f")
    assert key_of("http://a/", "rig", "lens", {"r1": 3}, "f") == first
    others = [("http://b", "rig", "lens", {"r1": 3}), ("http://a", "rig2", "lens", {"r1": 3}),
              ("http://a", "rig", "lens", {"r1": 4})]  # fmt: skip
    assert all(key_of(*other, "f") != first for other in others)


def test_the_command_line_wins_over_the_environment_and_that_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("geheim\n")
    file = tmp_path / "rig.toml"
    file.write_text('server = "http://file"\nrig = "r"\nlens = "l"\njobs = 3\n[options]\nmethod = "guided"\nr1 = 2\n')
    given: Dict[str, Any] = {"rig": "other", "token_file": tmp_path / "token", "options": {"r1": 9}, "jobs": None}
    loaded = settings.load(file, given, {"PINSTACK_URL": "http://environment", "PINSTACK_TOKEN": "x"})
    assert (loaded.server, loaded.rig, loaded.lens, loaded.jobs) == ("http://environment", "other", "l", 3)
    assert loaded.options == {"method": "guided", "r1": 9}
    assert loaded.token == "geheim" and "geheim" not in repr(loaded)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('rig = "r"', "lens is missing"),
        ('rig = "r"\nlens = "l"\ncolour = 1', "no setting 'colour'"),
        ('rig = "r"\nlens = "l"\njobs = 99', "jobs is 99"),
        ('rig = "r"\nlens = "l"\njobs = "two"', "wrong type"),
        ('rig = "r"\nlens = "l"\nsave = ["photo"]', "no artifact 'photo'"),
        ("rig = ", "not valid TOML"),
    ],
)
def test_wrong_settings_are_named(tmp_path: Path, text: str, what: str) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(text)
    with pytest.raises(PinstackError, match=re.escape(what)):
        settings.load(file, {}, {})


def test_options_are_numbers_where_they_look_like_numbers() -> None:
    assert settings.option("r1=30") == {"r1": 30}
    assert settings.option("mask_threshold=0.5") == {"mask_threshold": 0.5}
    assert settings.option("method=pyramid") == {"method": "pyramid"}
    with pytest.raises(PinstackError):
        settings.option("method")


def test_a_stack_is_complete_after_a_time_without_a_change(tmp_path: Path) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    now = [0.0]
    complete = Complete(20.0, lambda: now[0])

    def ready() -> List[str]:
        return [stack.name for stack in complete.of(find(tmp_path))]

    assert ready() == []
    now[0] = 15.0
    make(tmp_path, "v/3.jpg")
    assert ready() == []
    now[0] = 30.0
    assert ready() == []
    now[0] = 35.0
    assert ready() == ["v"]


def test_a_file_that_another_program_holds_makes_a_stack_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    opened = Path.open
    held = [True]

    def open_unless_held(path: Path, *arguments: Any, **options: Any) -> Any:
        if held[0] and path.name == "2.jpg":
            # what Windows says of a sharing violation
            error = PermissionError(13, "The process cannot access the file", str(path))
            error.winerror = 32  # type: ignore[attr-defined]
            raise error
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", open_unless_held)
    complete = Complete(0.0, lambda: 0.0)
    assert complete.of(find(tmp_path)) == []
    held[0] = False
    assert [stack.name for stack in complete.of(find(tmp_path))] == ["v"]


def test_a_stack_of_which_a_slice_is_held_while_it_is_sent_is_incomplete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    uploads = Uploads()
    service = Client("http://rig", retry=Retry(attempts=3, first_s=0.0), transport=httpx.MockTransport(uploads))
    opened = Path.open

    def held(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == "2.jpg":
            raise PermissionError(13, "The process cannot access the file", str(path))
        return opened(path, *arguments, **options)

    journal = Journal(tmp_path / "journal")
    monkeypatch.setattr(Path, "open", held)
    outcome = send(service, journal, stack, settings.Settings(), tmp_path, lambda *step: None)
    # watch tries an incomplete stack again; one that failed only after a change
    assert outcome.state == "incomplete" and "2.jpg cannot be read: another program holds it" in outcome.sentences[0]
    entry = journal.entry(key(stack, settings.Settings()))
    assert (entry.upload, entry.ended) == (UPLOAD, None), "the upload is continued"
    journal.close()


@pytest.mark.parametrize("code, is_sent_again", [("insufficient_storage", True), ("invalid_image", False)])
def test_only_a_stack_that_failed_because_of_the_machine_is_sent_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, is_sent_again: bool
) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    failed = {"state": "failed", "error": {"code": code, "detail": "it failed"}}
    monkeypatch.setattr(Client, "wait", lambda *_, **__: failed)
    journal = Journal(tmp_path / "journal")
    at = key(stack, settings.Settings())
    journal.note(at, "v", job=JOB)
    service = Client("http://rig", transport=httpx.MockTransport(Uploads()))
    outcome = send(service, journal, stack, settings.Settings(), tmp_path, lambda *step: None)
    assert (outcome.state, outcome.sentences[0]) == ("failed", "it failed")
    assert journal.entry(at).job == (None if is_sent_again else JOB)
    journal.close()


def test_a_burst_waits_for_a_picture_that_another_program_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for second in (0, 1, 20, 21):
        path = tmp_path / f"bee/IMG_{second:04d}.jpg"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(jpeg(exif(b"2026:01:01 12:00:%02d" % second)))
    make(tmp_path, "wasp/1.jpg", "wasp/2.jpg")
    opened = Path.open

    def held(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.name == "IMG_0021.jpg":
            raise PermissionError(13, "The process cannot access the file", str(path))
        return opened(path, *arguments, **options)

    def problems() -> Dict[str, Optional[str]]:
        return {stack.view: stack.problem for stack in folders.find(tmp_path, by_folder, gap_s=10.0).stacks}

    monkeypatch.setattr(Path, "open", held)
    waiting = problems()
    assert set(waiting) == {"bee/0001", "bee/0002"}
    assert all("IMG_0021.jpg cannot be read" in str(problem) for problem in waiting.values()), waiting
    monkeypatch.setattr(Path, "open", opened)
    assert set(problems().values()) == {None}


def test_wrong_usage_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["push", str(tmp_path / "nothing")]) == 2
    assert "is not a folder" in capsys.readouterr().err
    assert main(["push", str(tmp_path)]) == 2
    assert "rig is missing" in capsys.readouterr().err
    assert main(["push", str(tmp_path), "--rig", "r", "--lens", "l"]) == 2
    assert "no stack" in capsys.readouterr().err
    assert main(["push", str(tmp_path), "--rig", "r", "--lens", "l", "-n", "z=1"]) == 2
    assert "no rule 'z'" in capsys.readouterr().err


@pytest.mark.parametrize("more", [[], ["--dry-run"]])
def test_a_service_that_is_not_there_is_exit_code_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: List[str]
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    from pinstack.push import cli

    monkeypatch.setattr(cli, "_client", lambda settings: Client(settings.server, retry=Retry(attempts=1)))
    arguments = ["push", str(tmp_path), "--rig", "r", "--lens", "l", "--server", "http://127.0.0.1:9"]
    assert main([*arguments, *more]) == 3


def test_files_that_are_still_being_written_are_waited_for(tmp_path: Path) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    stop = threading.Event()
    stop.set()
    assert not wait_until_quiet(stack, 1000.0, stop), "the files are young"
    for path in stack.files():
        os.utime(path, (1e9, 1e9))
    assert wait_until_quiet(stack, 1000.0, threading.Event()), "files of yesterday are complete"
    make(tmp_path, "v/1.jpg")
    assert wait_until_quiet(stack, 0.05, threading.Event()), "nothing changes any more"
    stack.files()[0].unlink()
    assert not wait_until_quiet(stack, 0.01, threading.Event())


def exif(taken: bytes, fraction: bytes = b"", order: str = "<") -> bytes:
    """EXIF data with the time at which a picture was taken."""
    entries = [(0x9003, 2, taken + b"\0")] + ([(0x9291, 2, fraction + b"\0")] if fraction else [])
    directory = 26
    texts = directory + 2 + 12 * len(entries) + 4
    packed, data = b"", b""
    for tag, kind, value in entries:
        place = value.ljust(4, b"\0") if len(value) <= 4 else struct.pack(order + "I", texts + len(data))
        packed += struct.pack(order + "HHI", tag, kind, len(value)) + place
        data += value if len(value) > 4 else b""
    head = (b"II" if order == "<" else b"MM") + struct.pack(order + "HI", 42, 8)
    outer = struct.pack(order + "HHHIII", 1, 0x8769, 4, 1, directory, 0)
    return head + outer + struct.pack(order + "H", len(entries)) + packed + bytes(4) + data


def jpeg(data: bytes) -> bytes:
    """The head of a JPEG with these EXIF data."""
    comment = b"\xff\xfe" + struct.pack(">H", 7) + b"hello"
    segment = b"Exif\0\0" + data
    return b"\xff\xd8" + comment + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + b"\xff\xda\0\2"


def test_the_time_of_a_picture_is_read_from_its_exif_data(tmp_path: Path) -> None:
    noon = 1767268800.0
    file = tmp_path / "a.jpg"
    for order in "<>":
        data = exif(b"2026:01:01 12:00:00", b"25", order)
        for picture in (jpeg(data), data):
            file.write_bytes(picture)
            assert time_taken(file) == noon + 0.25
            for cut in range(0, len(picture) - 6, 3):
                file.write_bytes(picture[:cut])
                assert time_taken(file) in (None, noon + 0.25, noon + 0.2, noon), "torn, but not a wrong time"
    for other in (jpeg(exif(b"0000:00:00 00:00:00")), jpeg(b"II*\0\xff\xff\xff\xff"), b"\x89PNG", b""):
        file.write_bytes(other)
        assert time_taken(file) is None


def test_a_pause_between_pictures_begins_a_stack(tmp_path: Path) -> None:
    names: Dict[str, Path] = {}
    for folder in ("bee/front", "bee/back"):
        for at, second in enumerate((0, 1, 2, 20, 21, 22, 59)):
            path = tmp_path / folder / f"IMG_{9998 + at if at < 2 else at:04d}.jpg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(jpeg(exif(b"2026:01:01 12:00:%02d" % second)))
            names[f"{folder}/{path.name}"] = path
    names["bee/png/1.png"] = make(tmp_path, "bee/png/1.png") / "bee/png/1.png"
    names["bee/notes.txt"] = tmp_path / "bee/notes.txt"
    bursts = by_bursts(names, 10.0)
    counts = Counter(str(PurePosixPath(name).parent) for name in bursts.names)
    of_light = {"0001": 3, "0002": 3, "0003": 1}
    expected = {f"bee/{light}/{burst}": n for light in ("front", "back") for burst, n in of_light.items()}
    assert counts == {**expected, "bee": 1}
    assert [path.name for path, _ in bursts.untimed] == ["1.png"]
    assert "bee/front/IMG_9998.jpg" in by_bursts(names, 100.0).names, "one burst stays as it is"
    (tmp_path / "bee/png/1.png").unlink()

    def in_one_folder(names: Sequence[str], manifest: Optional[Mapping[str, Any]]) -> Mapping[str, Any]:
        return by_folder([name for name in names if "front/0001/" in name], manifest)

    (stack,) = folders.find(tmp_path, in_one_folder, gap_s=10.0).stacks
    # by time: the camera counted 9998, 9999, 0002
    assert [member.name for member in stack.zip().members] == [
        "front/00001_IMG_9998.jpg",
        "front/00002_IMG_9999.jpg",
        "front/00003_IMG_0002.jpg",
    ]


def test_slices_of_several_folders_and_of_a_manifest_keep_their_order(tmp_path: Path) -> None:
    make(tmp_path, "a/1.jpg", "b/1.jpg")

    def together(names: Sequence[str], manifest: Optional[Mapping[str, Any]]) -> Mapping[str, Any]:
        view = {"name": "v", "pan_deg": None, "tilt_deg": None, "back": [], "problem": None}
        return {"views": [{**view, "front": list(reversed(names[-2:]))}], "ignored": []}

    (stack,) = folders.find(tmp_path, together).stacks
    assert [(member.name, member.path.parent.name) for member in stack.zip().members] == [
        ("front/00001_1.jpg", "b"),
        ("front/00002_1.jpg", "a"),
    ]
    make(tmp_path, "manifest.json", "b/2.jpg")
    with pytest.raises(PinstackError, match="cannot be read as JSON"):
        folders.find(tmp_path, together)
    (tmp_path / "manifest.json").write_text('{"views": []}')
    (stack,) = folders.find(tmp_path, together).stacks
    assert [member.name for member in stack.zip().members] == ["front/00001_2.jpg", "front/00002_1.jpg"]


def test_without_a_terminal_every_event_is_a_line() -> None:
    out = io.StringIO()
    progress = Progress(2, out)
    for share in (0.0, 0.5, 1.0):
        progress.step("bee", "sending", share)
    progress.end(Outcome("bee", "refused", ["the profile has 9 slices"]))
    assert out.getvalue() == "bee: sending\nbee: refused: the profile has 9 slices\n"


@pytest.mark.parametrize(("seconds", "text"), [(45, "45 s"), (180, "3 min"), (7500, "2 h 05 min")])
def test_durations_are_short(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_the_contact_sheet_shows_every_stack_and_escapes_names(tmp_path: Path) -> None:
    make(tmp_path, "contact-sheet/bee.png")
    metrics = {"fusion": {"sharpness_retention": 0.953}, "alignment": {"residual_p95_px": 0.12}}
    good = Outcome("bee", "done", stack={"metrics": metrics})
    page = sheet.write([good, Outcome("<b>", "failed", ["a & b"])], tmp_path).read_text("utf-8")
    assert 'src="contact-sheet/bee.png"' in page and "sharpness 0.95, residual 0.12 px" in page
    assert "&lt;b&gt;" in page and "a &amp; b" in page and "<b><b>" not in page
