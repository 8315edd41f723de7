"""A day with the client that openapi-python-client makes."""

import json
import sys
from pathlib import Path
from uuid import UUID

from pinstack_client import AuthenticatedClient
from pinstack_client.api.calibrations import calibrate, get_calibration
from pinstack_client.api.profiles import put_profile
from pinstack_client.api.stacks import (
    cancel_stack, delete_stack, get_stack, get_stack_image, get_stack_metrics, get_stack_upload, list_stacks,
    rerun_stack, send_stack)
from pinstack_client.models import (
    Code, JobState, Metrics, Problem, Profile, ProfileInput, RerunOptions, Stack, StackForm, StackList, StackOptionsInput)
from pinstack_client.types import File

url, token, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
client = AuthenticatedClient(base_url=url, token=token, timeout=120)
ENDED = (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED)


def file(name):
    return File(payload=(folder / name).open("rb"), file_name=name)


def ended(get, job):
    while job.state not in ENDED:
        job = get.sync(job.id, client=client, prefer="wait=30")
    return job


profile = ProfileInput.from_dict(json.loads((folder / "profile.json").read_text()))
stored = put_profile.sync("rig", "lens", client=client, body=profile)
assert isinstance(stored, Profile) and stored.revision == 1, stored

calibration = calibrate.sync("measured", "lens", client=client, body=file("target.zip"), focal_mm=65.0)
calibration = ended(get_calibration, calibration)
assert calibration.state == JobState.SUCCEEDED, calibration.error
assert calibration.result.profile_revision == 1 and calibration.options.focal_mm == 65.0

stack = send_stack.sync(client=client, body=file("stack.zip"), rig="rig", lens="lens", label="by octets")
assert isinstance(stack, Stack), stack
stack = ended(get_stack, stack)
assert stack.state == JobState.SUCCEEDED and stack.options.label == "by octets" and stack.options.r1 == 45, stack
image = get_stack_image.sync(stack.id, client=client)
assert image.payload.read(8) == b"\x89PNG\r\n\x1a\n", image
metrics = get_stack_metrics.sync(stack.id, client=client)
assert isinstance(metrics, Metrics) and len(metrics.slices) == 4, metrics

form = StackForm(stack=file("stack.zip"), rig="rig", lens="lens", options=StackOptionsInput(label="by form"))
second = send_stack.sync(client=client, body=form)
assert second.options.label == "by form" and second.upload.filename == "stack.zip", second

seen, cursor = [], None
while True:
    page = list_stacks.sync(client=client, limit=1, **({"cursor": cursor} if cursor else {}))
    assert isinstance(page, StackList) and len(page.items) <= 1, page
    seen += [item.id for item in page.items]
    cursor = page.next_cursor
    if not cursor:
        break
assert seen == [second.id, stack.id], seen

told = cancel_stack.sync(second.id, client=client)
assert isinstance(told, Stack) or told.code == Code.CONFLICT, told
gone = delete_stack.sync_detailed(second.id, client=client)
assert gone.status_code == 204, gone

again = rerun_stack.sync(stack.id, client=client, body=RerunOptions(label="again"))
again = ended(get_stack, again)
assert again.state == JobState.SUCCEEDED and again.rerun_of == stack.id and again.options.label == "again", again
upload = get_stack_upload.sync(again.id, client=client)
assert upload.payload.read() == (folder / "stack.zip").read_bytes()

told = get_stack.sync(second.id, client=client)
assert isinstance(told, Problem) and told.code == Code.NOT_FOUND and told.status == 404, told
told = send_stack.sync(client=client, body=file("stack.zip"), rig="nobody", lens="lens")
assert isinstance(told, Problem) and told.code == Code.PROFILE_NOT_FOUND, told
told = AuthenticatedClient(base_url=url, token="wrong")
told = get_stack.sync(UUID(int=0), client=told)
assert told.code == Code.UNAUTHORIZED, told
print("the day is over")
