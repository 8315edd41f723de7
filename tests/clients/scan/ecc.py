"""Aligns the slices of a folder by their content: an affine transform to the neighbour that is nearer to the reference,
by OpenCV's findTransformECC, as most focus stackers do.

Usage: ecc.py FOLDER REFERENCE. Prints a JSON list of homographies, slice px -> reference px.
"""

import json
import pathlib
import sys

import cv2
import numpy as np

folder, reference = pathlib.Path(sys.argv[1]), int(sys.argv[2])
slices = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(folder.iterdir())]
found = [np.eye(3) for _ in slices]
criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 200, 1e-7)
for at in [*range(reference - 1, -1, -1), *range(reference + 1, len(slices))]:
    neighbour = at + 1 if at < reference else at - 1
    start = np.eye(2, 3, dtype=np.float32)
    # maps a pixel of the neighbour to a pixel of the slice
    _, affine = cv2.findTransformECC(slices[neighbour], slices[at], start, cv2.MOTION_AFFINE, criteria, None, 5)
    to_neighbour = np.linalg.inv(np.vstack([affine, [0, 0, 1]]))
    found[at] = found[neighbour] @ to_neighbour
print(json.dumps([(h / h[2, 2]).flatten().tolist() for h in found]))
