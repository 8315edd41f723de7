"""Runs operations with httpx: blocking, and asynchronous."""

from __future__ import annotations

import os
import time
from typing import Any, AsyncIterator, Callable, Dict, Iterator, Mapping, Optional, TypeVar
from urllib.parse import urlsplit
from urllib.request import getproxies, proxy_bypass

import anyio
import anyio.to_thread
import httpx

from ._errors import PinstackError
from ._http import Call, Effect, Operation, Request, Response, Send, Sleep, Unreachable
from ._version import VERSION
from ._zips import BLOCK, Source

T = TypeVar("T")

DEFAULT_URL = "http://127.0.0.1:8080"
#: Longest silence, seconds: of a response, and of one that comes after the service has taken an upload apart.
SILENCE_S, WORK_S = 60.0, 900.0


class Transport:
    """What both transports share."""

    def __init__(self, url: Optional[str], token: Optional[str], options: Mapping[str, Any]) -> None:
        self.url = (url or os.environ.get("PINSTACK_URL") or DEFAULT_URL).rstrip("/")
        _check_address(self.url)
        #: Whether httpx takes the proxy of the environment.
        self.trusts_environment = options.get("trust_env", True) and not {"transport", "proxy", "mounts"} & set(options)
        token = token or os.environ.get("PINSTACK_TOKEN") or None
        self.headers = {"user-agent": f"pinstack-python/{VERSION}"}
        if token is not None:
            self.headers["authorization"] = f"Bearer {token}"

    def arguments(self, request: Request) -> Dict[str, Any]:
        """Arguments of httpx for a request, without its body."""
        headers = dict(request.headers)
        length = None if request.body is None else _length(request.body)
        if length is not None:
            headers["content-length"] = str(length)
        if request.sink is not None:
            # lengths and offsets count the bytes of the file
            headers["accept-encoding"] = "identity"
        read = WORK_S if length else SILENCE_S
        if request.longest_s is not None:
            read = min(read, max(request.longest_s, 0.01))
        return {
            "method": request.method,
            "url": self.address(request.path),
            "params": dict(request.query),
            "headers": headers,
            "timeout": httpx.Timeout(SILENCE_S, read=read, connect=15.0),
        }

    def address(self, path: str) -> str:
        """The URL of a path below the address of the service.

        Links of a service below a sub-path begin with the sub-path, which the address has too.
        """
        sub_path = urlsplit(self.url).path
        below = path[len(sub_path) :] if path.startswith(f"{sub_path}/v1/") else path
        return self.url + below

    def unreachable(self, error: Exception) -> Unreachable:
        """What a failure of httpx means."""
        reason = str(error) or type(error).__name__
        proxy = _proxy(self.url) if self.trusts_environment else None
        if proxy is not None:
            host = urlsplit(self.url).hostname
            reason = f"the proxy {proxy} of the environment; if {host} needs none, add it to NO_PROXY ({reason})"
        by = "cannot be reached through" if proxy is not None else "cannot be reached:"
        return Unreachable(f"the service at {self.url} {by} {reason}")


def _check_address(url: str) -> None:
    """Raises ``invalid_source`` for what is no address of a web service: it would look like one that is down."""
    try:
        parsed = httpx.URL(url)
    except httpx.InvalidURL as error:
        raise PinstackError("invalid_source", f"the address '{url}' is not valid: {error}") from error
    is_web = parsed.scheme in ("http", "https")
    if is_web and parsed.host:
        return
    if is_web or "://" in url:
        detail = f"the address '{url}' is not that of a web service; write http://HOST:PORT or https://HOST"
    else:
        detail = f"the address '{url}' has no scheme; write http://{url}"
    raise PinstackError("invalid_source", detail)


def _proxy(url: str) -> Optional[str]:
    """The proxy of the environment for an address, without its password."""
    parts = urlsplit(url)
    proxies = getproxies()
    proxy = proxies.get(parts.scheme) or proxies.get("all")
    if not proxy or proxy_bypass(parts.netloc):
        return None
    return proxy.rsplit("@", 1)[-1].split("://", 1)[-1]


def _length(body: Any) -> int:
    return body.length if isinstance(body, Source) else len(body)


def _blocks(request: Request) -> Iterator[bytes]:
    body = request.body
    blocks = body.blocks() if isinstance(body, Source) else _parts(body or b"")
    for block in blocks:
        yield block
        if request.on_sent is not None:
            request.on_sent(len(block))


def _parts(data: bytes) -> Iterator[bytes]:
    for start in range(0, len(data), BLOCK):
        yield data[start : start + BLOCK]


def _response(response: Any) -> Response:
    return Response(response.status_code, {name.lower(): value for name, value in response.headers.items()})


class SyncTransport(Transport):
    """Runs operations, blocking. May be used by several threads.

    ``sleep`` waits between two tries; it may raise to end the operation. ``on_wait`` is told before, why and for how
    many seconds.
    """

    def __init__(self, url: Optional[str], token: Optional[str], **options: Any) -> None:
        super().__init__(url, token, options)
        self.sleep: Callable[[float], None] = time.sleep
        self.on_wait: Callable[[PinstackError, float], None] = lambda reason, seconds: None
        self._http = httpx.Client(headers=self.headers, **options)

    def run(self, operation: Operation[T]) -> T:
        try:
            effect = next(operation)
            while True:
                try:
                    result = self._perform(effect)
                except Exception as error:
                    effect = operation.throw(error)
                else:
                    effect = operation.send(result)
        except StopIteration as end:
            value: T = end.value
            return value
        finally:
            operation.close()

    def _perform(self, effect: Effect) -> Any:
        if isinstance(effect, Send):
            return self._send(effect.request)
        if isinstance(effect, Sleep):
            if effect.reason is not None:
                self.on_wait(effect.reason, effect.seconds)
            return self.sleep(effect.seconds)
        return effect.function() if isinstance(effect, Call) else time.monotonic()

    def _send(self, request: Request) -> Response:
        content = None if request.body is None else _blocks(request)
        began = time.monotonic()
        try:
            with self._http.stream(content=content, **self.arguments(request)) as response:
                told = _response(response)
                sink = request.sink
                if sink is None or not told.is_success:
                    return Response(told.status, told.headers, response.read())
                sink.start(told)
                for data in response.iter_raw():
                    if not sink.write(data) or _is_over(request, began):
                        break
                return told
        except httpx.TransportError as error:
            raise self.unreachable(error) from error

    def close(self) -> None:
        self._http.close()


class AsyncTransport(Transport):
    """Runs operations on an event loop (asyncio or trio). Files are read in threads."""

    def __init__(self, url: Optional[str], token: Optional[str], **options: Any) -> None:
        super().__init__(url, token, options)
        self._http = httpx.AsyncClient(headers=self.headers, **options)

    async def run(self, operation: Operation[T]) -> T:
        try:
            effect = next(operation)
            while True:
                try:
                    result = await self._perform(effect)
                except Exception as error:
                    effect = operation.throw(error)
                else:
                    effect = operation.send(result)
        except StopIteration as end:
            value: T = end.value
            return value
        finally:
            operation.close()

    async def _perform(self, effect: Effect) -> Any:
        if isinstance(effect, Send):
            return await self._send(effect.request)
        if isinstance(effect, Sleep):
            return await anyio.sleep(effect.seconds)
        if isinstance(effect, Call):
            return await anyio.to_thread.run_sync(effect.function)
        return time.monotonic()

    async def _send(self, request: Request) -> Response:
        content = None if request.body is None else _blocks_async(request)
        began = time.monotonic()
        try:
            async with self._http.stream(content=content, **self.arguments(request)) as response:
                told = _response(response)
                sink = request.sink
                if sink is None or not told.is_success:
                    return Response(told.status, told.headers, await response.aread())
                sink.start(told)
                async for data in response.aiter_raw():
                    if not sink.write(data) or _is_over(request, began):
                        break
                return told
        except httpx.TransportError as error:
            raise self.unreachable(error) from error

    async def close(self) -> None:
        await self._http.aclose()


async def _blocks_async(request: Request) -> AsyncIterator[bytes]:
    blocks = _blocks(request)
    while True:
        block = await anyio.to_thread.run_sync(lambda: next(blocks, None))
        if block is None:
            return
        yield block


def _is_over(request: Request, began: float) -> bool:
    return request.longest_s is not None and time.monotonic() - began >= request.longest_s
