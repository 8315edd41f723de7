"""Files of the service: into memory, or onto the disk with resume."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO, Mapping, Optional

from ._errors import PinstackError
from ._http import TEMPORARY, Call, Operation, Request, Response, Retry, Send, Sleep, Unreachable, error_of
from ._paths import on_disk
from ._uploads import OnBytes


class _FileSink:
    """Appends to the part that is there, or begins anew if the service sends the whole file."""

    def __init__(self, part: Path, on_bytes: Optional[OnBytes]) -> None:
        self.part = part
        self.on_bytes = on_bytes
        self.file: Optional[BinaryIO] = None
        self.etag: Optional[str] = None
        self.position = 0
        self.total = 0

    def start(self, response: Response) -> None:
        is_rest = response.status == 206
        self.etag = response.headers.get("etag")
        # what a stopped process left behind may be of another file
        self.file = on_disk(self.part).open("ab" if is_rest else "wb")
        self.position = self.file.tell()
        self.total = self.position + int(response.headers.get("content-length", "0"))

    def write(self, data: bytes) -> bool:
        assert self.file is not None
        self.file.write(data)
        self.position += len(data)
        if self.on_bytes is not None:
            self.on_bytes(self.position, max(self.total, self.position))
        return True

    def close(self) -> None:
        if self.file is not None:
            self.file.close()
            self.file = None


def save(
    path: str, query: Mapping[str, str], headers: Mapping[str, str], to: Path, retry: Retry, on_bytes: Optional[OnBytes]
) -> Operation[Path]:
    """Downloads into a file. A broken connection is resumed by ``Range``; the file appears when it is complete."""
    part = to.with_name(to.name + ".part")
    sink = _FileSink(part, on_bytes)
    failures, have = 0, 0
    while True:
        wanted = dict(headers)
        if sink.etag is not None and have > 0:
            # the rest of the same file, or all of a new one
            wanted.update({"range": f"bytes={have}-", "if-range": sink.etag})
        request = Request("GET", path, query, wanted, repeatable=True, sink=sink)
        response: Optional[Response] = None
        try:
            response = yield Send(request)
            assert response is not None
            if response.is_success and sink.position >= sink.total:
                break
            reason = error_of(request, response)
            if not response.is_success and response.status not in TEMPORARY:
                raise reason
        except Unreachable as error:
            if sink.position >= sink.total > 0:
                break
            reason = PinstackError("unreachable", str(error))
        finally:
            sink.close()
        if sink.position > have:
            failures = 0
        have = sink.position
        failures += 1
        if failures >= retry.attempts:
            raise reason
        yield Sleep(retry.wait(failures, response), reason)
    yield from _put(part, to, retry)
    return to


def _put(part: Path, to: Path, retry: Retry) -> Operation[None]:
    """Gives a complete file its name; tries again while another program holds it, such as a viewer on Windows."""
    failures = 0
    while True:
        try:
            yield Call(lambda: on_disk(part).replace(on_disk(to)))
            return
        except PermissionError as error:
            failures += 1
            detail = "cannot be written: another program holds it, or the rights are missing"
            if failures >= retry.attempts:
                raise PermissionError(error.errno, detail, str(to)) from error
        yield Sleep(retry.wait(failures), PinstackError("invalid_source", f"{to} {detail}"))
