"""Client of pinstack, a service for calibrated focus stacking."""

from ._async_client import AsyncClient
from ._client import Client
from ._errors import PinstackError
from ._http import Retry
from ._version import VERSION as __version__
from ._zips import BytesSource, FileSource, Member, Sendable, Source, StoredZip

__all__ = [
    "AsyncClient",
    "BytesSource",
    "Client",
    "FileSource",
    "Member",
    "PinstackError",
    "Retry",
    "Sendable",
    "Source",
    "StoredZip",
    "__version__",
]
