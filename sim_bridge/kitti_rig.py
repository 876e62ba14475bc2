"""Where LiDAR and camera are in each frame of a recording, and boxes from the camera's axes into
the world and back.

A box's centre and the direction in which it looks, both in the axes of the camera of frame k
(x right, y down, z forward), become with the calibration C (camera -> LiDAR) and the pose R_k, t_k

    p_world = R_k (C p_camera) + t_k + (0, 0, SENSOR_HEIGHT),   p_camera = bottom - (0, h / 2, 0)
    yaw = atan2(y, x) of R_k (C d_camera) without C's shift,    d_camera = (cos ry, 0, -sin ry)

The world has the LiDAR's axes in frame 0 (x forward, y left, z up), with the ground under it at
z = 0 as in every simulated trace. Boxes stand upright: how the road tilts them is dropped. Back in
the camera's axes they have the ry from which the yaw came.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdkf.tables import Detections, FloatArray, IntArray, Trace, Tracks
from scenarios.kitti import SENSOR_HEIGHT
from sim_bridge.kitti_files import CameraBoxes, read_calibration, read_poses


@dataclass(frozen=True, eq=False)
class Rig:
    """Where LiDAR and camera are: camera (4, 4) camera -> LiDAR, and in each frame the LiDAR's
    rotation (n_frames, 3, 3) and position (n_frames, 3) [m] in the world."""

    camera: FloatArray
    rotation: FloatArray
    position: FloatArray

    @staticmethod
    def read(root: Path, sequence: str, n_frames: int) -> "Rig":
        """From the sequence's calibration and poses; `KittiError` for bad files."""
        camera = read_calibration(file_of(root, "calib", sequence))
        rotation, translation = read_poses(file_of(root, "pose", sequence), n_frames)
        return Rig(camera, rotation, translation + np.array([0.0, 0.0, SENSOR_HEIGHT]))

    def lidar(self) -> dict[str, FloatArray]:
        """The LiDAR's x, y, z [m] and yaw [rad] in every frame, each (n_frames,)."""
        yaw = _yaw(self.rotation[:, :, 0])
        return {**dict(zip("xyz", self.position.T, strict=True)), "yaw": yaw}

    def world_boxes(self, boxes: CameraBoxes) -> dict[str, FloatArray]:
        """Centres x, y, z [m], yaw [rad] and sizes [m] of boxes in the world, each (n,)."""
        centre = boxes.bottom.copy()
        centre[:, 1] -= boxes.height / 2
        zero = np.zeros(len(boxes.ry))
        ahead = np.column_stack([np.cos(boxes.ry), zero, -np.sin(boxes.ry)])
        rotation = self.rotation[boxes.frame]
        by_lidar = centre @ self.camera[:3, :3].T + self.camera[:3, 3]
        position = np.einsum("nij,nj->ni", rotation, by_lidar) + self.position[boxes.frame]
        direction = np.einsum("nij,nj->ni", rotation, ahead @ self.camera[:3, :3].T)
        return {
            **dict(zip("xyz", position.T, strict=True)),
            "yaw": _yaw(direction),
            "length": boxes.length,
            "width": boxes.width,
            "height": boxes.height,
        }

    def camera_boxes(self, table: Trace | Detections | Tracks) -> tuple[FloatArray, FloatArray]:
        """Middles of the bottom faces (n, 3) [m] and ry (n,) [rad] of a table's boxes in the
        camera of their frame: the inverse of `world_boxes`."""
        rotation = self.rotation[table.frame]
        centre = np.column_stack([table.x, table.y, table.z]) - self.position[table.frame]
        # Rounded in their files, the rotations' inverses are not quite their transposes.
        by_lidar = np.linalg.solve(rotation, centre[:, :, None])[:, :, 0]
        back = np.linalg.inv(self.camera)
        bottom = by_lidar @ back[:3, :3].T + back[:3, 3]
        bottom[:, 1] += table.height / 2
        return bottom, self._ry(table.frame, table.yaw)

    def _ry(self, frame: IntArray, yaw: FloatArray) -> FloatArray:
        """ry (n,) [rad] at which a box in the camera of a frame looks along yaw on the ground.

        d = cos(ry) X - sin(ry) Z, with the camera's x and z axes X, Z in the world, has no part
        across the yaw where (cos ry, sin ry) is along (Z, X) taken across; the sign looks ahead.
        """
        axes = self.rotation[frame] @ self.camera[:3, :3]
        along = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))])
        across = np.column_stack([-np.sin(yaw), np.cos(yaw), np.zeros(len(yaw))])
        x_along, _, z_along = np.einsum("nij,ni->jn", axes, along)
        x_across, _, z_across = np.einsum("nij,ni->jn", axes, across)
        sign = np.where(z_across * x_along - x_across * z_along < 0.0, -1.0, 1.0)
        ry: FloatArray = np.arctan2(sign * x_across, sign * z_across)
        return ry


def file_of(root: Path, folder: str, sequence: str) -> Path:
    """A sequence's file in one of the root's folders."""
    return root / folder / f"{sequence}.txt"


def _yaw(direction: FloatArray) -> FloatArray:
    """Angle (n,) on the ground of directions (n, 3), in (-pi, pi]."""
    yaw = np.arctan2(direction[:, 1], direction[:, 0])
    return np.where(yaw == -np.pi, np.pi, yaw)
