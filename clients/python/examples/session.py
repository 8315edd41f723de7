"""A session: calibrate, fuse, look at the numbers, send a scan, get a bundle.

Each ``# %%`` begins a cell for editors that run scripts like notebooks. Run it in the folder that
``pinstack demo --out FOLDER`` wrote, while ``pinstack serve`` runs:

    python session.py
"""

# %% The service: its address and token come from PINSTACK_URL and PINSTACK_TOKEN.
import zipfile

import numpy as np

from pinstack import Client, PinstackError

client = Client()
print("pinstack", client.info()["version"])

# %% Calibrate the rig and the lens with photographs of a dot target.
calibration = client.calibrate("bench-1", "macro65", "target.zip", focal_mm=65, pixel_pitch_mm=0.02)
matrices = client.homographies("bench-1", "macro65")
print(len(matrices), "slices; the last is scaled by", round(float(np.sqrt(np.linalg.det(matrices[-1, :2, :2]))), 4))

# %% Fuse a stack, with a height map. The folder is zipped while it is sent.
for view in ("pan000_tilt15", "pan020_tilt15"):
    with zipfile.ZipFile("stack.zip") as archive:
        archive.extractall(f"views/{view}")
stack = client.fuse(
    "views/pan000_tilt15",
    "bench-1",
    "macro65",
    label="beetle",
    height="auto",
    on_bytes=lambda sent, total: print(f"{100 * sent // total} % sent", end="\r"),
    on_progress=lambda progress: print(progress["stage"], f"{progress['fraction']:.0%}"),
)
client.save_artifact(stack, "image", "beetle.png")

# %% The results as arrays.
image, mask, height = client.image(stack), client.mask(stack), client.height(stack)
print(image.shape, image.dtype, f"the object is {np.mean(mask > 0):.1%} of the image")
info = client.get_stack(stack)["height"]
assert info is not None
print(f"heights from {np.nanmin(height):.2f} to {np.nanmax(height):.2f}", info["unit"])
for finding in client.metrics(stack)["findings"]:
    print(finding["severity"], finding["code"])

# %% An error has a code for programs and a sentence for people.
try:
    client.fuse("views/pan000_tilt15", "bench-1", "macro66")
except PinstackError as error:
    print(error.code, "-", error)

# %% A scan: first how the views are grouped, then the views.
client.put_scan("beetle", "bench-1", "macro65", specimen="C-17", radius_mm=140.0)
for found in client.group("beetle", "views")["views"]:
    print(found["folder"], found["pan_deg"], found["tilt_deg"], found["front"], found["back"])
client.send_scan("beetle", "views")
client.wait_scan("beetle", on_view=print)

# %% The table of the views, and the bundle for COLMAP.
table = client.scan_table("beetle")
print(table[["name", "pan_deg", "sharpness", "residual_px"]])
client.save_bundle("beetle", "colmap", "beetle-colmap.zip")
client.close()
