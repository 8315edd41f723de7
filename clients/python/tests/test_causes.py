"""What a refusal depends on: the table has every code, and what is sent again follows from it."""

from __future__ import annotations

import json

from conftest import PROJECT

from pinstack.push.causes import CAUSES, OF_PROFILE_OR_LIMITS, Again, Cause, again_after

#: Codes that this package makes up.
OWN = {"unreachable", "unexpected_response", "timeout", "cancelled", "invalid_source", "source_changed"}


def test_every_code_of_the_contract_has_a_cause() -> None:
    document = json.loads((PROJECT / "openapi/openapi.json").read_text("utf-8"))
    codes = set(document["components"]["schemas"]["Code"]["enum"])
    assert set(CAUSES) == codes | OWN


def test_only_what_follows_from_the_files_and_options_is_final() -> None:
    final = {code for code, cause in CAUSES.items() if cause is Cause.STACK}
    assert final == {
        "invalid_request", "invalid_archive", "unsupported_archive", "invalid_image", "invalid_poses",
        "target_not_found", "mask_failed", "invalid_source",
    }  # fmt: skip
    for code in CAUSES:
        expected = Again.CHANGE if code in final else Again.PROFILE if code in OF_PROFILE_OR_LIMITS else Again.LATER
        assert again_after(code) is expected, code
    assert again_after("of_a_newer_service") is Again.LATER
    assert not final & OF_PROFILE_OR_LIMITS and set(CAUSES) > OF_PROFILE_OR_LIMITS
