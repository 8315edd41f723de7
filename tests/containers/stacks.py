"""Stacks to send, and a client of the service."""

import functools
import io
import zipfile

from PIL import Image, ImageFilter
from pinstack import Client, Retry

# a job of a second or two: long enough to be killed in the middle
LARGE = (3000, 2000, 12)
SMALL = (300, 200, 3)
FULL_SIZE = (6000, 4000, 4)


@functools.cache
def stack(width, height, slices):
    """A zip with noise that is sharp in one band of each slice."""
    noise = Image.effect_noise((width, height), 60).convert("RGB")
    blurred = noise.filter(ImageFilter.BoxBlur(2))
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for index in range(slices):
            picture, top = blurred.copy(), index * height // slices
            band = (0, top, width, top + height // slices)
            picture.paste(noise.crop(band), band)
            jpeg = io.BytesIO()
            picture.save(jpeg, "JPEG", quality=90)
            archive.writestr(f"front/{index:02}.jpg", jpeg.getvalue())
    return buffer.getvalue()


def client(url="http://127.0.0.1:8080", token=None, attempts=40, **options):
    """A client that tries again for half a minute, as one on a capture PC does."""
    return Client(url, token, retry=Retry(attempts=attempts, first_s=0.2, longest_s=1), **options)


def with_profile(service, size):
    """Waits for the service, and stores a profile for stacks of this size."""
    width, height, slices = size
    same = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    lens = f"lens-{width}-{slices}"
    service.info()  # a read is repeated until the service answers
    profile = {"image_width": width, "image_height": height, "homographies": [same] * slices}
    service.put_profile("rig", lens, {**profile, "reference_index": slices // 2})


def send(service, size, label="stack", **options):
    """Sends a stack and does not wait for it."""
    return service.send_stack(stack(*size), "rig", f"lens-{size[0]}-{size[2]}", label=label, **options)


def ended(service, job, timeout_s=120):
    """Waits for a stack that must succeed."""
    job = service.wait(job, timeout_s=timeout_s, check=False)
    assert job["state"] == "succeeded", job
    return job
