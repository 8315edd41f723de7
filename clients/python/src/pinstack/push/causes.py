"""What a refusal or a failure depends on, and so what sends a stack again.

| depends on | the stack is sent again |
|---|---|
| the files and the options | when one of them has changed |
| everything else: the service, its disk, its tokens, what is in between | later |
| of that, the profile or the limits of the service | when they are others; before, the same bytes are refused again |
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Dict, Mapping, cast

from .._client import Client
from .settings import Settings


class Cause(Enum):
    """What a refusal or a failure depends on."""

    #: The files and the options alone.
    STACK = "stack"
    #: Something that passes, or that somebody mends.
    ELSEWHERE = "elsewhere"


#: Every code of the contract of the service, and those of this package.
CAUSES: Dict[str, Cause] = {
    "invalid_request": Cause.STACK,
    "unauthorized": Cause.ELSEWHERE,
    "forbidden": Cause.ELSEWHERE,
    "cross_origin_request": Cause.ELSEWHERE,
    "misdirected_request": Cause.ELSEWHERE,
    "too_many_requests": Cause.ELSEWHERE,
    "not_found": Cause.ELSEWHERE,
    "method_not_allowed": Cause.ELSEWHERE,
    "method_not_implemented": Cause.ELSEWHERE,
    "profile_not_found": Cause.ELSEWHERE,
    "scan_not_found": Cause.ELSEWHERE,
    "scan_mismatch": Cause.ELSEWHERE,
    "not_finished": Cause.ELSEWHERE,
    "no_result": Cause.ELSEWHERE,
    "upload_removed": Cause.ELSEWHERE,
    "conflict": Cause.ELSEWHERE,
    "precondition_failed": Cause.ELSEWHERE,
    "idempotency_key_reused": Cause.ELSEWHERE,
    "unsupported_media_type": Cause.ELSEWHERE,
    "not_acceptable": Cause.ELSEWHERE,
    "range_not_satisfiable": Cause.ELSEWHERE,
    # the limit is a setting of the service
    "upload_too_large": Cause.ELSEWHERE,
    "upload_incomplete": Cause.ELSEWHERE,
    "checksum_mismatch": Cause.ELSEWHERE,
    "locked": Cause.ELSEWHERE,
    "insufficient_storage": Cause.ELSEWHERE,
    "queue_full": Cause.ELSEWHERE,
    "invalid_archive": Cause.STACK,
    "unsupported_archive": Cause.STACK,
    # the limits are settings of the service
    "archive_too_large": Cause.ELSEWHERE,
    "invalid_image": Cause.STACK,
    # the profile may be what is wrong
    "size_mismatch": Cause.ELSEWHERE,
    "slice_count_mismatch": Cause.ELSEWHERE,
    "invalid_profile": Cause.ELSEWHERE,
    "invalid_poses": Cause.STACK,
    "target_not_found": Cause.STACK,
    "mask_failed": Cause.STACK,
    "reconstruction_failed": Cause.ELSEWHERE,
    "worker_lost": Cause.ELSEWHERE,
    "unavailable": Cause.ELSEWHERE,
    "internal": Cause.ELSEWHERE,
    # of this package
    "unreachable": Cause.ELSEWHERE,
    "unexpected_response": Cause.ELSEWHERE,
    "timeout": Cause.ELSEWHERE,
    "cancelled": Cause.ELSEWHERE,
    "source_changed": Cause.ELSEWHERE,
    "invalid_source": Cause.STACK,
}

#: Codes of refusals that last until the profile or the limits of the service are others.
OF_PROFILE_OR_LIMITS = frozenset(
    {"size_mismatch", "slice_count_mismatch", "invalid_profile", "upload_too_large", "archive_too_large"}
)


class Again(Enum):
    """What sends a stack again."""

    #: A change of its files or options.
    CHANGE = "change"
    #: Another profile or other limits.
    PROFILE = "profile"
    #: The next try.
    LATER = "later"


def again_after(code: str) -> Again:
    """What sends a stack again after this code. One that a newer service made up is no word about the files."""
    if code in OF_PROFILE_OR_LIMITS:
        return Again.PROFILE
    return Again.CHANGE if CAUSES.get(code, Cause.ELSEWHERE) is Cause.STACK else Again.LATER


@dataclass(frozen=True)
class Site:
    """The service as a stack finds it."""

    #: Its identity: the same at every address.
    id: str
    #: The revision of the profile, and the limits. Another text is a reason to send a refused stack again.
    state: str


def site_of(client: Client, settings: Settings) -> Site:
    """Asks the service. Raises ``profile_not_found`` if it has no profile for the stacks."""
    info = cast(Mapping[str, Any], client.info())
    profiles = client.list_profiles(settings.rig, settings.lens, most=1)
    # the sentence of the refusal names the rigs that are there
    profile = profiles[0] if profiles else client.get_profile(settings.rig, settings.lens)
    # services of before the first release have no identity
    identity = str(info.get("id") or settings.server.rstrip("/"))
    limits = sorted((info.get("limits") or {}).items())
    return Site(identity, f"revision {profile['revision']}, {limits}")
