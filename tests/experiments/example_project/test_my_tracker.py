import pytest
from my_tracker import AlphaBeta, track

import mdkf


def test_my_tracker(mdkf_trace, mdkf_detections, mdkf_regression):
    trace = mdkf_trace("golden:v1/stop_and_go")
    seen = mdkf_detections("golden:v1/stop_and_go", occlusion="mid:20")
    mdkf_regression(track(seen), trace, seen)


@pytest.mark.parametrize("world", ["bus_stop", "overtaking", "journey"])
def test_my_estimator(world, mdkf_trace, mdkf_detections, mdkf_regression):
    trace = mdkf_trace(f"golden:v1/{world}")
    seen = mdkf_detections(f"golden:v1/{world}")
    tracks = mdkf.Tracker(AlphaBeta(), max_missed=30).run(seen)
    mdkf_regression(tracks, trace, seen)


def test_my_tracker_keeps_objects_apart(mdkf_trace, mdkf_detections, mdkf_regression):
    trace = mdkf_trace("golden:v1/bus_stop")
    seen = mdkf_detections("golden:v1/bus_stop", occlusion="none")
    bounds = {"hota": 0.5, "idf1": "1 %", "idsw": 0}
    mdkf_regression(track(seen), trace, seen, metrics=tuple(bounds), tolerances=bounds)
