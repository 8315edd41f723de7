"""What the client repeats, and what it does with an upload that was refused or has no job yet. Nothing waits."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import httpx
import pytest
from fake import UPLOAD, Uploads, answers, problem, send
from test_network import DATA, client
from test_push import find, make, succeeds

from pinstack import AsyncClient, BytesSource, Client, PinstackError, Retry
from pinstack._http import Response
from pinstack.push.journal import Journal
from pinstack.push.settings import Settings

PROFILE: Dict[str, Any] = {"homographies": [[1, 0, 0, 0, 1, 0, 0, 0, 1]]}


def test_an_upload_that_was_refused_begins_anew_when_it_is_resumed() -> None:
    uploads = Uploads(["refused"])
    begun: List[str] = []
    with pytest.raises(PinstackError, match="is torn"):
        client(uploads).send_stack(DATA, "rig", "lens", on_created=begun.append)
    # what it was refused for is mended: with the same upload it would be refused for ever
    client(uploads).send_stack(DATA, "rig", "lens", resume=UPLOAD, on_created=begun.append)
    assert uploads.stored == DATA and begun == [UPLOAD, UPLOAD]


def test_an_upload_that_is_refused_again_is_begun_anew_once() -> None:
    uploads = Uploads(["refused", "refused"])
    for resume in (None, UPLOAD):
        with pytest.raises(PinstackError, match="is torn") as caught:
            client(uploads).send_stack(b"small", "rig", "lens", resume=resume)
        assert caught.value.status == 422
    assert uploads.requests.count("POST") == 2


def test_another_error_of_an_upload_begins_none() -> None:
    handler, seen = answers(httpx.Response(401), problem(401, "unauthorized", "the token is revoked"))
    with pytest.raises(PinstackError, match="the token is revoked"):
        client(handler).send_stack(DATA, "rig", "lens", resume=UPLOAD)
    assert [request.method for request in seen] == ["HEAD", "GET"]


def test_push_sends_a_refused_stack_again(tmp_path: Path) -> None:
    (stack,) = find(make(tmp_path / "shots", "v/1.jpg", "v/2.jpg"))
    service = client(succeeds(Uploads(["refused"])))
    journal, settings = Journal(tmp_path / "journal"), Settings()
    states = [send(service, journal, stack, settings, tmp_path).state for _ in range(2)]
    assert states == ["refused", "done"]
    journal.close()


def test_what_a_proxy_says_of_an_upload_begins_no_new_one() -> None:
    handler, seen = answers(httpx.Response(404), httpx.Response(404, text="<html>no such page</html>"))
    with pytest.raises(PinstackError) as caught:
        client(handler).send_stack(DATA, "rig", "lens", resume=UPLOAD)
    assert caught.value.code == "unexpected_response" and [request.method for request in seen] == ["HEAD", "GET"]
    handler, seen = answers(httpx.Response(404), problem(404, "not_found", "it expired"), problem(507, "x", "full"))
    with pytest.raises(PinstackError, match="full"):
        client(handler).send_stack(DATA, "rig", "lens", resume=UPLOAD)
    assert [request.method for request in seen] == ["HEAD", "GET", "POST"]


def test_each_wait_is_told_with_its_reason() -> None:
    told: List[Tuple[str, float]] = []
    service = client(Uploads(["lost", "locked", "queue full"]))
    service._transport.on_wait = lambda reason, seconds: told.append((reason.code, seconds))
    service.send_stack(DATA, "rig", "lens")
    assert [code for code, _ in told] == ["unreachable", "locked", "queue_full", "unexpected_response"]


@pytest.mark.parametrize(
    ("status", "offset", "code", "what"),
    [
        (503, len(DATA), "unavailable", "all bytes of the upload are at the service, but its job is not made yet"),
        (507, len(DATA), "insufficient_storage", r"job is not made yet \(status 507: the disk of the service"),
        (423, 4, "locked", r"the service has 4 of 10240 bytes .* \(status 423: another request"),
    ],
)
def test_an_upload_without_a_job_is_not_the_page_of_a_proxy(status: int, offset: int, code: str, what: str) -> None:
    def service(request: httpx.Request) -> httpx.Response:
        if request.method == "HEAD":
            return httpx.Response(status, headers={"retry-after": "0"})
        return httpx.Response(200, json={"offset": offset, "length": len(DATA), "job": None, "error": None})

    with pytest.raises(PinstackError, match=what) as caught:
        client(service).send_stack(DATA, "rig", "lens", resume=UPLOAD)
    assert (caught.value.code, caught.value.status) == (code, status) and "proxy" not in caught.value.detail
    assert caught.value.detail.endswith("run it again later")


def test_a_file_name_that_is_not_valid_text_is_sent() -> None:
    uploads = Uploads()
    client(uploads).send_stack(BytesSource(DATA, "K\udce4fer.zip"), "rig", "lens")
    assert uploads.metadata["filename"] == "K_fer.zip"


def test_the_progress_of_one_request_begins_anew_with_each_try() -> None:
    handler, _ = answers(problem(502, "x", "proxy"), httpx.ReadError("cut off"), httpx.Response(202, json={}))
    told: List[int] = []
    big = BytesSource(bytes(3 << 18))
    client(handler).send_stack(big, "rig", "lens", idempotency_key="k", on_bytes=lambda done, _: told.append(done))
    assert told == [0, 1 << 18, 2 << 18, 3 << 18] * 3


@pytest.mark.parametrize(
    ("answer", "is_repeated"),
    [
        (problem(503, "queue_full", "full", **{"retry-after": "0"}), True),
        (problem(429, "too_many_requests", "256 are in progress", **{"retry-after": "0"}), True),
        # a commit may have happened
        (problem(503, "unavailable", "the database does not answer", **{"retry-after": "0"}), False),
        (problem(502, "x", "proxy"), False),
    ],
)
def test_a_rerun_is_repeated_only_if_the_service_did_nothing(answer: httpx.Response, is_repeated: bool) -> None:
    handler, seen = answers(answer, httpx.Response(202, json={"id": "2"}))
    if is_repeated:
        assert client(handler).rerun_stack("1")["id"] == "2"
    else:
        with pytest.raises(PinstackError):
            client(handler).rerun_stack("1")
    assert len(seen) == 1 + is_repeated


@pytest.mark.parametrize("if_match", [None, '"3"'])
def test_a_profile_whose_response_is_lost_is_not_written_twice(if_match: Optional[str]) -> None:
    pytest.importorskip("numpy")
    handler, seen = answers(httpx.ReadError("cut off"), httpx.Response(200, json={}))
    with pytest.raises(PinstackError) as caught:
        client(handler).put_profile("rig", "lens", PROFILE, if_match=if_match)
    assert caught.value.code == "unreachable" and len(seen) == 1
    handler, seen = answers(httpx.ReadError("cut off"), httpx.Response(200, json={}))
    client(handler).put_scan("bee", "rig", "lens")
    assert len(seen) == 2, "a scan has no revisions"


WRONG: List[Tuple[str, str]] = [
    ("stacker:8080", "'stacker:8080' has no scheme; write http://stacker:8080"),
    ("192.168.1.5:8080/", "'192.168.1.5:8080' has no scheme; write http://192.168.1.5:8080"),
    ("ftp://stacker", "'ftp://stacker' is not that of a web service; write http://HOST:PORT"),
    ("http:/stacker", "'http:/stacker' is not that of a web service"),
    ("http://stacker:port", "'http://stacker:port' is not valid: Invalid port"),
]


@pytest.mark.parametrize(("url", "what"), WRONG)
def test_a_wrong_address_is_told_at_once(url: str, what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for make_client in (Client, AsyncClient):
        with pytest.raises(PinstackError, match=what) as caught:
            make_client(url)
        assert caught.value.code == "invalid_source"
    monkeypatch.setenv("PINSTACK_URL", url)
    with pytest.raises(PinstackError, match=what):
        Client()
    Client("HTTPS://stacker").close()


def test_waits_double_from_the_first_and_a_longer_one_of_the_service_is_respected() -> None:
    retry = Retry(first_s=2.0, longest_s=30.0)
    assert 1.0 <= retry.wait(1) <= 2.0 and 2.0 <= retry.wait(2) <= 4.0 and 15.0 <= retry.wait(99) <= 30.0
    for told, waited in (("90", 90.0), ("9999", 600.0)):
        assert retry.wait(1, Response(503, {"retry-after": told})) == waited
