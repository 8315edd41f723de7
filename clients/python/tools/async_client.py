"""Writes src/pinstack/_async_client.py from src/pinstack/_client.py.

python tools/async_client.py > src/pinstack/_async_client.py
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

REPLACED = [
    ('"""The blocking client. ``_async_client.py`` is written from this file by ``tools/async_client.py``."""',
     '"""The asynchronous client. Written from ``_client.py`` by ``tools/async_client.py``; do not edit."""'),
    ("SyncTransport", "AsyncTransport"),
    ("class Client:", "class AsyncClient:"),
    ('"""A pinstack service.', '"""A pinstack service, for asyncio and trio.'),
    ("-> Client:", "-> AsyncClient:"),
    ("``httpx.Client``", "``httpx.AsyncClient``"),
    ("import Client", "import AsyncClient"),
    (">>> with Client()", ">>> async with AsyncClient()"),
    ("stack = client.", "stack = await client."),
    ("...     client.", "...     await client."),
    ("def __enter__", "async def __aenter__"),
    ("def __exit__", "async def __aexit__"),
    ("self.close()", "await self.close()"),
    ("self._transport.close()", "await self._transport.close()"),
    ("self._transport.run(send(request, self._do.retry)).body",
     "(await self._transport.run(send(request, self._do.retry))).body"),
    ("return self._transport.run", "return await self._transport.run"),
]  # fmt: skip


def asynchronous(text: str) -> str:
    """The text of the asynchronous client."""
    for old, new in REPLACED:
        if old not in text:
            raise SystemExit(f"_client.py no longer holds {old!r}")
        text = text.replace(old, new)
    text = re.sub(r"^    def (?!__|url\b)", "    async def ", text, flags=re.MULTILINE)
    return re.sub(r" +# doctest: \+SKIP", "  # doctest: +SKIP", text)


if __name__ == "__main__":
    here = Path(__file__).resolve().parent.parent
    sys.stdout.write(asynchronous((here / "src/pinstack/_client.py").read_text(encoding="utf-8")))
