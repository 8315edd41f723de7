"""A day with the client that openapi-generator makes for Python."""

import sys
from pathlib import Path
from uuid import UUID

import pinstack_client
from pinstack_client import Code, JobState, ProfileInput, RerunOptions
from pinstack_client.exceptions import ApiException, ConflictException, NotFoundException, UnauthorizedException

url, token, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
client = pinstack_client.ApiClient(pinstack_client.Configuration(host=url, access_token=token))
profiles = pinstack_client.ProfilesApi(client)
calibrations = pinstack_client.CalibrationsApi(client)
stacks = pinstack_client.StacksApi(client)
ENDED = (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELLED)


def ended(get, job):
    while job.state not in ENDED:
        job = get(job.id, prefer="wait=30")
    return job


def refusal(kind, call, *arguments, **options):
    try:
        call(*arguments, **options)
    except kind as error:
        return error.data
    raise AssertionError("it was not refused")


profile = ProfileInput.from_json((folder / "profile.json").read_text())
assert profiles.put_profile("rig", "lens", profile).revision == 1

calibration = calibrations.calibrate("measured", "lens", str(folder / "target.zip"), focal_mm=65.0)
calibration = ended(calibrations.get_calibration, calibration)
assert calibration.state == JobState.SUCCEEDED, calibration.error
assert calibration.result.profile_revision == 1 and calibration.options.focal_mm == 65.0

stack = stacks.send_stack(str(folder / "stack.zip"), rig="rig", lens="lens", label="by a path")
stack = ended(stacks.get_stack, stack)
assert stack.state == JobState.SUCCEEDED and stack.options.label == "by a path" and stack.options.r1 == 45, stack
image = stacks.get_stack_image(stack.id)
assert image[:8] == b"\x89PNG\r\n\x1a\n", image[:100]
assert len(stacks.get_stack_metrics(stack.id).slices) == 4

second = stacks.send_stack((folder / "stack.zip").read_bytes(), rig="rig", lens="lens", idempotency_key="second")
assert stacks.send_stack(str(folder / "stack.zip"), rig="rig", lens="lens", idempotency_key="second").id == second.id

seen, cursor = [], None
while True:
    page = stacks.list_stacks(limit=1, cursor=cursor)
    assert len(page.items) <= 1, page
    seen += [item.id for item in page.items]
    cursor = page.next_cursor
    if cursor is None:
        break
assert seen == [second.id, stack.id], seen

try:
    stacks.cancel_stack(second.id)
except ConflictException as error:
    assert error.data.code == Code.CONFLICT, error
stacks.delete_stack(second.id)

again = ended(stacks.get_stack, stacks.rerun_stack(stack.id, rerun_options=RerunOptions(label="again")))
assert again.state == JobState.SUCCEEDED and again.rerun_of == stack.id and again.options.label == "again", again
assert stacks.get_stack_upload(again.id) == (folder / "stack.zip").read_bytes()

told = refusal(NotFoundException, stacks.get_stack, second.id)
assert told.code == Code.NOT_FOUND and told.status == 404, told
told = refusal(NotFoundException, stacks.send_stack, str(folder / "stack.zip"), rig="nobody", lens="lens")
assert told.code == Code.PROFILE_NOT_FOUND, told
told = refusal(ApiException, stacks.send_stack, str(folder / "stack.zip"), rig="rig")
assert told.code == Code.INVALID_REQUEST and told.status == 400, told
stranger = pinstack_client.ApiClient(pinstack_client.Configuration(host=url, access_token="wrong"))
told = refusal(UnauthorizedException, pinstack_client.StacksApi(stranger).get_stack, UUID(int=0))
assert told.code == Code.UNAUTHORIZED, told
print("the day is over")
