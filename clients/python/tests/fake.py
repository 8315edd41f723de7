"""A service in memory that fails as told, for tests of what a client does then."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Tuple

import httpx

from pinstack import Client
from pinstack.push.causes import Site
from pinstack.push.folders import FoundStack
from pinstack.push.journal import Journal
from pinstack.push.sender import Outcome, Sender
from pinstack.push.settings import Settings

JOB = "/v1/stacks/0190-job"
UPLOAD = "/v1/uploads/0190-job"
#: The service in memory, as stacks find it.
SITE = Site("service-1", "revision 1")


def send(
    client: Client, journal: Journal, stack: FoundStack, settings: Settings, results: Path, site: Site = SITE
) -> Outcome:
    """Sends one stack."""
    return Sender(client, journal, settings, results, lambda *step: None, site).send(stack)


def problem(status: int, code: str, detail: str, **headers: str) -> httpx.Response:
    """An error as the service sends it."""
    body = {"type": f"/problems/{code}", "title": code, "status": status, "detail": detail, "code": code}
    return httpx.Response(status, json=body, headers={"content-type": "application/problem+json", **headers})


def answers(*told: Any) -> Tuple[Callable[[httpx.Request], httpx.Response], List[httpx.Request]]:
    """A service that gives these responses, or raises these errors, one after the other."""
    waiting, seen = list(told), []

    def handler(request: httpx.Request) -> httpx.Response:
        request.read()
        seen.append(request)
        next_one = waiting.pop(0)
        if isinstance(next_one, Exception):
            raise next_one
        assert isinstance(next_one, httpx.Response)
        return next_one

    return handler, seen


class Uploads:
    """The uploads of a service. ``faults`` are taken one by one, each for one ``PATCH``."""

    def __init__(self, faults: Optional[List[str]] = None) -> None:
        self.faults = list(faults or [])
        self.stored = b""
        self.length: Optional[int] = None
        self.metadata: Dict[str, str] = {}
        self.job_is_made = True
        #: Why the upload was refused for good.
        self.refusal: Optional[httpx.Response] = None
        self.requests: List[str] = []

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.requests.append(request.method)
        handler: Dict[str, Callable[[httpx.Request], httpx.Response]] = {
            "POST": self.create, "HEAD": self.ask, "PATCH": self.append, "GET": self.show,
        }  # fmt: skip
        return handler[request.method](request)

    def create(self, request: httpx.Request) -> httpx.Response:
        assert request.headers["tus-resumable"] == "1.0.0"
        self.length, self.stored, self.refusal = int(request.headers["upload-length"]), b"", None
        pairs = (pair.split(" ") for pair in request.headers["upload-metadata"].split(","))
        self.metadata = {name: base64.b64decode(value).decode() for name, value in pairs}
        return httpx.Response(201, headers={"location": UPLOAD, "upload-offset": "0"})

    def state(self) -> Dict[str, str]:
        headers = {"upload-offset": str(len(self.stored)), "upload-length": str(self.length)}
        if len(self.stored) == self.length and self.job_is_made:
            headers["pinstack-job"] = JOB
        return headers

    def ask(self, request: httpx.Request) -> httpx.Response:
        if self.length is None:
            return httpx.Response(404)
        if self.refusal is not None:
            return httpx.Response(self.refusal.status_code)
        told = self.state()
        if len(self.stored) == self.length and not self.job_is_made:
            self.job_is_made = True
            return httpx.Response(503, headers={"retry-after": "0"})
        return httpx.Response(200, headers=told)

    def append(self, request: httpx.Request) -> httpx.Response:
        fault = self.faults.pop(0) if self.faults else ""
        data = request.read()
        if fault == "lost":
            raise httpx.ReadError("connection reset", request=request)
        if fault == "no connection":
            raise httpx.ConnectError("connection refused", request=request)
        checksum = request.headers["upload-checksum"].split(" ")[1]
        if fault == "damaged":
            data = data[:-1] + bytes([data[-1] ^ 1])
        if base64.b64decode(checksum) != hashlib.sha256(data).digest():
            return problem(460, "checksum_mismatch", "the bytes do not match")
        if fault == "locked":
            return problem(423, "locked", "another request is still writing", **{"retry-after": "0"})
        if fault == "refused":
            self.refusal = problem(422, "invalid_image", "front/3.jpg is torn; copy it again from the camera")
            return self.refusal
        if int(request.headers["upload-offset"]) != len(self.stored):
            return problem(409, "conflict", "the upload is at another offset")
        self.stored += data
        if fault == "response lost":
            raise httpx.ReadError("connection reset", request=request)
        if fault == "queue full":
            self.job_is_made = False
            return problem(503, "queue_full", "1000 jobs are waiting", **{"retry-after": "0"})
        return httpx.Response(204, headers=self.state())

    def show(self, request: httpx.Request) -> httpx.Response:
        if self.length is None:
            return problem(404, "not_found", "there is no such upload")
        told: Dict[str, Any] = {"id": "0190-job", "path": request.url.path, "links": {"self": JOB}}
        if request.url.path == UPLOAD:
            told["error"] = self.refusal.json() if self.refusal is not None else None
        return httpx.Response(200, content=json.dumps(told))
