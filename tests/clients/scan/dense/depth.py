"""Depth maps by comparing each view with its neighbours.

In: pictures, masks, poses. Out: per view the depth of each pixel along the optical axis, mm; 0 where it is not known.

1. Plane sweep at half the resolution (Collins 1996): neighbours are warped to planes parallel to the sensor. The score
   of a plane is the normalised cross-correlation (NCC) in a window within the mask, in the mean of the better half of
   the neighbours, because the others may not see the point (Kang, Szeliski and Chai 2001).
2. Refinement at full resolution: the neighbours are warped to the surface of step 1, moved nearer and farther by parts
   of a pixel, so that windows follow slanted surfaces. The best place is interpolated by a parabola.
3. A depth stays if its score is good and the depths of at least two neighbours agree with it.
"""

import cv2
import numpy as np

# between the optical axes of two neighbours, degrees
LEAST_ANGLE, LARGEST_ANGLE, NEIGHBOURS = 5.0, 24.0, 6
WINDOW = 7
# variance of the noise, squared levels: keeps windows without detail from correlating by chance
NOISE_VARIANCE = 4.0
LEAST_SCORE = 0.6
# agreement with the depth of a neighbour, mm, and the number of neighbours
AGREEMENT_MM, AGREEING = 0.2, 2
# around the points that COLMAP found, mm
ROOM_MM = 1.5


def neighbours(views):
    """Per view the indices of those that see it from a useful angle, nearest first."""
    axes = np.array([view.rotation[2] for view in views])
    angles = np.degrees(np.arccos(np.clip(axes @ axes.T, -1, 1)))
    useful = [[at for at in np.argsort(row) if LEAST_ANGLE <= row[at] <= LARGEST_ANGLE] for row in angles]
    return [row[:NEIGHBOURS] for row in useful]


class Comparison:
    """A view against its neighbours, at one resolution and within the box of its mask."""

    def __init__(self, camera, views, grey, masks, at, others, shrink):
        size = (grey[at].shape[1] // shrink, grey[at].shape[0] // shrink)
        # a pixel of the smaller picture is the mean of shrink x shrink pixels
        to_small = np.array([[1 / shrink, 0, 0.5 / shrink - 0.5], [0, 1 / shrink, 0.5 / shrink - 0.5], [0, 0, 1]])
        small = lambda picture: cv2.resize(picture, size, interpolation=cv2.INTER_AREA) if shrink > 1 else picture
        self.camera = to_small @ camera
        self.grey = small(grey[at])
        self.mask = (small(masks[at]) > 0.5).astype(np.float32)
        x, y, width, height = cv2.boundingRect((self.mask > 0).astype(np.uint8))
        self.box = (slice(y, y + height), slice(x, x + width))
        self.grey, self.mask = self.grey[self.box], self.mask[self.box]
        columns, rows = np.meshgrid(np.arange(x, x + width), np.arange(y, y + height))
        # per pixel the point at depth 1
        self.rays = np.stack([columns, rows, np.ones_like(rows)], -1) @ np.linalg.inv(self.camera).T
        self.others = []
        for other in others:
            rotation = views[other].rotation @ views[at].rotation.T
            shift = views[other].translation - rotation @ views[at].translation
            # pixels at depth z are seen at (z turned + shifted) in homogeneous coordinates
            turned = (self.rays @ (self.camera @ rotation).T).astype(np.float32)
            allowed = cv2.dilate(small(masks[other]), np.ones((3, 3)))
            self.others.append((small(grey[other]), allowed, turned, (self.camera @ shift).astype(np.float32)))
        self.count = np.maximum(self.sum(self.mask), 1)
        self.mean = self.sum(self.mask * self.grey) / self.count
        self.variance = self.sum(self.mask * self.grey**2) / self.count - self.mean**2

    def sum(self, plane):
        """Sums over windows."""
        return cv2.boxFilter(plane, cv2.CV_32F, (WINDOW, WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT)

    def step(self, pixels):
        """The step of inverse depth that moves the picture in the neighbour of median distance by this many pixels."""
        shifts = [np.linalg.norm(np.linalg.solve(self.camera, shift)[:2]) for *_, shift in self.others]
        return pixels / (self.camera[0, 0] * np.median(shifts))

    def score(self, inverse):
        """NCC for this inverse depth, a number or one per pixel; -1 where a neighbour sees the background there."""
        scores, hull = [], np.ones_like(self.grey)
        inverse = np.asarray(inverse, np.float32)
        for picture, allowed, turned, shift in self.others:
            seen = turned + inverse[..., None] * shift
            columns, rows = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
            warped = cv2.remap(picture, columns, rows, cv2.INTER_LINEAR)
            hull = np.minimum(hull, cv2.remap(allowed, columns, rows, cv2.INTER_NEAREST))
            masked = self.mask * warped
            mean = self.sum(masked) / self.count
            variance = self.sum(masked * warped) / self.count - mean**2
            both = self.sum(masked * self.grey) / self.count - mean * self.mean
            scores.append(both / np.sqrt((self.variance + NOISE_VARIANCE) * (np.maximum(variance, 0) + NOISE_VARIANCE)))
        better = np.sort(np.stack(scores), 0)[len(scores) // 2 :]
        return np.where(hull > 0.5, better.mean(0), -1).astype(np.float32)


def best(comparison, hypotheses):
    """The score of the best hypothesis per pixel, and its index, interpolated by a parabola through its neighbours."""
    shape = comparison.grey.shape
    top, place = np.full(shape, -2, np.float32), np.zeros(shape, np.float32)
    below, above = np.full(shape, -2, np.float32), np.full(shape, -2, np.float32)
    previous = np.full(shape, -2, np.float32)
    for at, inverse in enumerate(hypotheses):
        score = comparison.score(inverse)
        after = place == at - 1
        above[after] = score[after]
        better = score > top
        top[better], place[better], below[better] = score[better], at, previous[better]
        previous = score
    curve = below - 2 * top + above
    usable = (place > 0) & (place < len(hypotheses) - 1) & (below > -1) & (above > -1) & (curve < -1e-6)
    offset = np.where(usable, 0.5 * (below - above) / np.where(usable, curve, 1), 0)
    return top, place + np.clip(offset, -0.5, 0.5)


def depth_map(model, grey, masks, at, others):
    """Steps 1 and 2 for one view. Returns depth and score in the size of the picture."""
    view = model.views[at]
    coarse = Comparison(model.camera, model.views, grey, masks, at, others, 2)
    depths = (model.points @ view.rotation.T + view.translation)[:, 2]
    far, near = 1 / (np.percentile(depths, 99.9) + ROOM_MM), 1 / (np.percentile(depths, 0.1) - ROOM_MM)
    planes = np.arange(far, near, coarse.step(0.6))
    _, place = best(coarse, planes)
    inverse = far + coarse.step(0.6) * place
    inverse = cv2.medianBlur(inverse.astype(np.float32), 5)

    full = Comparison(model.camera, model.views, grey, masks, at, others, 1)
    # by coordinates, because the boxes of the two resolutions need not match
    rows, columns = [np.arange(part.start, part.stop, dtype=np.float32) for part in full.box]
    halved = [(at + 0.5) / 2 - 0.5 - part.start for at, part in [(columns, coarse.box[1]), (rows, coarse.box[0])]]
    columns, rows = np.meshgrid(*halved)
    inverse = cv2.remap(inverse, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    for pixels, reach in [(0.5, 5), (0.2, 4)]:
        step = full.step(pixels)
        top, place = best(full, [inverse + step * by for by in range(-reach, reach + 1)])
        inverse = inverse + (step * (place - reach)).astype(np.float32)
        if pixels > 0.2:
            inverse = cv2.medianBlur(inverse, 5)
    depth, score = np.zeros_like(grey[at]), np.zeros_like(grey[at])
    depth[full.box] = full.mask / inverse
    score[full.box] = top
    return depth, score


def consistent(model, depths, at, others):
    """The depth of one view where enough neighbours agree, else 0."""
    view, depth = model.views[at], depths[at]
    rows, columns = np.nonzero(depth)
    rays = np.stack([columns, rows, np.ones_like(rows)]).astype(np.float64)
    points = np.linalg.inv(model.camera) @ rays * depth[rows, columns]
    world = view.rotation.T @ (points - view.translation[:, None])
    agreeing = np.zeros(len(rows), int)
    for other in others:
        there = model.views[other].rotation @ world + model.views[other].translation[:, None]
        seen = model.camera @ there
        x, y = np.rint(seen[:2] / seen[2]).astype(int)
        inside = (x >= 0) & (y >= 0) & (x < depth.shape[1]) & (y < depth.shape[0])
        found = np.where(inside, depths[other][np.where(inside, y, 0), np.where(inside, x, 0)], 0)
        agreeing += np.abs(found - there[2]) < AGREEMENT_MM
    kept = np.zeros_like(depth)
    good = agreeing >= AGREEING
    kept[rows[good], columns[good]] = depth[rows[good], columns[good]]
    return kept


def depth_maps(model, grey, masks):
    """Depth maps of all views."""
    others = neighbours(model.views)
    raw = []
    for at in range(len(model.views)):
        depth, score = depth_map(model, grey, masks, at, others[at])
        raw.append(np.where(score >= LEAST_SCORE, depth, 0).astype(np.float32))
    return [consistent(model, raw, at, others[at]) for at in range(len(raw))]
