"""What the client does when the line, the service or the disk fails. No service runs, and nothing waits."""

from __future__ import annotations

import asyncio
import pickle
from pathlib import Path
from typing import Any, Callable, List, Tuple

import httpx
import pytest
from fake import JOB, UPLOAD, Uploads, answers, problem

from pinstack import AsyncClient, BytesSource, Client, PinstackError, Retry, Source

NOW = Retry(attempts=4, first_s=0.0)
DATA = bytes(range(256)) * 40


def client(handler: Callable[[httpx.Request], httpx.Response], **options: Any) -> Client:
    return Client("http://rig", retry=NOW, piece_bytes=1000, transport=httpx.MockTransport(handler), **options)


def test_an_upload_tells_what_it_is_and_counts_its_bytes() -> None:
    uploads = Uploads()
    told: List[Tuple[int, int]] = []
    created: List[str] = []
    sent = client(uploads).send_stack(
        BytesSource(DATA, "beetle.zip"), "rig", "lens", on_bytes=lambda *bytes: told.append(bytes),
        on_created=created.append, label="Käfer", pan_deg=20.5,
    )  # fmt: skip
    assert sent["id"] == "0190-job" and uploads.stored == DATA and created == [UPLOAD]
    assert uploads.metadata == {
        "rig": "rig", "lens": "lens", "filename": "beetle.zip", "options": '{"label": "K\\u00e4fer", "pan_deg": 20.5}',
    }  # fmt: skip
    assert told[0] == (0, len(DATA)) and told[-1] == (len(DATA), len(DATA)) and told == sorted(told)


@pytest.mark.parametrize("fault", ["lost", "no connection", "damaged", "locked", "response lost"])
def test_an_upload_goes_on_where_the_service_is_after_a_failure(fault: str) -> None:
    # more failures than attempts: they count anew whenever bytes arrived
    uploads = Uploads(["", fault, fault, "", fault, fault, "", fault, fault])
    client(uploads).send_stack(DATA, "rig", "lens")
    assert uploads.stored == DATA and uploads.faults == []
    assert uploads.requests.count("POST") == 1


def test_the_last_response_is_lost_and_there_is_one_stack() -> None:
    uploads = Uploads(["response lost"])
    assert client(uploads).send_stack(b"small", "rig", "lens")["path"] == JOB
    assert uploads.requests == ["POST", "PATCH", "HEAD", "GET"]


def test_an_upload_waits_for_a_full_queue() -> None:
    uploads = Uploads(["queue full"])
    client(uploads).send_stack(b"small", "rig", "lens")
    assert uploads.requests == ["POST", "PATCH", "HEAD", "HEAD", "GET"]


def test_a_refusal_is_raised_at_once_with_its_sentence() -> None:
    uploads = Uploads(["refused"])
    with pytest.raises(PinstackError, match=r"front/3\.jpg is torn; copy it again") as caught:
        client(uploads).send_stack(DATA, "rig", "lens")
    assert (caught.value.code, caught.value.status) == ("invalid_image", 422)
    assert uploads.requests == ["POST", "PATCH"]


def test_a_line_that_stays_dead_is_an_error_that_names_the_service() -> None:
    with pytest.raises(PinstackError, match="http://rig cannot be reached") as caught:
        client(Uploads(["lost"] * 4)).send_stack(DATA, "rig", "lens")
    assert (caught.value.code, caught.value.status) == ("unreachable", 0)


def test_an_upload_of_another_process_is_resumed() -> None:
    uploads = Uploads(["", "", *["lost"] * 4])
    begun: List[str] = []
    with pytest.raises(PinstackError):
        client(uploads).send_stack(DATA, "rig", "lens", on_created=begun.append)
    assert len(uploads.stored) == 2000
    told: List[int] = []
    client(uploads).send_stack(DATA, "rig", "lens", resume=begun[0], on_bytes=lambda done, _: told.append(done))
    assert uploads.stored == DATA and told[0] == 2000 and uploads.requests.count("POST") == 1


def test_an_upload_that_has_expired_begins_anew() -> None:
    uploads = Uploads()
    begun: List[str] = []
    client(uploads).send_stack(DATA, "rig", "lens", resume="/v1/uploads/gone", on_created=begun.append)
    assert uploads.stored == DATA and begun == [UPLOAD]


def test_an_upload_is_not_resumed_with_another_zip() -> None:
    uploads = Uploads(["", *["lost"] * 4])
    with pytest.raises(PinstackError):
        client(uploads).send_stack(DATA, "rig", "lens")
    with pytest.raises(PinstackError, match="begun with 10240 bytes, but there are 10241 now") as caught:
        client(uploads).send_stack(DATA + b"x", "rig", "lens", resume=UPLOAD)
    assert caught.value.code == "source_changed"


class HeldFile(Source):
    """A file that another program holds for a while, as Windows does with files that are written or scanned."""

    name = "held.zip"

    def __init__(self, times: int) -> None:
        self.times, self.length = times, len(DATA)

    def read(self, offset: int, size: int) -> bytes:
        if self.times:
            self.times -= 1
            raise PermissionError(13, "The process cannot access the file", r"D:\view\1.jpg")
        return DATA[offset : offset + size]


def test_a_file_that_another_program_holds_is_tried_again() -> None:
    uploads = Uploads()
    client(uploads).send_stack(HeldFile(3), "rig", "lens")
    assert uploads.stored == DATA
    with pytest.raises(PinstackError, match=r"D:\\view\\1\.jpg cannot be read: another program holds it"):
        client(Uploads()).send_stack(HeldFile(4), "rig", "lens")


BUSY = {"retry-after": "0"}


def test_reading_is_repeated_and_a_rerun_only_if_it_was_not_taken() -> None:
    handler, seen = answers(httpx.ConnectError("no"), problem(503, "unavailable", "down"), httpx.Response(200, json={}))
    client(handler).get_stack("1")
    assert len(seen) == 3
    handler, seen = answers(problem(503, "queue_full", "full", **BUSY), httpx.Response(202, json={}))
    client(handler).rerun_stack("1", method="guided")
    assert len(seen) == 2 and seen[1].content == b'{"method": "guided"}'
    handler, seen = answers(httpx.ReadError("cut off"))
    with pytest.raises(PinstackError) as caught:
        client(handler).rerun_stack("1")
    assert caught.value.code == "unreachable" and len(seen) == 1


def test_one_request_with_a_key_is_repeated_from_its_first_byte() -> None:
    stack = httpx.Response(202, json={"id": "1"})
    handler, seen = answers(httpx.ReadError("cut off"), problem(502, "x", "proxy"), stack)
    told: List[int] = []
    sent = client(handler).send_stack(
        DATA, "rig", "lens", idempotency_key="beetle-1", keep_days=3, on_bytes=lambda done, _: told.append(done)
    )
    assert sent["id"] == "1" and [request.content for request in seen] == [DATA] * 3
    assert {request.headers["idempotency-key"] for request in seen} == {"beetle-1"}
    assert dict(seen[0].url.params) == {"rig": "rig", "lens": "lens", "keep_days": "3"}
    assert seen[0].headers["content-length"] == str(len(DATA)) and told[-1] == len(DATA)


def test_a_page_of_a_proxy_is_no_sentence_of_the_service() -> None:
    handler, _ = answers(httpx.Response(403, html="<h1>Blocked by\n policy</h1>"))
    with pytest.raises(PinstackError, match="status 403, and not by pinstack: <h1>Blocked by policy</h1>") as caught:
        client(handler).info()
    assert caught.value.code == "unexpected_response"


def test_an_error_survives_another_process() -> None:
    error = PinstackError.of_problem({"code": "x", "detail": "y", "status": 422, "errors": [{"detail": "z"}]}, "id-1")
    read = pickle.loads(pickle.dumps(error))
    assert (read.code, str(read), read.status, read.errors, read.request_id) == (
        "x",
        "y",
        422,
        [{"detail": "z"}],
        "id-1",
    )


class Body(httpx.SyncByteStream):
    """A body that arrives piece by piece, and may break off."""

    def __init__(self, data: bytes, is_torn: bool = False) -> None:
        self.data, self.is_torn = data, is_torn

    def __iter__(self) -> Any:
        for start in range(0, len(self.data), 999):
            yield self.data[start : start + 999]
        if self.is_torn:
            raise httpx.ReadError("connection reset")


def file_of(data: bytes, etag: str, start: int = 0, torn_at: int = -1) -> httpx.Response:
    headers = {"content-length": str(len(data) - start), "etag": etag}
    status = 206 if start else 200
    body = Body(data[start:]) if torn_at < 0 else Body(data[start:torn_at], is_torn=True)
    return httpx.Response(status, headers=headers, stream=body)


def test_a_broken_download_is_resumed_and_appears_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "bundle.zip"
    handler, seen = answers(
        file_of(DATA, '"a"', torn_at=100), httpx.ConnectError("no"), file_of(DATA, '"a"', 100, torn_at=5000),
        file_of(DATA, '"a"', 5000),
    )  # fmt: skip
    told: List[Tuple[int, int]] = []
    client(handler).save_bundle("beetle", "colmap", file, on_bytes=lambda *bytes: told.append(bytes))
    assert file.read_bytes() == DATA and list(tmp_path.iterdir()) == [file]
    assert [request.headers.get("range") for request in seen] == [None, "bytes=100-", "bytes=100-", "bytes=5000-"]
    assert seen[1].headers["if-range"] == '"a"' and told[-1] == (len(DATA), len(DATA))


def test_a_download_begins_anew_if_the_file_changed(tmp_path: Path) -> None:
    file = tmp_path / "image.png"
    file.with_name("image.png.part").write_bytes(b"left by a process that was killed")
    handler, seen = answers(file_of(DATA, '"a"', torn_at=100), file_of(b"another", '"b"'))
    client(handler).save_artifact("1", "image", file)
    assert file.read_bytes() == b"another" and seen[0].headers["accept"] == "image/png"


def test_a_refused_download_leaves_the_earlier_file(tmp_path: Path) -> None:
    file = tmp_path / "image.png"
    file.write_bytes(b"earlier")
    handler, _ = answers(problem(409, "not_finished", "the stack is running"))
    with pytest.raises(PinstackError, match="the stack is running"):
        client(handler).save_artifact("1", "image", file)
    assert file.read_bytes() == b"earlier" and list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("times", [3, 99])
def test_a_result_that_another_program_holds_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, times: int
) -> None:
    file = tmp_path / "image.png"
    file.write_bytes(b"open in a viewer")
    replace = Path.replace
    left = [times]

    def held(path: Path, target: Path) -> Path:
        if left[0]:
            left[0] -= 1
            # what Windows says of a sharing violation
            error = PermissionError(13, "Access is denied", str(path))
            error.winerror = 32  # type: ignore[attr-defined]
            raise error
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", held)
    handler, seen = answers(file_of(DATA, '"a"'))
    if times == 3:
        client(handler).save_artifact("1", "image", file)
        assert file.read_bytes() == DATA and list(tmp_path.iterdir()) == [file]
    else:
        with pytest.raises(PermissionError, match="another program holds it") as caught:
            client(handler).save_artifact("1", "image", file)
        assert caught.value.filename == str(file) and file.read_bytes() == b"open in a viewer"
    assert len(seen) == 1, "it is not downloaded again"


def events(*lines: str) -> httpx.Response:
    return httpx.Response(200, headers={"content-type": "text/event-stream"}, stream=Body("".join(lines).encode()))


RUNNING = 'event: state\nid: 3\ndata: {"state": "running", "progress": {"fraction": 0.1}}\n\n'
HALF = ': keep alive\n\nevent: progress\r\nid: 4\r\ndata: {"fraction": 0.5}\r\n\r\n'
DONE = 'event: state\nid: 5\ndata: {"state": "succeeded", "progress": {"fraction": 1.0}}\n\n'


def test_waiting_goes_on_after_the_last_event() -> None:
    succeeded = httpx.Response(200, json={"state": "succeeded"})
    handler, seen = answers(events(RUNNING, HALF), httpx.ConnectError("no"), events(DONE), succeeded)
    told: List[float] = []
    client(handler).wait("1", on_progress=lambda progress: told.append(progress["fraction"]))
    assert told == [0.1, 0.5, 1.0]
    assert [request.headers.get("last-event-id") for request in seen] == [None, "4", "4", None]


def test_a_failed_job_is_the_error_of_the_job() -> None:
    failed = {"state": "failed", "error": {"code": "mask_failed", "detail": "the back light is dark", "status": 422}}
    end = 'event: state\ndata: {"state": "failed"}\n\n'
    handler, _ = answers(events(end), httpx.Response(200, json=failed))
    with pytest.raises(PinstackError, match="the back light is dark") as caught:
        client(handler).wait("1")
    assert caught.value.code == "mask_failed"
    handler, _ = answers(events(end), httpx.Response(200, json=failed))
    assert client(handler).wait("1", check=False) == failed


def test_waiting_ends_with_the_time() -> None:
    handler, seen = answers()
    with pytest.raises(PinstackError, match="did not end within 0 s") as caught:
        client(handler).wait("1", timeout_s=0)
    assert caught.value.code == "timeout" and seen == []


def test_lists_are_read_page_by_page() -> None:
    pages = [
        httpx.Response(200, json={"items": [1, 2], "next_cursor": "c"}),
        httpx.Response(200, json={"items": [3, 4], "next_cursor": None}),
    ]
    handler, seen = answers(*pages)
    assert client(handler).list_stacks(scan="beetle") == [1, 2, 3, 4]
    assert dict(seen[1].url.params) == {"scan": "beetle", "cursor": "c"}
    handler, seen = answers(pages[0])
    assert client(handler).list_stacks(most=1) == [1] and len(seen) == 1


def test_address_and_token_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PINSTACK_URL", "http://lab:8080/")
    monkeypatch.setenv("PINSTACK_TOKEN", "pinstack_1")
    handler, seen = answers(httpx.Response(200, json={}), httpx.Response(204))
    with Client(transport=httpx.MockTransport(handler)) as from_environment:
        from_environment.info()
    Client("http://other", "own", transport=httpx.MockTransport(handler)).delete("1")
    assert [(str(request.url), request.headers["authorization"]) for request in seen] == [
        ("http://lab:8080/v1/info", "Bearer pinstack_1"),
        ("http://other/v1/stacks/1", "Bearer own"),
    ]


def test_the_asynchronous_client_runs_the_same_operations() -> None:
    uploads = Uploads(["", "lost", "response lost", "damaged"])

    async def session() -> Any:
        transport = httpx.MockTransport(uploads)
        async with AsyncClient("http://rig", retry=NOW, piece_bytes=1000, transport=transport) as client:
            return await client.send_stack(DATA, "rig", "lens")

    assert asyncio.run(session())["id"] == "0190-job" and uploads.stored == DATA


def test_several_uploads_run_at_once() -> None:
    services = [Uploads(["lost"] * n) for n in range(3)]

    async def one(uploads: Uploads) -> None:
        transport = httpx.MockTransport(uploads)
        async with AsyncClient("http://rig", retry=NOW, piece_bytes=1000, transport=transport) as client:
            await client.send_stack(DATA, "rig", "lens")

    async def session() -> None:
        await asyncio.gather(*map(one, services))

    asyncio.run(session())
    assert all(uploads.stored == DATA for uploads in services)


def test_a_line_that_breaks_under_long_pieces_gets_shorter_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pinstack._uploads.SMALLEST_PIECE", 100)
    uploads = Uploads()
    longest: List[int] = []

    def breaks(request: httpx.Request) -> httpx.Response:
        if request.method == "PATCH":
            longest.append(len(request.read()))
            if longest[-1] > 300:
                raise httpx.WriteError("connection reset", request=request)
        return uploads(request)

    # 1000 and 500 bytes do not get through, 250 do; fewer attempts than pieces that are lost
    client(breaks).send_stack(DATA, "rig", "lens")
    assert uploads.stored == DATA
    assert longest[:3] == [1000, 500, 250] and 500 in longest[3:], "longer ones are tried again"


def test_a_proxy_of_the_environment_is_named_where_the_service_cannot_be_reached(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy", "NO_PROXY", "no_proxy"):
        monkeypatch.delenv(name, raising=False)
    once = Retry(attempts=1)

    def told(**options: Any) -> str:
        with Client("http://127.0.0.1:9", retry=once, **options) as own, pytest.raises(PinstackError) as caught:
            own.info()
        return caught.value.detail

    assert "proxy" not in told()
    monkeypatch.setenv("http_proxy", "http://user:secret@127.0.0.1:1")
    sentence = told()
    assert "through the proxy 127.0.0.1:1 of the environment; if 127.0.0.1 needs none, add it to NO_PROXY" in sentence
    assert "secret" not in sentence
    assert "proxy" not in told(trust_env=False)
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    assert "proxy" not in told()
