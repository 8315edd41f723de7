"""Waiting for a job by its server-sent events, with the progress on the way."""

from __future__ import annotations

import json
from typing import Any, Callable, Dict, Optional

from ._errors import PinstackError
from ._http import TEMPORARY, Clock, Operation, Request, Response, Retry, Send, Sleep, Unreachable, error_of, send
from .models import Progress

#: Called with the progress of a job whenever it changes.
OnProgress = Callable[[Progress], None]

FINAL = frozenset({"succeeded", "failed", "cancelled"})


class EventSink:
    """Parses an event stream. Ends it at the final state of the job, or when the time is up."""

    def __init__(self, on_progress: Optional[OnProgress]) -> None:
        self.on_progress = on_progress
        self.job: Optional[Dict[str, Any]] = None
        self.last_id: Optional[str] = None
        #: Whether anything arrived since the request was sent.
        self.is_alive = False
        self._rest = b""
        self._event: Dict[str, str] = {}

    def start(self, response: Response) -> None:
        self._rest, self._event, self.is_alive = b"", {}, False

    def write(self, data: bytes) -> bool:
        self.is_alive = True
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._line(line.rstrip(b"\r").decode("utf-8", "replace"))
        return not self.is_final

    @property
    def is_final(self) -> bool:
        return self.job is not None and self.job.get("state") in FINAL

    def _line(self, line: str) -> None:
        if line:
            name, _, value = line.partition(":")
            value = value[1:] if value.startswith(" ") else value
            if name == "data" and "data" in self._event:
                value = f"{self._event['data']}\n{value}"
            self._event[name] = value
            return
        event, self._event = self._event, {}
        self.last_id = event.get("id", self.last_id)
        kind, data = event.get("event"), event.get("data")
        if kind not in ("state", "progress") or data is None:
            return
        document = json.loads(data)
        if kind == "state":
            self.job = document
            document = document.get("progress")
        if self.on_progress is not None and isinstance(document, dict):
            self.on_progress(document)  # type: ignore[arg-type]


def wait(path: str, retry: Retry, on_progress: Optional[OnProgress], timeout_s: Optional[float]) -> Operation[Any]:
    """Waits until the job at ``path`` has ended and returns it, whatever its end. Raises ``timeout``."""
    began: float = yield Clock()
    sink = EventSink(on_progress)
    failures = 0
    while True:
        left: Optional[float] = None
        if timeout_s is not None:
            left = began + timeout_s - (yield Clock())
            if left <= 0:
                detail = f"{path} did not end within {timeout_s:g} s; it continues, and can be waited for again"
                raise PinstackError("timeout", detail)
        headers = {"accept": "text/event-stream"}
        if sink.last_id is not None:
            headers["last-event-id"] = sink.last_id
        request = Request("GET", f"{path}/events", headers=headers, repeatable=True, sink=sink, longest_s=left)
        response: Optional[Response] = None
        sink.is_alive = False
        try:
            response = yield Send(request)
            assert response is not None
            reason = error_of(request, response)
            if not response.is_success and response.status not in TEMPORARY:
                raise reason
        except Unreachable as error:
            reason = PinstackError("unreachable", str(error))
        if sink.is_final or (response is not None and response.status == 204):
            # the event may be older than the links of the final document
            return (yield from send(Request("GET", path, repeatable=True), retry)).json()
        failures = 0 if sink.is_alive else failures + 1
        if failures >= retry.attempts:
            raise reason
        yield Sleep(retry.wait(max(failures, 1), response), reason if failures else None)
