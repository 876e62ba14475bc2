"""Boxes of the world into the picture of a recording's camera, as KITTI's files hold them.

A box's eight corners p, in rectified camera axes, go to the pixels (u, v) = (a, b) / c with
(a, b, c) = P2 (p, 1), and what spans them, cut at the picture's edges, is the box in the picture.
Of a box that reaches behind the camera only the part in front of it is seen: its edges are cut at
the depth `NEAR` first, so that no corner behind the camera comes out on the wrong side. A box whose
middle is behind the camera is not in the picture, whatever else of it is: 4 of KITTI's 30601 labels
are such.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdkf.tables import BoolArray, Detections, FloatArray, IntArray, Trace, Tracks
from sim_bridge.kitti_files import (
    read_labels,
    read_picture_size,
    read_projection,
    read_sequences,
)
from sim_bridge.kitti_rig import Rig, file_of

NEAR = 0.1
"""Depth in front of the camera from which on things are seen [m]."""

DECIMALS = 6
"""Digits behind the point that KITTI's labels have, of metres, radians and pixels alike."""

NOWHERE = (-1.0, -1.0, -1.0, -1.0)
"""Box in the picture of what is not in it. It has no area and no height, so that KITTI's scorer
passes over it wherever it belongs to no label."""

SMALLEST = 1e-9
"""Area of a box in the picture below which it is none [px2]."""

_CORNERS = np.array([[x, y, z] for x in (0.5, -0.5) for y in (0.0, -1.0) for z in (0.5, -0.5)])
"""(8, 3) corners about the middle of the bottom face, in lengths, heights and widths."""

_EDGES = np.array(
    [(a, b) for a in range(8) for b in range(a) if np.sum(_CORNERS[a] != _CORNERS[b]) == 1]
)
"""(12, 2) corners that an edge joins."""


@dataclass(frozen=True)
class Picture:
    """Where boxes are cut: greatest coordinates right and bottom [px], the least being 0.

    robmot: whether boxes are as RobMOT's program writes them: rounded to whole pixels, and none
    that reaches behind the camera. (It projects corners from there mirrored, and asks for a corner
    of the spanned box within the picture.)
    """

    right: float
    bottom: float
    robmot: bool = False


KITTI_PICTURE = Picture(1241.0, 374.0)
"""The picture of most of KITTI's sequences, 1242 x 375 pixels."""


@dataclass(frozen=True, eq=False)
class PictureBoxes:
    """The boxes of a table that are in the picture, one row each, in the table's order.

    row: which row of the table; frame; image (n, 4): left, top, right, bottom [px]; bottom (n, 3):
    x, y, z of the middle of the bottom face in camera axes [m]; length, width, height [m]; ry and
    alpha, the direction against the ray from the camera [rad]. All values are rounded to
    `DECIMALS` digits: what is written and read again is the same to the last bit.
    """

    row: IntArray
    frame: IntArray
    image: FloatArray
    bottom: FloatArray
    length: FloatArray
    width: FloatArray
    height: FloatArray
    ry: FloatArray
    alpha: FloatArray


@dataclass(frozen=True, eq=False)
class Camera:
    """A recording's camera: where it is in every frame, its projection P2 (3, 4), its picture."""

    rig: Rig
    projection: FloatArray
    picture: Picture

    @staticmethod
    def read(root: Path, sequence: str, n_frames: int, picture: Picture) -> "Camera":
        """From the sequence's calibration and poses; `KittiError` for bad files."""
        projection = read_projection(file_of(root, "calib", sequence))
        return Camera(Rig.read(root, sequence, n_frames), projection, picture)

    def boxes(
        self,
        table: Trace | Detections | Tracks,
        picture: Picture | None = None,
        around: bool = False,
    ) -> PictureBoxes:
        """The boxes of a table, cut at the edges of the camera's own picture or of another.

        around: all boxes of the table; those that are not in the picture have the box `NOWHERE`.
        """
        picture = picture or self.picture
        bottom, ry = self.rig.camera_boxes(table)
        size = np.column_stack([table.length, table.height, table.width])
        seen, image = in_picture(bottom, size, ry, self.projection, picture)
        if around:
            image[~seen] = NOWHERE
            seen = np.ones(len(seen), dtype=np.bool_)
        alpha = np.angle(np.exp(1j * (ry - np.arctan2(bottom[:, 0], bottom[:, 2]))))
        length, height, width = _rounded(size[seen]).T
        return PictureBoxes(
            row=np.flatnonzero(seen),
            frame=table.frame[seen],
            image=_rounded(image[seen]),
            bottom=_rounded(bottom[seen]),
            length=length,
            width=width,
            height=height,
            ry=_rounded(ry[seen]),
            alpha=_rounded(alpha[seen]),
        )

    def truncation(self, table: Trace) -> IntArray:
        """KITTI's level of truncation of a table's boxes (n,): 0 within the picture, 1 for up to
        half of the box in the picture cut off by its edges, 2 for more or all of it."""
        bottom, ry = self.rig.camera_boxes(table)
        size = np.column_stack([table.length, table.height, table.width])
        seen, inside = in_picture(bottom, size, ry, self.projection, self.picture)
        _, whole = _spanned(_projected(bottom, size, ry, self.projection))
        share = np.where(seen, _area(inside), 0.0) / np.maximum(_area(whole), SMALLEST)
        return np.where(share >= 1.0, 0, np.where(share >= 0.5, 1, 2))


def in_picture(
    bottom: FloatArray,
    size: FloatArray,
    ry: FloatArray,
    projection: FloatArray,
    picture: Picture,
) -> tuple[BoolArray, FloatArray]:
    """Which boxes are in the picture (n,), and left, top, right, bottom (n, 4) [px] of each.

    bottom (n, 3): middle of the bottom face in camera axes [m]; size (n, 3): length, height and
    width [m]; ry (n,) [rad]; projection (3, 4). Where a box is not in the picture its row is 0.
    """
    corners = _projected(bottom, size, ry, projection)
    seen, image = _spanned(corners)
    seen &= bottom[:, 2] > 0.0
    edge = np.array([picture.right, picture.bottom])
    if picture.robmot:
        image = np.floor(image + 0.5)
        seen &= (corners[..., 2] > NEAR).all(axis=1)
    image = np.clip(image, 0.0, np.tile(edge, 2))
    seen &= (image[:, :2] < image[:, 2:]).all(axis=1)
    return seen, np.where(seen[:, None], image, 0.0)


def pictures(root: Path, sequences: Iterable[str]) -> dict[str, Picture]:
    """The picture of each sequence: where its calibration does not tell the size, which KITTI's own
    never does, its labels do.

    A label ends at the last pixel where its car leaves the picture: where at least two end at the
    greatest x or y of all labels seen by the same camera (the same P2), that is the edge. Else
    nothing left the picture there, and the edge is `KITTI_PICTURE`'s, or the greatest coordinate
    if that is further. `KittiError` for bad files.
    """
    sequences = tuple(sequences)
    sizes = {name: read_picture_size(file_of(root, "calib", name)) for name in sequences}
    known = {name: Picture(size[0] - 1, size[1] - 1) for name, size in sizes.items() if size}
    unknown = [name for name in sequences if name not in known]
    return {**known, **(_told_by_labels(root, unknown) if unknown else {})}


def _told_by_labels(root: Path, sequences: Iterable[str]) -> dict[str, Picture]:
    """The pictures of sequences whose size nothing but labels tells."""
    cameras = {name: read_projection(file_of(root, "calib", name)) for name in sequences}
    ends: dict[bytes, list[FloatArray]] = {camera.tobytes(): [] for camera in cameras.values()}
    for name, n_frames in read_sequences(root).items():
        labels = file_of(root, "label_02", name)
        if not (labels.is_file() and file_of(root, "calib", name).is_file()):
            continue  # not all of KITTI need be there
        camera = read_projection(file_of(root, "calib", name)).tobytes()
        if camera in ends:
            ends[camera].append(read_labels(labels, n_frames).image[:, 2:])
    edges = {camera: _picture(parts) for camera, parts in ends.items()}
    return {name: edges[camera.tobytes()] for name, camera in cameras.items()}


def _picture(parts: list[FloatArray]) -> Picture:
    """The picture whose boxes have the right and bottom ends of parts, (n, 2) each."""
    ends = np.concatenate([np.empty((0, 2)), *parts])
    greatest = ends.max(axis=0, initial=0.0)
    told = np.sum(ends == greatest, axis=0) > 1
    usual = np.array([KITTI_PICTURE.right, KITTI_PICTURE.bottom])
    right, bottom = np.where(told, greatest, np.maximum(greatest, usual)).tolist()
    return Picture(right, bottom)


def _projected(
    bottom: FloatArray, size: FloatArray, ry: FloatArray, projection: FloatArray
) -> FloatArray:
    """(n, 8, 3) the corners' pixels times their depth, and their depth [m]."""
    along, up, across = np.moveaxis(_CORNERS * size[:, None], 2, 0)
    cosine, sine = np.cos(ry)[:, None], np.sin(ry)[:, None]
    turned = np.stack([cosine * along + sine * across, up, cosine * across - sine * along], axis=2)
    corners = turned + bottom[:, None]
    return corners @ projection[:, :3].T + projection[:, 3]


def _spanned(corners: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Which boxes of projected corners (n, 8, 3) reach in front of `NEAR`, and what their parts
    in front of it span (n, 4) [px]; boxes that do not span everything from -inf to inf."""
    one, other = corners[:, _EDGES[:, 0]], corners[:, _EDGES[:, 1]]
    before, beyond = one[..., 2] - NEAR, other[..., 2] - NEAR
    crossing = (before > 0.0) != (beyond > 0.0)
    share = before / np.where(crossing, before - beyond, 1.0)
    cut = one + share[..., None] * (other - one)
    points = np.concatenate([corners, cut], axis=1)
    seen = np.concatenate([corners[..., 2] > NEAR, crossing], axis=1)[..., None]
    pixels = points[..., :2] / np.where(seen, points[..., 2:], 1.0)
    least = np.where(seen, pixels, np.inf).min(axis=1)
    most = np.where(seen, pixels, -np.inf).max(axis=1)
    front: BoolArray = np.logical_or.reduce(seen[..., 0], axis=1)
    return front, np.where(front[:, None], np.column_stack([least, most]), 0.0)


def _area(image: FloatArray) -> FloatArray:
    """Areas (n,) [px2] of boxes left, top, right, bottom (n, 4)."""
    area: FloatArray = (image[:, 2] - image[:, 0]) * (image[:, 3] - image[:, 1])
    return area


def _rounded(values: FloatArray) -> FloatArray:
    """To `DECIMALS` digits: the nearest double of a decimal number, which its digits give again."""
    return np.round(values, DECIMALS)
