"""A service that a proxy publishes below a sub-path: its links begin with the sub-path, or do not."""

from __future__ import annotations

import pytest

from pinstack._transport import Transport


@pytest.mark.parametrize(
    ("address", "path", "url"),
    [
        ("http://lab", "/v1/stacks/7", "http://lab/v1/stacks/7"),
        ("http://lab/pinstack", "/v1/stacks/7", "http://lab/pinstack/v1/stacks/7"),
        ("http://lab/pinstack/", "/pinstack/v1/stacks/7", "http://lab/pinstack/v1/stacks/7"),
        ("http://lab/a/b", "/a/b/v1/stacks?cursor=1", "http://lab/a/b/v1/stacks?cursor=1"),
        ("http://lab/v1", "/v1/stacks/7", "http://lab/v1/v1/stacks/7"),
        ("http://lab/v1", "/v1/v1/stacks/7", "http://lab/v1/v1/stacks/7"),
    ],
)
def test_links_lead_to_the_service_with_and_without_the_sub_path(address: str, path: str, url: str) -> None:
    assert Transport(address, None, {}).address(path) == url
