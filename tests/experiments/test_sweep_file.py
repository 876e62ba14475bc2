"""Claim: a sweep's file says what a script would, and one that does not is refused in one line."""

from pathlib import Path

import pytest

import sim_bridge
from experiments.sweeps import Sweep, SweepError, read_sweep
from mdkf import MotionDynamics
from mdkf.kalman import Kalman
from tests.experiments.sweeping import FILE, small


def test_a_file_is_the_same_sweep(tmp_path: Path) -> None:
    """What a script says with objects a file says in YAML."""
    path = tmp_path / "sweep.yaml"
    path.write_text(
        FILE
        + "tracker: {gate: [3, 4]}\n"
        + 'detectors: [pointrcnn, "pvrcnn"]\n'
        + "gap_truth: ignore\n"
    )
    same = small(
        seeds=8,
        occlusions=["none", "mid:10"],
        tracker=[{"gate": 3}, {"gate": 4}],
        detectors=["pointrcnn", "pvrcnn"],
        gap_truth="ignore",
    )
    assert read_sweep(path) == same
    assert len(same) == 3 * 8 * 2 * 2 * 2 * 2


def test_options_that_are_lists_are_crossed(tmp_path: Path) -> None:
    """Of filters and protocols; a name of its own stays with each."""
    path = tmp_path / "sweep.yaml"
    path.write_text(
        "scenarios: [stationary]\n"
        "filters:\n"
        "  - {name: md, options: {window: [5, 20], after_gap: keep}}\n"
        "  - {name: ca, as: wide, options: {start_variance: [[2, 100, 8, 8]]}}\n"
        "occlusions: [{kind: mid, length: [5, 10], warmup: [20, 35]}, none,"
        " {kind: switch, length: 5, start: [-5, 5], gaps: 2}]\n"
    )
    own = read_sweep(path)
    assert [(one.name, one.estimator) for one in own.filters] == [
        ("md(window=5, after_gap=keep)", MotionDynamics(window=5, after_gap="keep")),
        ("md(window=20, after_gap=keep)", MotionDynamics(window=20, after_gap="keep")),
        ("wide", Kalman(order=2, start_variance=(2, 100, 8, 8))),
    ]
    assert list(map(str, own.occlusions)) == [
        *("mid:5:20", "mid:5:35", "mid:10:20", "mid:10:35"),
        *("none", "switch:5:35:gaps=2:start=-5", "switch:5:35:gaps=2:start=5"),
    ]


LIST = list(range(7))
CROSSED = (
    f"scenarios: [{{name: passing_bus, parameters: {{a: {LIST}, b: {LIST}, c: {LIST}}}}}]\n"
    "seeds: [0, 1]\n"
    "filters: [ca, {name: md, options: {window: [10, 20]}}]\n"
    f"occlusions: [{{kind: mid, length: {LIST}, warmup: {list(range(1, 101))}}}]\n"
    f"tracker: {{gate: {list(range(1, 1001))}}}\n"
)
"""What is counted before it is crossed: parameters that do not exist are not reached."""

BAD = {
    "scenarios: [stationary]": "missing key filters",
    "scenarios: [stationary]\nfilters: [ca]\nseed: 3": "unknown key seed",
    "scenarios: [nowhere]\nfilters: [ca]": "unknown scenario 'nowhere'",
    "scenarios: []\nfilters: [ca]": "key scenarios",
    "scenarios: [stationary]\nfilters: [kalman]": "unknown filter 'kalman'",
    "scenarios: [stationary]\nfilters: [ca, ca]": "filters: ca is there twice",
    "scenarios: [{name: stationary, parameters: {y: [8, 1.0e+9]}}]\nfilters: [ca]": "parameter y",
    "scenarios: [{name: stationary, parameters: {q: 1}}]\nfilters: [ca]": "unknown parameter 'q'",
    "scenarios: [stationary]\nfilters: [{name: md, options: {w: 1}}]": "unknown option 'w'",
    "scenarios: [stationary]\nfilters: [{name: md, options: {window: 1}}]": "filter 'md': window",
    "scenarios: [stationary]\nfilters: [ca]\ntracker: {gates: 1}": "unknown rule 'gates'",
    "scenarios: [stationary]\nfilters: [ca]\ntracker: {gate: -1}": "gate is -1",
    "scenarios: [stationary]\nfilters: [ca]\nocclusions: ['mid:x']": "occlusion 'mid:x'",
    "scenarios: [stationary]\nfilters: [ca]\nocclusions: [{kind: mid, len: 3}]": "unknown key len",
    "scenarios: [stationary]\nfilters: [ca]\nocclusions: [{kind: up}]": "key occlusions",
    "scenarios: [stationary]\nfilters: [ca]\ndetectors: [eye]": "eye",
    "scenarios: [stationary]\nfilters: [ca]\ndetectors: ['recorded:pointrcnn']": "recorded",
    "scenarios: [stationary]\nfilters: [ca]\nseeds: 2000000": "2000000 runs",
    f"scenarios: [stationary]\nfilters: [ca]\nseeds: {10**20}": f"{10**20} runs",
    CROSSED: f"{7**3 * 2 * 3 * 7 * 100 * 1000} runs",
    "scenarios: [stationary]\nfilters: [{name: md, options: {window: 20.5}}]": "window is 20.5",
    "scenarios: [stationary]\nfilters: [{name: md, options: {window: wide}}]": "window is 'wide'",
    "scenarios: [stationary]\nfilters: [ca]\nseeds: [1, 1]": "seeds: 1 is there twice",
    "scenarios: [stationary]\nfilters: [ca]\nseeds: [-1]": "key seeds.0: ",
    "scenarios: *a": "YAML error",
    "- 1": "expected a mapping",
}


@pytest.mark.parametrize("text", BAD)
def test_a_bad_file_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    """It names the file and the key, before anything is run."""
    path = tmp_path / "sweep.yaml"
    path.write_text(text)
    with pytest.raises(Exception, match=BAD[text].replace("(", r"\(")) as refused:
        read_sweep(path)
    assert isinstance(refused.value, SweepError | sim_bridge.ProfileError)
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value) or isinstance(refused.value, sim_bridge.ProfileError)


def test_a_sweep_of_nothing_is_refused() -> None:
    """Every list has one entry at least."""
    with pytest.raises(SweepError, match="filters: expected one at least"):
        Sweep.of(["stationary"], [])
