"""Resumable uploads by tus 1.0.0.

Each piece carries its checksum, so the service stores it whole or not at all. After a failure the offset is asked
again, and the upload continues there. The upload and its stack or calibration have the same id: an upload whose last
response was lost makes no second one.
"""

from __future__ import annotations

import base64
import hashlib
import json
from typing import Any, Callable, Mapping, Optional
from urllib.parse import urlsplit

from ._errors import PinstackError
from ._http import TEMPORARY, Call, Operation, Request, Response, Retry, Send, Sleep, Unreachable, error_of, send
from ._paths import shown
from ._zips import Source, utf8

VERSION = {"tus-resumable": "1.0.0"}
#: After these the offset is asked and the upload continues: another offset, locked, damaged on the way, cut off.
RESUMABLE = TEMPORARY | {400, 409, 423, 460}
#: Why the service has not made a job of a whole upload yet, by status: the code of the error, and its reason.
PENDING = {
    423: ("locked", "another request still works on the upload"),
    503: ("unavailable", "the queue is full, or the service is shutting down"),
    507: ("insufficient_storage", "the disk of the service or the quota of the token is full"),
}

#: Bytes below which a piece is not halved.
SMALLEST_PIECE = 64 << 10

#: Called with the bytes that are sent and their total.
OnBytes = Callable[[int, int], None]


def metadata(values: Mapping[str, Any]) -> str:
    """The value of ``Upload-Metadata``."""
    pairs = []
    for name, value in values.items():
        text = value if isinstance(value, str) else json.dumps(value)
        pairs.append(f"{name} {base64.b64encode(utf8(text)).decode()}")
    return ",".join(pairs)


def upload(
    source: Source,
    values: Mapping[str, Any],
    retry: Retry,
    piece_bytes: int,
    on_bytes: Optional[OnBytes] = None,
    resume: Optional[str] = None,
    on_created: Optional[Callable[[str], None]] = None,
) -> Operation[str]:
    """Uploads a zip and returns the path of the job, or of the scan.

    ``resume`` is the path of an upload that was begun earlier. If the service has it no longer or has refused it, a new
    one begins: what it was refused for, such as a profile of another size, may have changed.
    """
    if source.length == 0:
        raise PinstackError("invalid_source", f"{source.name} is empty")
    url, job, offset = resume, None, 0
    if url is not None:
        try:
            offset, job = yield from _ask(url, source.length, retry)
        except PinstackError as error:
            # what a proxy says of the upload is no word about it
            is_gone = error.status in (404, 410) and error.code != "unexpected_response"
            if not is_gone and not isinstance(error, UploadRefused):
                raise
            url = None
    if url is None:
        url = yield from _create(source, values, retry)
        if on_created is not None:
            on_created(url)
    if on_bytes is not None:
        on_bytes(offset, source.length)
    pieces = _PieceSize(piece_bytes)
    while job is None:
        if offset >= source.length:
            # all bytes are there, but the queue was full: asking makes the job
            offset, job = yield from _ask(url, source.length, retry)
            continue
        offset, job = yield from _send_piece(source, url, offset, retry, pieces, on_bytes)
    return job


class UploadRefused(PinstackError):
    """The service has refused the upload for good."""


class _PieceSize:
    """How many bytes a piece has. A piece arrives whole or not at all, so one that does not get through is halved;
    after some that do, the next is larger again."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._arrived = 0
        self.bytes = most

    def arrived(self) -> None:
        self._arrived += 1
        if self._arrived >= 8 and self.bytes < self._most:
            self.bytes, self._arrived = min(2 * self.bytes, self._most), 0

    def lost(self) -> None:
        self.bytes, self._arrived = max(self.bytes // 2, min(SMALLEST_PIECE, self._most)), 0


def _create(source: Source, values: Mapping[str, Any], retry: Retry) -> Operation[str]:
    headers = {
        **VERSION,
        "upload-length": str(source.length),
        "upload-metadata": metadata({**values, "filename": source.name}),
    }
    # an upload that is begun twice makes no second stack: the first expires without a byte
    response = yield from send(Request("POST", "/v1/uploads", headers=headers, body=b"", repeatable=True), retry)
    return _path(response, "location")


def _send_piece(
    source: Source, url: str, at: int, retry: Retry, pieces: _PieceSize, on_bytes: Optional[OnBytes]
) -> Operation[Any]:
    """Sends the piece at ``at``. Returns the offset that the service has then, and the job if there is one."""
    failures = 0
    while True:
        start = at
        piece: bytes = yield from _read(source, start, pieces.bytes, retry)
        sent = 0

        def count(size: int, start: int = start) -> None:
            nonlocal sent
            sent += size
            if on_bytes is not None:
                on_bytes(start + sent, source.length)

        checksum = base64.b64encode(hashlib.sha256(piece).digest()).decode()
        headers = {
            **VERSION,
            "content-type": "application/offset+octet-stream",
            "upload-offset": str(start),
            "upload-checksum": f"sha256 {checksum}",
        }
        request = Request("PATCH", url, headers=headers, body=piece, on_sent=count)
        response: Optional[Response] = None
        reason: PinstackError
        try:
            response = yield Send(request)
            assert response is not None
            if response.is_success:
                pieces.arrived()
                return _offset(response), _job(response)
            reason = error_of(request, response)
            if response.status not in RESUMABLE or reason.code == "invalid_request":
                raise reason
        except Unreachable as error:
            reason = PinstackError("unreachable", str(error))
            if sent > 0:
                # the line broke under this piece
                pieces.lost()
        failures += 1
        if failures >= retry.attempts:
            raise reason
        yield Sleep(retry.wait(failures, response), reason)
        at, job = yield from _ask(url, source.length, retry)
        if on_bytes is not None:
            on_bytes(at, source.length)
        if at > start or job is not None:
            return at, job


def _read(source: Source, offset: int, size: int, retry: Retry) -> Operation[bytes]:
    """Reads a piece. A file that another program holds (Windows) is tried again."""
    failures = 0
    while True:
        try:
            data: bytes = yield Call(lambda: source.read(offset, size))
            return data
        except PermissionError as error:
            failures += 1
            detail = f"{shown(error.filename)} cannot be read: another program holds it, or the rights are missing"
            reason = PinstackError("invalid_source", detail)
            if failures >= retry.attempts:
                raise reason from error
        yield Sleep(retry.wait(failures), reason)


def _ask(url: str, length: int, retry: Retry) -> Operation[Any]:
    """The offset of an upload, and its job if there is one."""
    request = Request("HEAD", url, headers=VERSION, repeatable=True)
    failures = 0
    while True:
        response: Response
        try:
            response = yield from send(request, retry)
            break
        except PinstackError as error:
            if error.status in (409, 423) and failures < retry.attempts:
                failures += 1
                yield Sleep(retry.wait(failures), error)
                continue
            # a response to HEAD has no body: the sentence is that of GET
            raise (yield from _explained(url, error, retry)) from error
    declared = response.headers.get("upload-length", "")
    if declared != str(length):
        detail = f"the upload was begun with {declared} bytes, but there are {length} now; begin a new one"
        raise PinstackError("source_changed", detail)
    return _offset(response), _job(response)


def _explained(url: str, error: PinstackError, retry: Retry) -> Operation[PinstackError]:
    if error.code == "unreachable":
        return error
    try:
        response = yield from send(Request("GET", url, repeatable=True), retry)
    except PinstackError as explained:
        return explained
    state = response.json()
    problem = state.get("error")
    if isinstance(problem, dict):
        return UploadRefused.of_problem(problem)
    if error.status not in PENDING or state.get("job") is not None:
        return error
    code, reason = PENDING[error.status]
    offset, length = state.get("offset"), state.get("length")
    what = "all bytes of the upload are at the service, but its job is not made yet"
    if offset != length:
        what = f"the service has {offset} of {length} bytes of the upload, but does not continue it now"
    detail = f"{what} (status {error.status}: {reason}); run it again later"
    return PinstackError(code, detail, problem={"code": code, "status": error.status, "detail": detail})


def _offset(response: Response) -> int:
    text = response.headers.get("upload-offset", "")
    if not text.isdigit():
        raise PinstackError("unexpected_response", "the service did not say how many bytes of the upload it has")
    return int(text)


def _path(response: Response, header: str) -> str:
    value = response.headers.get(header, "")
    if not value:
        raise PinstackError("unexpected_response", f"the response has no header {header}")
    # a proxy may have made the URL absolute
    return urlsplit(value).path


def _job(response: Response) -> Optional[str]:
    return _path(response, "pinstack-job") if "pinstack-job" in response.headers else None
