"""Requests as data, and what an operation asks of the transport that runs it.

An operation is a generator. It yields effects and gets their results, so it is written once: ``Client`` runs it with a
blocking connection, ``AsyncClient`` with an asynchronous one. The generator itself does no input or output.
"""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Generator, Mapping, Optional, Protocol, Tuple, TypeVar, Union
from urllib.parse import quote

from ._errors import PinstackError
from ._zips import Source

T = TypeVar("T")

#: Statuses after which the same request may succeed.
TEMPORARY = frozenset({429, 502, 503, 504})


class Sink(Protocol):
    """Receives the body of a successful response piece by piece."""

    def start(self, response: Response) -> None:
        """Called once, before the first piece."""

    def write(self, data: bytes) -> bool:
        """Takes a piece; False ends the response early."""


@dataclass(frozen=True)
class Request:
    """A request to the service."""

    method: str
    #: Path below the URL of the service, with each segment escaped.
    path: str
    query: Mapping[str, str] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    #: Body that is read while it is sent, or bytes.
    body: Union[bytes, Source, None] = None
    #: Whether a repetition does no harm.
    repeatable: bool = False
    sink: Optional[Sink] = None
    #: End the response of a sink after this time, seconds, as if the connection had broken.
    longest_s: Optional[float] = None
    #: Called before each try.
    on_try: Optional[Callable[[], None]] = None
    #: Called with the number of bytes that were sent since the last call.
    on_sent: Optional[Callable[[int], None]] = None


@dataclass(frozen=True)
class Response:
    """A response; the keys of ``headers`` are in lower case. The body is empty if a sink received it."""

    status: int
    headers: Mapping[str, str]
    body: bytes = b""

    @property
    def is_success(self) -> bool:
        return 200 <= self.status < 300

    def json(self) -> Any:
        try:
            return json.loads(self.body)
        except ValueError:
            raise PinstackError("unexpected_response", "the service answered with something that is not JSON") from None


@dataclass(frozen=True)
class Send:
    """Effect: send a request. Result: the :class:`Response`."""

    request: Request


@dataclass(frozen=True)
class Sleep:
    """Effect: wait."""

    seconds: float
    #: What went wrong before; None if nothing did.
    reason: Optional[PinstackError] = None


@dataclass(frozen=True)
class Call:
    """Effect: call a function that reads or writes files, outside of the event loop if there is one."""

    function: Callable[[], Any]


@dataclass(frozen=True)
class Clock:
    """Effect: the time, in seconds of a clock that never goes back."""


Effect = Union[Send, Sleep, Call, Clock]
Operation = Generator[Effect, Any, T]


class Unreachable(Exception):
    """Raised by a transport into an operation: no connection, or it broke."""


@dataclass(frozen=True)
class Retry:
    """How often and how long a request is repeated when the service cannot be reached or is busy.

    The ``n``-th wait, counted from 1, is between half and all of ``first_s * 2**(n-1)`` seconds, at most ``longest_s``.
    A longer ``Retry-After`` of the service is respected, up to 600 s. An upload counts anew whenever bytes have
    arrived.
    """

    attempts: int = 8
    first_s: float = 0.5
    longest_s: float = 30.0

    def wait(self, failures: int, response: Optional[Response] = None) -> float:
        """Seconds to wait after that many failures."""
        seconds: float = min(self.first_s * 2 ** min(failures - 1, 20), self.longest_s)
        seconds *= random.uniform(0.5, 1.0)
        after = response.headers.get("retry-after", "") if response is not None else ""
        return max(seconds, min(float(after), 600.0)) if after.isdigit() else seconds


def path(*segments: str) -> str:
    """A path of these segments, each escaped."""
    return "".join("/" + quote(segment, safe="") for segment in segments)


def query(**values: Any) -> Dict[str, str]:
    """Query parameters: None is omitted, booleans are ``true`` and ``false``."""
    return {name: text(value) for name, value in values.items() if value is not None}


def text(value: Any) -> str:
    """A value as the service reads it in a query."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ",".join(text(one) for one in value)
    return str(value)


def json_body(value: Any) -> Tuple[bytes, Dict[str, str]]:
    """Body and headers of a request with JSON."""
    return json.dumps(value).encode(), {"content-type": "application/json"}


def error_of(request: Request, response: Response) -> PinstackError:
    """The error that a response means."""
    what = f"{request.method} {request.path}"
    return PinstackError.of_response(response.status, response.body, response.headers.get("x-request-id"), what)


def send(request: Request, retry: Retry) -> Operation[Response]:
    """Sends a request, again after a failure that may pass, and raises the error of a refusal.

    | request | sent again after |
    |---|---|
    | repeatable | a broken connection, and the statuses in ``TEMPORARY`` |
    | others | status 429 and the code ``queue_full``: the service refused it before it did anything |
    """
    failures = 0
    while True:
        response: Optional[Response] = None
        if request.on_try is not None:
            request.on_try()
        try:
            response = yield Send(request)
        except Unreachable as error:
            failures += 1
            reason = PinstackError("unreachable", str(error))
            if failures >= retry.attempts or not request.repeatable:
                raise reason from error
        else:
            assert response is not None
            if response.is_success or response.status == 304:
                return response
            failures += 1
            reason = error_of(request, response)
            was_not_taken = response.status == 429 or reason.code == "queue_full"
            may_pass = was_not_taken or (request.repeatable and response.status in TEMPORARY)
            if failures >= retry.attempts or not may_pass:
                raise reason
        yield Sleep(retry.wait(failures, response), reason)
