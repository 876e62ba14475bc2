"""Simulators and sensors: `simulate` makes a trace of a scenario, `detect` detections of a trace.

`kitti_trace` and `kitti_detections` read recorded KITTI data into the same tables; a scenario
`kitti-0001` and a detector `recorded:pointrcnn` do so through `simulate` and `detect`. `read_table`
and `write_table` carry the tables to Parquet files and back, `to_polars` and `from_polars` to data
frames; a `TraceCache` simulates only what it does not have. `read_results` reads what other
trackers made of exported detections.
"""

from sim_bridge.data_frame import from_polars, to_polars
from sim_bridge.detect import detect
from sim_bridge.kitti import kitti_detections, kitti_trace
from sim_bridge.kitti_files import KittiError
from sim_bridge.network_check import SimulationError
from sim_bridge.parquet import read_table, write_table
from sim_bridge.profile import Profile, ProfileError, load_profile, profile_names
from sim_bridge.recorded import check_detector, detector_name, is_recorded
from sim_bridge.results import read_results
from sim_bridge.simulate import DT, SeedRefused, check_inputs, simulate
from sim_bridge.trace_cache import TraceCache, user_cache

__all__ = [
    "DT",
    "KittiError",
    "Profile",
    "ProfileError",
    "SeedRefused",
    "SimulationError",
    "TraceCache",
    "check_detector",
    "check_inputs",
    "detect",
    "detector_name",
    "from_polars",
    "is_recorded",
    "kitti_detections",
    "kitti_trace",
    "load_profile",
    "profile_names",
    "read_results",
    "read_table",
    "simulate",
    "to_polars",
    "user_cache",
    "write_table",
]
