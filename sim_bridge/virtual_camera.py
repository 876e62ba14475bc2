"""The camera and satellite navigation that a simulated sensor carries, as KITTI's files tell them.

The LiDAR is where the ego path is, looks along its yaw and stands upright. The camera is mounted on
it as KITTI's is (0.27 m before and 0.08 m below it, along the same axes) and has KITTI's focal
length and picture: it sees what is within 81 degrees ahead. The navigation unit is in the LiDAR
itself. Its positions are latitudes and longitudes, by the Mercator projection of KITTI's devkit,

    x = s R lon,   y = s R ln tan(pi / 4 + lat / 2),   s = cos(lat of frame 0),  R = 6378137 m
"""

import numpy as np

from mdkf.tables import EgoPath, FloatArray
from scenarios.kitti import SENSOR_HEIGHT
from sim_bridge.kitti_image import KITTI_PICTURE, Camera
from sim_bridge.kitti_rig import Rig

PROJECTION = np.array(
    [[721.5377, 0.0, 609.5593, 0.0], [0.0, 721.5377, 172.854, 0.0], [0.0, 0.0, 1.0, 0.0]]
)
"""P2 (3, 4) of KITTI's val sequences, without the shift between its four cameras."""

MOUNTING = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, -0.08], [1.0, 0.0, 0.0, -0.27]])
"""Tr_velo_to_cam (3, 4): LiDAR -> camera [m]."""

EARTH_RADIUS = 6378137.0
"""Of the devkit's projection [m]."""

START = np.radians([49.01, 8.43])
"""Latitude and longitude of frame 0 [rad]: Karlsruhe. Only what changes from there matters."""


def virtual_camera(ego: EgoPath) -> Camera:
    """The camera along an ego path."""
    cosine, sine = np.cos(ego.yaw), np.sin(ego.yaw)
    rotation = np.zeros((len(ego), 3, 3))
    rotation[:, 0, 0] = rotation[:, 1, 1] = cosine
    rotation[:, 0, 1], rotation[:, 1, 0] = -sine, sine
    rotation[:, 2, 2] = 1.0
    mounting = np.vstack([MOUNTING, [0.0, 0.0, 0.0, 1.0]])
    position = np.column_stack([ego.x, ego.y, ego.z])
    rig = Rig(np.linalg.inv(mounting), rotation, position)
    return Camera(rig, PROJECTION, KITTI_PICTURE)


def calibration_text() -> str:
    """`calib/SSSS.txt`. Its last line, the picture's size, is from KITTI's raw recordings."""
    size = np.array([KITTI_PICTURE.right + 1, KITTI_PICTURE.bottom + 1])
    entries = {
        **{f"P{k}": PROJECTION for k in range(4)},
        "R0_rect": np.eye(3),
        "Tr_velo_to_cam": MOUNTING,
        "Tr_imu_to_velo": np.eye(3, 4),
        "S_rect_02": size,
    }
    return "".join(f"{key}: {_numbers(values)}\n" for key, values in entries.items())


def robmot_calibration_text() -> str:
    """The same with the names that KITTI's own files have and RobMOT looks for, which are without a
    colon."""
    text = calibration_text()
    for name, own in (
        ("R0_rect:", "R_rect"),
        ("Tr_velo_to_cam:", "Tr_velo_cam"),
        ("Tr_imu_to_velo:", "Tr_imu_velo"),
    ):
        text = text.replace(name, own)
    return text


def poses_text(ego: EgoPath) -> str:
    """`pose/SSSS.txt`: LiDAR -> world in every frame. The world is the trace's, but for its height:
    recordings have the road at -`SENSOR_HEIGHT`."""
    rig = virtual_camera(ego).rig
    down = np.array([0.0, 0.0, SENSOR_HEIGHT])
    poses = np.concatenate([rig.rotation, (rig.position - down)[:, :, None]], axis=2)
    return "".join(f"{k} {_numbers(pose)}\n" for k, pose in enumerate(poses))


def oxts_text(ego: EgoPath) -> str:
    """`oxts/SSSS.txt`: KITTI's 30 columns in every frame.

    Position, height above the road and yaw are the ego path's; velocities, accelerations and turn
    rates their differences, of which one frame alone has none (0).
    """
    place = np.column_stack([ego.x, ego.y, ego.z])
    scale = EARTH_RADIUS * np.cos(START[0])
    east, north = ((place - place[0]) / scale)[:, :2].T
    begin = np.arctanh(np.sin(START[0]))  # ln tan(pi / 4 + lat / 2)
    latitude = np.arcsin(np.tanh(begin + north))
    degrees = np.degrees(np.column_stack([latitude, START[1] + east]))
    velocity = _differences(place, ego.dt)
    acceleration = _differences(velocity, ego.dt)
    turn = _differences(np.unwrap(ego.yaw), ego.dt)
    zero = np.zeros(len(ego))
    columns = [
        *degrees.T,
        *(ego.z, zero, zero, ego.yaw),  # alt, roll, pitch, yaw
        *(velocity[:, 1], velocity[:, 0], *_along(velocity, ego.yaw)),  # vn, ve, vf, vl, vu
        *_along(acceleration, ego.yaw),  # ax, ay, az
        *_along(acceleration, ego.yaw),  # af, al, au: the same, as it stands upright
        *(zero, zero, turn, zero, zero, turn),  # wx, wy, wz, wf, wl, wu
        *(zero, zero),  # accuracies
    ]
    flags = "4 11 6 6 6"  # navstat, numsats, posmode, velmode, orimode of a good fix
    rows = np.column_stack(columns).tolist()
    return "".join(f"{' '.join(f'{v:.14f}' for v in row)} {flags}\n" for row in rows)


def _along(vector: FloatArray, yaw: FloatArray) -> FloatArray:
    """Forward, left and up parts (3, n) of vectors (n, 3) in the world."""
    cosine, sine = np.cos(yaw), np.sin(yaw)
    x, y, z = vector.T
    return np.array([cosine * x + sine * y, cosine * y - sine * x, z])


def _differences(values: FloatArray, dt: float) -> FloatArray:
    """Central differences by time, one-sided at the ends."""
    if len(values) < 2:
        return np.zeros_like(values)
    rates: FloatArray = np.gradient(values, dt, axis=0)
    return rates


def _numbers(values: FloatArray) -> str:
    return " ".join(f"{value:.12e}" for value in values.ravel().tolist())
