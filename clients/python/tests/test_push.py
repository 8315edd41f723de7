"""``push`` and ``watch`` without a service: times of pictures, the journal, the settings, completeness."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import shutil
import sqlite3
import struct
from collections import Counter
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence

import httpx
import pytest
from fake import JOB, SITE, UPLOAD, Uploads, problem, send

from pinstack import Client, PinstackError, Retry, StoredZip
from pinstack.push import folders, names, settings, sheet
from pinstack.push.bursts import by_bursts, time_taken
from pinstack.push.causes import Again, Site
from pinstack.push.cli import main
from pinstack.push.folders import FoundStack
from pinstack.push.journal import Journal, key_of
from pinstack.push.progress import Progress, duration
from pinstack.push.sender import Outcome, key
from pinstack.push.watch import Complete


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


def succeeds(uploads: Uploads) -> Callable[[httpx.Request], httpx.Response]:
    """A service at which every stack succeeds, without results."""

    def service(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/events"):
            return httpx.Response(204, stream=httpx.ByteStream(b""))
        if request.url.path.startswith("/v1/stacks/"):
            return httpx.Response(200, json={"state": "succeeded", "links": {"self": request.url.path}})
        return uploads(request)

    return service


def find(root: Path) -> List[FoundStack]:
    return folders.find(root, by_folder).stacks


def token(loaded: settings.Settings) -> Optional[str]:
    return loaded.token if loaded.token_file is None else loaded.token_file.token()


def test_a_token_of_the_environment_wins_over_that_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("of the rig")
    file = tmp_path / "rig.toml"
    file.write_text(f'rig = "r"\nlens = "l"\ntoken_file = "{tmp_path}/token"\n')
    assert token(settings.load(file, {}, {})) == "of the rig"
    assert token(settings.load(file, {}, {"PINSTACK_TOKEN": "t"})) == "t"
    assert token(settings.load(file, {"token_file": tmp_path / "token"}, {"PINSTACK_TOKEN": "t"})) == "of the rig"


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


def test_another_service_rig_or_option_is_another_key(tmp_path: Path) -> None:
    files = StoredZip.of_folder(make(tmp_path, "1.jpg"))

    def value(service: str, rig: str, options: Dict[str, Any], server: str = "http://a") -> str:
        return key_of(service, server, rig, "lens", options, files, has_own_label=True).value

    first = value("s", "rig", {"r1": 3})
    assert value("s", "rig", {"r1": 3}, server="https://b") == first, "the address does not count"
    others = [("t", "rig", {"r1": 3}), ("s", "rig2", {"r1": 3}), ("s", "rig", {"r1": 4}),
              ("s", "rig", {"r1": 3, "label": "bee"})]  # fmt: skip
    assert all(value(*other) != first for other in others)


def test_a_stack_is_known_again_by_its_content(tmp_path: Path) -> None:
    root = make(tmp_path / "shots", "v/1.jpg", "v/2.jpg")
    (stack,) = find(root)
    chosen, journal = settings.Settings(save=[]), Journal(tmp_path / "journal")
    uploads = Uploads()
    service = Client("http://rig", transport=httpx.MockTransport(succeeds(uploads)))
    assert send(service, journal, stack, chosen, tmp_path).state == "done"
    # FAT and summer time; a copy by a program that keeps no times; another name of the folder
    for path in stack.files():
        os.utime(path, (1e9, 1e9))
    (root / "v").rename(root / "w")
    (moved,) = find(root)
    assert send(service, journal, moved, chosen, tmp_path).state == "known"
    assert uploads.requests.count("POST") == 1
    # a copy is a stack of its own
    shutil.copytree(root / "w", root / "x")
    copy = next(stack for stack in find(root) if stack.name == "x")
    assert send(service, journal, copy, chosen, tmp_path).state == "done"
    assert uploads.requests.count("POST") == 2
    # the same names and sizes, but another picture
    (root / "w/2.jpg").write_bytes(b"V/2.jpg")
    assert send(service, journal, moved, chosen, tmp_path).state == "done"
    assert uploads.requests.count("POST") == 3
    journal.close()


def test_a_journal_of_an_earlier_version_is_understood(tmp_path: Path) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    for at, path in enumerate(stack.files()):
        os.utime(path, ns=(0, at * 10**9))
    at = tmp_path / "journal"
    rows = sqlite3.connect(at)
    rows.execute("CREATE TABLE stacks (key TEXT PRIMARY KEY, name TEXT, upload TEXT, job TEXT, ended TEXT)")
    # as version 0.1 of before the first release made it for this stack
    sent = ["http://rig", "r", "l", {"label": "v"}, "2-264-af71750a"]
    old = hashlib.sha256(json.dumps(sent, sort_keys=True).encode()).hexdigest()
    rows.execute("INSERT INTO stacks VALUES (?, 'v', NULL, ?, 'done')", (old, JOB))
    rows.commit()
    rows.close()
    journal = Journal(at)
    chosen = settings.Settings(server="http://rig", rig="r", lens="l", save=[])
    assert key(stack, chosen, SITE).earlier == old
    uploads = Uploads()
    service = Client("http://rig", transport=httpx.MockTransport(uploads))
    assert send(service, journal, stack, chosen, tmp_path).state == "known" and uploads.requests == []
    journal.close()


def test_the_command_line_wins_over_the_environment_and_that_over_the_file(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("geheim\n")
    file = tmp_path / "rig.toml"
    file.write_text('server = "http://file"\nrig = "r"\nlens = "l"\njobs = 3\n[options]\nmethod = "guided"\nr1 = 2\n')
    given: Dict[str, Any] = {"rig": "other", "token_file": tmp_path / "token", "options": {"r1": 9}, "jobs": None}
    loaded = settings.load(file, given, {"PINSTACK_URL": "http://environment", "PINSTACK_TOKEN": "x"})
    assert (loaded.server, loaded.rig, loaded.lens, loaded.jobs) == ("http://environment", "other", "l", 3)
    assert loaded.options == {"method": "guided", "r1": 9}
    assert token(loaded) == "geheim" and "geheim" not in repr(loaded)


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


def test_settings_may_begin_with_a_byte_order_mark_and_are_in_utf8(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text('rig = "r"\nlens = "l"\n', "utf-8-sig")
    assert settings.load(file, {}, {}).rig == "r"
    for encoding in ("utf-16", "latin-1"):
        file.write_text('rig = "r"\nlens = "l"\n# Käfer\n', encoding)
        with pytest.raises(PinstackError, match=r"are not in UTF-8 .*save the file as UTF-8"):
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
    outcome = send(service, journal, stack, settings.Settings(), tmp_path)
    # watch tries an incomplete stack again; one that failed only after a change
    assert outcome.state == "incomplete" and "2.jpg cannot be read: another program holds it" in outcome.sentences[0]
    assert outcome.again is Again.LATER
    entry = journal.entry(key(stack, settings.Settings(), SITE).value)
    assert (entry.upload, entry.ended) == (UPLOAD, None), "the upload is continued"
    journal.close()


@pytest.mark.parametrize(
    ("code", "again"),
    [
        ("insufficient_storage", Again.LATER),
        ("internal", Again.LATER),
        ("worker_lost", Again.LATER),
        (None, Again.LATER),
        ("of_a_newer_service", Again.LATER),
        ("invalid_profile", Again.PROFILE),
        ("size_mismatch", Again.PROFILE),
        ("invalid_image", Again.CHANGE),
        ("mask_failed", Again.CHANGE),
    ],
)
def test_only_a_failure_that_follows_from_the_files_is_final(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: Optional[str], again: Again
) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    error = {"code": code, "detail": "it failed"} if code is not None else None
    ended = {"state": "failed" if error else "cancelled", "error": error, "links": {"self": JOB}}
    monkeypatch.setattr(Client, "wait", lambda *_, **__: ended)
    journal, chosen, uploads = Journal(tmp_path / "journal"), settings.Settings(), Uploads()
    service = Client("http://rig", transport=httpx.MockTransport(uploads))

    def outcome(site: Site = SITE) -> Outcome:
        return send(service, journal, stack, chosen, tmp_path, site)

    assert outcome().again is again
    assert outcome().again is again
    assert uploads.requests.count("POST") == (2 if again is Again.LATER else 1)
    assert outcome(Site(SITE.id, "revision 2")).again is again
    assert uploads.requests.count("POST") == {Again.LATER: 3, Again.PROFILE: 2, Again.CHANGE: 1}[again]
    # a person may send it again all the same
    journal.forget_name("v")
    outcome()
    assert uploads.requests.count("POST") == {Again.LATER: 4, Again.PROFILE: 3, Again.CHANGE: 2}[again]
    assert not journal.forget_name("w")
    journal.close()


def test_a_profile_that_changed_while_the_stack_was_queued_is_reason_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    failed = {"state": "failed", "error": {"code": "invalid_profile", "detail": "it failed"}}
    monkeypatch.setattr(Client, "wait", lambda *_, **__: failed)
    journal = Journal(tmp_path / "journal")
    journal.note(key(stack, settings.Settings(), SITE).value, "v", job=JOB, seen="revision 1")
    service = Client("http://rig", transport=httpx.MockTransport(Uploads()))
    outcome = send(service, journal, stack, settings.Settings(), tmp_path, Site(SITE.id, "revision 2"))
    assert outcome.again is Again.LATER
    journal.close()


@pytest.mark.parametrize("code", ["not_found", "unexpected_response"])
def test_only_the_service_can_say_that_a_stack_is_gone(tmp_path: Path, code: str) -> None:
    (stack,) = find(make(tmp_path, "v/1.jpg", "v/2.jpg"))
    answer = problem(404, code, "gone") if code == "not_found" else httpx.Response(404, text="a proxy")
    service = Client("http://rig", transport=httpx.MockTransport(lambda _: answer))
    journal = Journal(tmp_path / "journal")
    at = key(stack, settings.Settings(), SITE).value
    journal.note(at, "v", job=JOB)
    outcome = send(service, journal, stack, settings.Settings(), tmp_path)
    assert (outcome.again, outcome.was_ended) == (Again.LATER, code == "not_found")
    assert journal.entry(at).job == (None if code == "not_found" else JOB)
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


def test_what_is_tried_again_is_said_once_and_until_when() -> None:
    out = io.StringIO()
    progress = Progress(1, out)
    full = PinstackError("queue_full", "the queue is full: 1000 jobs are waiting")
    for _ in range(2):
        for _ in range(3):
            progress.step("bee", "sending", 0.0)
            progress.waits("bee", full, 30.0)
        progress.end(Outcome("bee", "unreachable", ["the queue is full"]), "it is sent again at 12:00:00")
    first, second, third = out.getvalue().splitlines()
    assert first == "bee: sending"
    assert re.fullmatch(r"bee: the queue is full: 1000 jobs are waiting; it is tried again at \d\d:\d\d:\d\d", second)
    assert third == "bee: unreachable: the queue is full; it is sent again at 12:00:00"
    # after a change of the files, all of it is news
    progress.renew("bee")
    progress.step("bee", "waiting", 0.0)
    progress.end(Outcome("bee", "done"))
    assert out.getvalue().splitlines()[3:] == ["bee: waiting", "bee: done"]


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
