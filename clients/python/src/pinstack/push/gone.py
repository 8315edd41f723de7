"""Views of a scan that were sent, and whose folder is not there any more.

A folder that is renamed is another view, with other angles. The view with the old name stays in the scan until somebody
deletes its stack.
"""

from __future__ import annotations

from typing import List

from .._client import Client
from .._errors import PinstackError
from .._paths import on_disk
from .causes import Site
from .folders import Found
from .journal import Journal
from .sender import is_gone, scan_key
from .settings import Settings


def gone_views(
    client: Client, journal: Journal, settings: Settings, site: Site, found: Found, only_renamed: bool
) -> List[str]:
    """A sentence for each view that the service still has. ``only_renamed``: whose pictures were sent as another."""
    scan = settings.scan or settings.options.get("scan")
    if scan is None or found.unread:
        return []
    names = {stack.name for stack in found.stacks}
    views = journal.views(scan_key(site, str(scan)))
    there = {view.content: view.name for view in views if view.name in names}
    sentences = []
    for view in views:
        other = there.get(view.content) if view.content is not None else None
        if view.name in names or on_disk(view.place).exists() or (only_renamed and other is None):
            continue
        try:
            client.get_stack(view.job)
        except PinstackError as error:
            if is_gone(error):
                journal.forget(view.key)
            continue
        what = "its folder is not there any more"
        if other is not None:
            what += f", and {other} has the same pictures: was it renamed?"
        sentences.append(f"{view.name} was sent to the scan {scan}, but {what}; delete {view.job} if it is no view")
    return sentences
