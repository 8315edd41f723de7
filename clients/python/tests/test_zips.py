"""The zip that is made while it is read."""

from __future__ import annotations

import io
import os
import random
import re
import shutil
import struct
import subprocess
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path, PureWindowsPath
from typing import Dict, Tuple

import pytest
from conftest import PROJECT

from pinstack import BytesSource, Member, PinstackError, StoredZip, _zips
from pinstack._zips import SKIPPED_FOLDERS, member_name, source, with_moved

FILES: Dict[str, bytes] = {
    "front/1.jpg": b"one" * 1000,
    "front/2.jpg": b"",
    "front/10.JPG": bytes(range(256)) * 9,
    "back/1.jpg": b"1",
    "back/hélène 小.tif": b"\0" * 5000,
    "manifest.json": b"{}",
}


def write(folder: Path) -> Path:
    for name, data in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


def whole(zipped: StoredZip) -> bytes:
    return b"".join(zipped.blocks())


def from_the_front(data: bytes) -> Dict[str, bytes]:
    """The members as a reader of a stream finds them: by local headers, and by sizes and CRC after the data."""
    found: Dict[str, bytes] = {}
    at = 0
    while data[at : at + 4] == b"PK\3\4":
        version, flags, method = struct.unpack_from("<3H", data, at + 4)
        name_length, extra_length = struct.unpack_from("<2H", data, at + 26)
        name = data[at + 30 : at + 30 + name_length].decode()
        start = at + 30 + name_length + extra_length
        extra = data[start - extra_length : start]
        layout = "<IQQ" if extra else "<III"
        assert (version, flags, method) == (45 if extra else 20, 0x0808, 0) and extra[:4] in (b"", b"\1\0\x10\0")
        end = start + len(FILES[name])
        crc, packed, size = struct.unpack_from(layout, data, end + 4)
        assert data[end : end + 4] == b"PK\7\x08" and packed == size == len(FILES[name])
        found[name] = data[start:end]
        assert crc == zlib.crc32(found[name])
        at = end + 4 + struct.calcsize(layout)
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write(tmp_path / "view")


@pytest.mark.parametrize("zip64_from", [_zips.LIMIT, 2000, 0])
def test_zipfile_and_7z_read_what_was_zipped(folder: Path, monkeypatch: pytest.MonkeyPatch, zip64_from: int) -> None:
    monkeypatch.setattr(_zips, "ZIP64_FROM", zip64_from)
    data = whole(StoredZip.of_folder(folder))
    with zipfile.ZipFile(io.BytesIO(data)) as read:
        assert read.testzip() is None
        assert {name: read.read(name) for name in read.namelist()} == FILES
    assert from_the_front(data) == FILES
    if shutil.which("7z"):
        path = folder.parent / "made.zip"
        path.write_bytes(data)
        told = subprocess.run(["7z", "t", str(path)], capture_output=True, text=True, check=True).stdout
        assert "Everything is Ok" in told and "arning" not in told, told


@pytest.mark.parametrize("zip64_from", [_zips.LIMIT, 2000])
def test_the_length_is_known_before_and_every_offset_gives_the_same_bytes(
    folder: Path, monkeypatch: pytest.MonkeyPatch, zip64_from: int
) -> None:
    monkeypatch.setattr(_zips, "ZIP64_FROM", zip64_from)
    data = whole(StoredZip.of_folder(folder))
    assert StoredZip.of_folder(folder).length == len(data)
    for offset in range(0, len(data), 61):
        # a new process: nothing was read before
        assert b"".join(StoredZip.of_folder(folder).blocks(offset)) == data[offset:], offset
    pieces = random.Random(1)
    once = StoredZip.of_folder(folder)
    for _ in range(500):
        offset, size = pieces.randrange(len(data)), pieces.randrange(1, 9000)
        assert once.read(offset, size) == data[offset : offset + size]
    assert once.read(len(data), 10) == b""


def test_more_members_than_16_bits_count(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(b"x")
    one = Member.of(path, "a.jpg")
    zipped = StoredZip(replace(one, name=f"{i}.jpg") for i in range(66_000))
    with zipfile.ZipFile(io.BytesIO(whole(zipped))) as read:
        assert len(read.namelist()) == 66_000


def test_only_pictures_and_manifests_are_sent(folder: Path) -> None:
    for name in ["Thumbs.db", "front/.hidden.jpg", "__MACOSX/front/1.jpg", "front/1.CR2", ".git/x.jpg"]:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"x")
    assert sorted(member.name for member in StoredZip.of_folder(folder).members) == sorted(FILES)


def test_a_file_that_changes_is_not_sent(folder: Path) -> None:
    for data in [b"shorter", b"one" * 1001]:
        zipped = StoredZip.of_folder(folder)
        (folder / "front/1.jpg").write_bytes(data)
        with pytest.raises(PinstackError, match=r"1\.jpg changed while it was sent") as caught:
            whole(zipped)
        assert caught.value.code == "source_changed"
        write(folder)


def test_content_names_and_times_are_told_apart(folder: Path) -> None:
    def texts() -> Tuple[str, str, str]:
        zipped = StoredZip.of_folder(folder)
        return zipped.shape(), zipped.times(), zipped.content()

    first = texts()
    assert texts() == first
    os.utime(folder / "front/1.jpg", ns=(1, 1))
    touched = texts()
    assert (touched[0], touched[2]) == (first[0], first[2]) and touched[1] != first[1]
    data = (folder / "front/1.jpg").read_bytes()
    (folder / "front/1.jpg").write_bytes(bytes(reversed(data)))
    os.utime(folder / "front/1.jpg", ns=(1, 1))
    changed = texts()
    assert changed[:2] == touched[:2] and changed[2] != first[2], "neither its size nor its time tells"
    (folder / "front/1.jpg").rename(folder / "front/3.jpg")
    assert texts()[0] != first[0]


def test_the_content_of_a_zip_that_was_read_costs_no_second_reading(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zipped = StoredZip.of_folder(folder)
    whole(zipped)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("it was read again")

    expected = StoredZip.of_folder(folder).content()
    monkeypatch.setattr(Path, "open", refuse)
    assert zipped.content() == expected


def test_the_service_the_page_and_the_client_skip_the_same_folders() -> None:
    rust = (PROJECT / "science/src/archive/member_names.rs").read_text("utf-8")
    script = (PROJECT / "src/http/pages/assets/files.js").read_text("utf-8")
    lists = []
    for text, quote in ((rust, '"'), (script, "'")):
        listed = re.search(r"SKIPPED_FOLDERS(?:: \[&str; \d+\])? = \[(.*?)\];", text, re.DOTALL)
        assert listed is not None, "the list has another form"
        lists.append(set(re.findall(f"{quote}([^{quote}]+){quote}", listed[1])))
    assert lists == [SKIPPED_FOLDERS, SKIPPED_FOLDERS]


def test_nothing_below_a_folder_of_a_file_server_is_sent(folder: Path) -> None:
    for name in [*SKIPPED_FOLDERS, "@eaDir", "#recycle/front", ".@__thumb", ".AppleDouble", ".Trashes", ".thumbnails"]:
        at = folder / "front" / name / "1.jpg"
        at.parent.mkdir(parents=True, exist_ok=True)
        at.write_bytes(b"x")
    assert sorted(member.name for member in StoredZip.of_folder(folder).members) == sorted(FILES)


def test_lists_and_mappings_become_lights(folder: Path) -> None:
    front = [folder / "front/1.jpg", str(folder / "front/2.jpg")]
    sent = source({"front": front, "back": [folder / "back/1.jpg"]})
    assert isinstance(sent, StoredZip)
    assert [member.name for member in sent.members] == ["back/1.jpg", "front/1.jpg", "front/2.jpg"]
    listed = source(front)
    assert isinstance(listed, StoredZip) and [m.name for m in listed.members] == ["front/1.jpg", "front/2.jpg"]
    assert isinstance(source(b"PK"), BytesSource)


def test_a_moved_target_is_a_folder_beside_the_slices(folder: Path, tmp_path: Path) -> None:
    slices, one = [folder / "front/1.jpg", folder / "front/2.jpg"], folder / "back/1.jpg"
    for moved in (one, [str(one)], folder / "back"):
        names = [member.name for member in with_moved(slices, moved).members]
        assert names[:2] == ["front/1.jpg", "front/2.jpg"] and names[2] == "moved/1.jpg"
    sent = [member.name for member in with_moved(folder / "front", one).members]
    assert sent == ["1.jpg", "10.JPG", "2.jpg", "moved/1.jpg"]
    (tmp_path / "target.zip").write_bytes(b"PK")
    with pytest.raises(PinstackError, match="the folder 'moved' into the zip"):
        with_moved(tmp_path / "target.zip", one)


def test_what_cannot_be_sent_is_refused_with_the_reason(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    for wrong, reason in [
        (tmp_path / "empty", "holds no JPEG"),
        ([], "is empty"),
        (folder / "front/1.jpg", "is one picture"),
        ([folder / "front/1.jpg", folder / "back/1.jpg"], "the same name"),
        ({"left wing": []}, "not 'left wing'"),
        ({"front": [folder / "front/1.jpg"], "left": []}, "light 'left' is empty"),
    ]:
        with pytest.raises(PinstackError, match=reason) as caught:
            source(wrong)
        assert caught.value.code == "invalid_source"
    with pytest.raises(FileNotFoundError):
        source(tmp_path / "missing.zip")


def test_names_in_the_zip_have_slashes_on_windows_too() -> None:
    folder = PureWindowsPath(r"D:\Captures\beetle")
    path = PureWindowsPath(r"d:\captures\BEETLE\pan020\front\IMG_0001.JPG")
    assert member_name(path.relative_to(folder)) == "pan020/front/IMG_0001.JPG"
    share = PureWindowsPath(r"\\rig-pc\scans\view\back\1.tif")
    assert member_name(share.relative_to(r"\\rig-pc\scans\view")) == "back/1.tif"


def test_a_further_light_is_a_folder_of_its_name_and_a_wrong_name_is_refused(tmp_path: Path) -> None:
    folder = write(tmp_path)
    zipped = source({"front": [folder / "front/1.jpg"], "led_2": [folder / "front/2.jpg"]})
    assert isinstance(zipped, StoredZip)
    assert [member.name for member in zipped.members] == ["front/1.jpg", "led_2/2.jpg"]
    for name in ("u v", "../x", "", "a" * 33):
        with pytest.raises(PinstackError, match="letters, digits"):
            source({"front": [folder / "front/1.jpg"], name: [folder / "front/2.jpg"]})
