"""``push`` and ``watch`` as commands, with a service in memory: names of results, exit codes, what is printed."""

from __future__ import annotations

import base64
import io
import json
import os
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Set

import httpx
import pytest
from fake import problem
from test_push import by_folder, make

from pinstack import Client, PinstackError, Retry
from pinstack.push import cli, folders, settings
from pinstack.push.journal import Journal
from pinstack.push.results import missing, save_results

RIG = ["--rig", "r", "--lens", "l", "--server", "http://rig", "--quiet-s", "0"]


class Service:
    """Groups names; every stack succeeds at once, with an image, a mask and a preview, unless told otherwise."""

    def __init__(self, fault: Optional[httpx.Response] = None) -> None:
        #: The answer to everything, and to the bytes of an upload.
        self.fault = fault
        self.fault_of_upload: Optional[httpx.Response] = None
        self.made = self.grouped = 0
        #: What the service has: its identity, and the revision of the profile; 0: none.
        self.id, self.revision = "service-1", 1
        self.group: Callable[[Any], Any] = lambda names: by_folder(names, None)
        #: How stacks end, if not well.
        self.ended: Dict[str, Any] = {}
        #: The labels of stacks, and those that were deleted.
        self.labels: Dict[str, str] = {}
        self.deleted: Set[str] = set()

    def __call__(self, request: httpx.Request) -> httpx.Response:
        path = request.url.path
        if self.fault is not None:
            return self.fault
        if path == "/v1/info":
            return httpx.Response(200, json={"id": self.id, "limits": {}})
        if path == "/v1/profiles":
            items = [{"revision": self.revision}] if self.revision else []
            return httpx.Response(200, json={"items": items, "next_cursor": None})
        if path.startswith("/v1/profiles/"):
            return problem(404, "profile_not_found", "there is no profile for rig 'r' and lens 'l'")
        if path == "/v1/groupings":
            self.grouped += 1
            return httpx.Response(200, json=self.group(json.loads(request.read())["names"]))
        if path.startswith("/v1/uploads"):
            return self.upload(request)
        if path.endswith("/events"):
            return httpx.Response(204, stream=httpx.ByteStream(b""))
        if path in self.deleted:
            return problem(404, "not_found", "there is no such stack")
        name = path.rsplit("/", 1)[1]
        if name in ("image", "mask", "preview"):
            stream = httpx.ByteStream(f"{name} {path}".encode())
            return httpx.Response(200, headers={"etag": '"a"'}, stream=stream)
        artifacts = [{"name": name, "media_type": "image/jpeg"} for name in ("image", "mask", "preview")]
        document = {"state": "succeeded", "links": {"self": path}, "artifacts": artifacts, **self.ended}
        return httpx.Response(200, json=document)

    def upload(self, request: httpx.Request) -> httpx.Response:
        path = request.url.path
        if self.fault_of_upload is not None:
            return self.fault_of_upload
        job = path.replace("uploads", "stacks")
        if request.method == "PATCH":
            return httpx.Response(204, headers={"upload-offset": "9", "pinstack-job": job})
        self.made += 1
        pairs = dict(pair.split(" ") for pair in request.headers["upload-metadata"].split(","))
        self.labels[f"{job}/{self.made}"] = json.loads(base64.b64decode(pairs["options"]))["label"]
        return httpx.Response(201, headers={"location": f"{path}/{self.made}"})


def client(handler: Callable[[httpx.Request], httpx.Response]) -> Client:
    return Client("http://rig", retry=Retry(attempts=2, first_s=0.0), transport=httpx.MockTransport(handler))


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Service:
    own = Service()
    monkeypatch.setattr(cli, "_client", lambda _: client(own))
    return own


def problems(root: Path, *save: str) -> List[Optional[str]]:
    return [stack.problem for stack in folders.find(root, by_folder, save=save or ("image", "mask")).stacks]


@pytest.mark.parametrize(
    ("first", "second", "file"),
    [
        ("view (1)", "view 1", "view_1"),
        ("view 1", "view_1", "view_1"),
        ("Bee (1)", "bee 1", "bee_1"),
        ("bee", "bee_mask", "bee_mask"),
        ("x" * 120 + "1", "x" * 120 + "2", "x" * 120),
    ],
)
def test_of_two_stacks_whose_results_have_one_name_the_later_is_refused(
    tmp_path: Path, first: str, second: str, file: str
) -> None:
    make(tmp_path, f"{first}/1.jpg", f"{first}/2.jpg", f"{second}/1.jpg", f"{second}/2.jpg", "other/1.jpg")
    told = {stack.name: stack.problem for stack in folders.find(tmp_path, by_folder).stacks}
    refused = [name for name, problem in told.items() if problem is not None]
    assert len(refused) == 1 and refused[0] in (first, second)
    sentence = str(told[refused[0]])
    assert first in sentence and second in sentence and file in sentence and "rename" in sentence


def test_only_results_that_are_saved_can_have_one_name(tmp_path: Path) -> None:
    make(tmp_path, "bee/1.jpg", "bee_mask/1.jpg", "bee_depth/1.jpg")
    assert sum(problem is not None for problem in problems(tmp_path, "image")) == 0
    assert sum(problem is not None for problem in problems(tmp_path, "image", "mask", "depth")) == 2
    # the small pictures of the contact sheet have a folder of their own
    assert sum(problem is not None for problem in problems(tmp_path, "mask")) == 0
    make(tmp_path, "bee (1)/1.jpg", "bee 1/1.jpg")
    assert sum(problem is not None for problem in problems(tmp_path)) == 2


def test_a_saved_preview_does_not_replace_the_image(tmp_path: Path) -> None:
    document = {
        "id": "1",
        "artifacts": [{"name": name, "media_type": "image/jpeg"} for name in ("image", "mask", "preview")],
    }
    assert missing("bee", ["image", "preview"], tmp_path) == ["image", "preview"]
    saved = save_results(client(Service()), document, "bee", ["image", "preview"], tmp_path)
    assert [path.name for path in saved] == ["bee.jpg", "bee_preview.jpg"]
    assert (tmp_path / "bee.jpg").read_bytes().startswith(b"image")
    assert (tmp_path / "contact-sheet/bee.jpg").read_bytes().startswith(b"preview")
    (tmp_path / "bee_preview.jpg").unlink()
    assert missing("bee", ["image", "preview"], tmp_path) == ["preview"]


@pytest.mark.parametrize("more", [[], ["--dry-run"]])
@pytest.mark.parametrize(("status", "code"), [(429, 3), (502, 3), (503, 3), (504, 3), (403, 3), (500, 3), (507, 3)])
def test_a_service_that_is_busy_is_no_wrong_usage(
    tmp_path: Path, service: Service, more: List[str], status: int, code: int
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    service.fault = problem(status, "x", "not now", **{"retry-after": "0"})
    assert cli.main(["push", str(tmp_path), *RIG, *more]) == code


@pytest.mark.parametrize("more", [[], ["--dry-run"]])
def test_a_folder_that_cannot_be_listed_is_told_and_is_exit_code_1(
    tmp_path: Path,
    service: Service,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: List[str],
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "locked/1.jpg", "lost+found/1.jpg")
    assert cli.main(["push", str(tmp_path), *RIG, *more]) == 0
    scan = os.scandir

    def refused(path: Any) -> Any:
        if Path(path).name in ("locked", "lost+found"):
            raise PermissionError(13, "Permission denied", str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", refused)
    capsys.readouterr()
    assert cli.main(["push", str(tmp_path), *RIG, *more]) == 1
    told = "".join(capsys.readouterr())
    assert "locked" in told and "cannot be read: Permission denied" in told and "lost+found" not in told


@pytest.mark.parametrize("command", ["push", "watch"])
def test_a_journal_that_cannot_be_made_is_exit_code_2(
    tmp_path: Path, service: Service, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "file")
    # neither a folder below a file nor a file in the place of a folder can be made
    for journal in (tmp_path / "file/journal", tmp_path / "v"):
        assert cli.main([command, str(tmp_path), *RIG, "--journal", str(journal)]) == 2
        told = capsys.readouterr().err
        assert f"the journal {journal} cannot be written" in told and "choose another place with --journal" in told
    assert service.made == 0


def test_a_journal_on_a_share_that_is_read_only_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", refused)
    with pytest.raises(PinstackError, match="cannot be written: Read-only file system; choose another place"):
        Journal(tmp_path / "journal")


def test_a_log_that_cannot_be_written_is_exit_code_2(
    tmp_path: Path, service: Service, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg")
    log = tmp_path / "nowhere/watch.log"
    assert cli.main(["watch", str(tmp_path), *RIG, "--log", str(log)]) == 2
    assert f"the log {log} cannot be written" in capsys.readouterr().err
    Journal(tmp_path / ".pinstack-journal").close()


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_a_dry_run_prints_every_name(
    tmp_path: Path, service: Service, monkeypatch: pytest.MonkeyPatch, encoding: str
) -> None:
    make(tmp_path, "v/1.jpg", "v/2.jpg", "虫/1.jpg", "虫/2.jpg")
    (tmp_path / "K\udce4fer.jpg").touch()
    out = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", out)
    assert cli.main(["push", str(tmp_path), *RIG, "--dry-run"]) == 0
    out.seek(0)
    told = out.read()
    assert "K\\udce4fer.jpg" in told and ("虫" if encoding == "utf-8" else "\\u866b") in told


def test_a_folder_whose_name_is_not_valid_text_names_its_stack(tmp_path: Path, service: Service) -> None:
    root = make(tmp_path / "K\udce4fer", "1.jpg", "2.jpg")

    def one(names: Any, manifest: Any) -> Any:
        return {"views": [{**by_folder(names, None)["views"][0], "name": ""}], "ignored": []}

    (stack,) = folders.find(root, one).stacks
    assert stack.name == "K_fer"


def test_only_what_is_written_as_json_writes_numbers_is_a_number() -> None:
    for text, value in (("0", 0), ("-12", -12), ("0.50", 0.5), ("1e-5", 1e-5), ("2E3", 2000.0)):
        read = settings.option(f"r1={text}")["r1"]
        assert read == value and type(read) is type(value)
    for text in ("007", "1_000", "nan", "inf", "+1", "1.", ".5", " 1", "٣"):
        assert settings.option(f"r1={text}") == {"r1": text}
    for name in ("label", "scan"):
        for text in ("7", "1.50", "true"):
            assert settings.option(f"{name}={text}") == {name: text}


def test_every_setting_is_named(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text("colour = 1")
    with pytest.raises(PinstackError, match="token_file"):
        settings.load(file, {}, {})
