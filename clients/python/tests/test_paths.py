r"""Long paths of Windows, as far as another system can show them: prefixes as texts, and that every call uses them."""

from __future__ import annotations

from pathlib import Path, PureWindowsPath

import pytest
from conftest import elsewhere

from pinstack import PinstackError, _paths
from pinstack._zips import FileSource, StoredZip, source
from pinstack.push import sheet
from pinstack.push.bursts import by_bursts
from pinstack.push.folders import find
from pinstack.push.journal import Journal
from pinstack.push.results import missing
from pinstack.push.sender import Outcome
from pinstack.push.settings import load

DEEP = "\\".join(["a folder with a long name"] * 12)


@pytest.mark.parametrize(
    ("path", "long"),
    [
        (r"D:\shots\bee", r"\\?\D:\shots\bee"),
        (r"\\rig-pc\scans\bee", r"\\?\UNC\rig-pc\scans\bee"),
        (r"\\?\D:\shots", r"\\?\D:\shots"),
        (r"\\?\UNC\rig-pc\scans", r"\\?\UNC\rig-pc\scans"),
        (r"\\.\nul", r"\\.\nul"),
    ],
)
def test_drives_and_shares_have_their_own_prefix(path: str, long: str) -> None:
    assert _paths.extended(path) == long
    before, after = PureWindowsPath(path), PureWindowsPath(long)
    assert after.is_absolute() and after.parts[1:] == before.parts[1:], "it is the same place"
    assert (after / "1.jpg").relative_to(after) == PureWindowsPath("1.jpg")


def test_paths_are_shown_without_the_prefix() -> None:
    for path in (r"D:\shots\bee", r"\\rig-pc\scans\bee", "/home/shots", "relative"):
        assert _paths.shown(path) == path
    assert _paths.shown(r"\\?\D:\shots\bee") == r"D:\shots\bee"
    assert _paths.shown(Path(r"\\?\UNC\rig-pc\scans")) == r"\\rig-pc\scans"
    assert _paths.shown(None) == "None"


def test_only_long_paths_on_windows_are_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    short, long = Path(r"D:\shots\bee\1.jpg"), Path(rf"D:\shots\{DEEP}\x\..\1.jpg")
    assert _paths.on_disk(long) == long, "other systems have no such limit"
    monkeypatch.setattr(_paths, "ON_WINDOWS", True)
    assert _paths.on_disk(short) == short
    assert str(_paths.on_disk(long)) == rf"\\?\D:\shots\{DEEP}\1.jpg", "absolute and normalised"
    assert str(_paths.on_disk(Path(rf"\\rig-pc\scans\{DEEP}"))) == rf"\\?\UNC\rig-pc\scans\{DEEP}"
    assert str(_paths.on_disk(Path(f"D:/shots/{DEEP}"))) == rf"\\?\D:\shots\{DEEP}", "slashes mean nothing there"
    # what is written beside a path that is just short is no longer than Windows allows
    at_limit = "D:\\" + "x" * (_paths.LONG_FROM - 4)
    assert str(_paths.on_disk(Path(at_limit))) == at_limit and len(at_limit + ".part") < 248
    assert str(_paths.on_disk(Path(at_limit + "x"))).startswith("\\\\?\\")


def test_folders_are_listed_as_the_system_does(tmp_path: Path) -> None:
    for name in ("a/b/2.jpg", "a/1.jpg", "c/3.jpg"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "a/loop").symlink_to(tmp_path)
    seen = []
    for folder, folders, files in _paths.walk(tmp_path):
        folders.sort()
        seen.append((folder.relative_to(tmp_path).as_posix(), list(folders), files))
        if "c" in folders:
            folders.remove("c")
    assert seen == [(".", ["a", "c"], []), ("a", ["b", "loop"], ["1.jpg"]), ("a/b", [], ["2.jpg"])]
    errors: list[OSError] = []
    assert list(_paths.walk(tmp_path / "missing", errors.append)) == []
    assert isinstance(errors[0], FileNotFoundError)


def test_everything_is_read_and_written_by_the_path_for_calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = elsewhere(tmp_path, monkeypatch)
    disk = _paths.on_disk(root)
    for name in ("v/1.jpg", "v/2.jpg", "manifest.json", ".hidden/1.jpg", "whole.zip"):
        (disk / name).parent.mkdir(parents=True, exist_ok=True)
        (disk / name).write_bytes(b"{}")
    (disk / "rig.toml").write_text('rig = "r"\nlens = "l"\ntoken_file = "%s"\n' % (root / "token"))
    (disk / "token").write_text("t")
    file = load(root / "rig.toml", {}, {}).token_file
    assert file is not None and file.token() == "t"

    view = {
        "name": "v",
        "pan_deg": None,
        "tilt_deg": None,
        "front": ["v/1.jpg", "v/2.jpg"],
        "back": [],
        "problem": None,
    }
    found = find(root, lambda names, manifest: {"views": [view], "ignored": []})
    assert [path for path, _ in found.ignored] == [root / ".hidden"]
    (stack,) = found.stacks
    assert stack.files() == [root / "v/1.jpg", root / "v/2.jpg"], "people see the path that they know"
    assert len(stack.zip().read(0, 10_000)) == stack.zip().length
    assert StoredZip.of_folder(root).length == source(root).length
    assert FileSource(root / "whole.zip").read(0, 9) == b"{}"
    assert by_bursts({"v/1.jpg": root / "v/1.jpg"}, 1.0).unread == []

    journal = Journal(root / "deep/journal")
    journal.note("k", "v", job="/v1/stacks/1")
    journal.close()
    sheet.write([Outcome("v", "done")], root / "results")
    assert (disk / "deep/journal").exists() and (disk / "results/contact-sheet.html").exists()
    (disk / "results/v.png").touch()
    assert missing("v", ["image", "mask"], root / "results") == ["mask"]
    (disk / "v/1.jpg").write_bytes(b"longer")
    with pytest.raises(PinstackError, match="changed while it was sent"):
        stack_zip = stack.zip()
        (disk / "v/1.jpg").write_bytes(b"longer still")
        stack_zip.read(0, 10_000)
    assert not root.exists(), "nothing was written by the path that people see"
