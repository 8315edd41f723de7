"""What Schemathesis must be told of bodies that are files."""

import schemathesis


@schemathesis.serializer(
    "application/zip",
    "application/x-npy",
    "application/x-npz",
    "application/octet-stream",
    "application/offset+octet-stream",
)
def as_it_is(ctx, value):
    return value if isinstance(value, bytes) else str(value).encode()
