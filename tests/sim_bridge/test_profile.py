"""Claim: a bad detector profile gives one line that names the file and the key."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from sim_bridge import ProfileError, load_profile, profile_names
from tests.sim_bridge.measured import MAX_RANGE, POINTRCNN, document


def refused(given: str | Path) -> str:
    with pytest.raises(ProfileError) as caught:
        load_profile(given)
    message = str(caught.value)
    assert "\n" not in message
    return message


def changed(folder: Path, keys: tuple[str, ...], value: Any) -> Path:
    """The shipped profile with one key set; None removes it."""
    numbers = document()
    inner = numbers
    for key in keys[:-1]:
        inner = inner[key]
    if value is None:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(numbers), encoding="utf-8")
    return path


def test_shipped_profiles_load_by_name_and_by_path() -> None:
    """Every listed name is a valid profile of that name, and its file is the same profile."""
    assert "pointrcnn" in profile_names()
    for name in profile_names():
        assert load_profile(name).name == name
        assert load_profile(POINTRCNN.with_name(f"{name}.yaml")) == load_profile(name)


@pytest.mark.parametrize("name", profile_names())
def test_a_profile_holds_the_numbers_of_its_file(name: str) -> None:
    """Nothing is rescaled or defaulted on the way; no pose in the file is none in the profile."""
    text = POINTRCNN.with_name(f"{name}.yaml").read_text(encoding="utf-8")
    assert load_profile(name).model_dump() == {"pose": None} | yaml.safe_load(text)


def test_what_need_not_be_given(tmp_path: Path) -> None:
    """Without side_share boxes are not shifted, without pose it is exactly known, and evidence is
    not evidence of anything."""
    profile = load_profile(changed(tmp_path, ("side_share",), None))
    assert profile.side_share == 0.0
    assert profile.pose is None
    assert load_profile(changed(tmp_path, ("evidence",), None)).evidence == {}
    pose = {"position": 0.02, "yaw": 0.001, "drift_time": 5.0}
    misplaced = load_profile(changed(tmp_path, ("pose",), pose)).pose
    assert misplaced is not None
    assert misplaced.model_dump() == pose
    evidence = {"cars": 120, "recall": 0.88, "detections": "mine"}
    assert load_profile(changed(tmp_path, ("evidence",), evidence)).evidence == evidence


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("detection", "half_points"), 0.0),
        (("detection", "range_hidden"), 0.0),
        (("lateral", "constant"), 0.0),
        (("yaw", "bias_per_range"), -0.01),
        (("radial", "tail"), 2.001),
        (("radial", "tail"), 1000.0),
        (("radial", "drift_share"), 0.0),
        (("flip", "constant"), -1000.0),
        (("flip", "hidden"), -1.0),
        (("score", "lowest"), -20.0),
        (("side_share",), -1.0),
        (("side_share",), 1.0),
        (("clutter", "min_range"), 0.0),
        (("clutter", "flashes", "density"), 0.0),
        (("clutter", "ghosts", "density"), 0.1),
        (("clutter", "ghosts", "reported"), 1.0),
        (("clutter", "ghosts", "jitter"), 0.0),
        (("clutter", "width", "deviation"), 0.0),
    ],
)
def test_the_ends_of_what_is_allowed(tmp_path: Path, keys: tuple[str, ...], value: float) -> None:
    """Bounds that belong to what they bound: no hidden term, no noise, no clutter."""
    inner = load_profile(changed(tmp_path, keys, value)).model_dump()
    for key in keys:
        inner = inner[key]
    assert inner == value


def test_unknown_names_list_the_known() -> None:
    """A misspelt name is told the right one; any other name what there is."""
    message = refused("pointrcn")
    assert "unknown detector 'pointrcn' (did you mean 'pointrcnn'?)" in message
    for name in profile_names():
        assert name in refused("lidar")
    assert "did you mean" not in refused("lidar")


@pytest.mark.parametrize(
    ("keys", "value", "reason"),
    [
        (("radial", "per_rnage"), 0.1, "unknown key"),
        (("colour",), "red", "unknown key"),
        (("clutter", "density"), 1e-4, "unknown key"),
        (("radial", "bias_per_range"), None, "missing key"),
        (("flip", "per_range"), None, "missing key"),
        (("clutter", "ghosts", "jitter"), None, "missing key"),
        (("clutter",), None, "missing key"),
        (("lateral", "hidden"), -0.1, "greater than or equal to 0"),
        (("lateral", "near"), -0.1, "greater than or equal to 0"),
        (("lateral", "per_range_squared"), -1e-5, "greater than or equal to 0"),
        (("score", "per_range"), -0.2, "greater than or equal to 0"),
        (("max_range",), 0.0, "greater than 0"),
        (("max_range",), float("inf"), "finite"),
        (("yaw", "constant"), float("nan"), "finite"),
        (("vertical", "drift_time"), 0.0, "greater than 0"),
        (("score", "fixed_share"), 1.5, "less than or equal to 1"),
        (("detection", "half_points"), -1.0, "greater than or equal to 0"),
        (("detection", "range_hidden"), -1.0, "greater than or equal to 0"),
        (("detection", "range_width"), 0.0, "greater than 0"),
        (("detection", "drift_share"), -0.1, "greater than or equal to 0"),
        (("radial", "tail"), 2.0, "greater than 2"),
        (("size", "width", "tail"), 1001.0, "less than or equal to 1000"),
        (("flip", "constant"), float("-inf"), "finite"),
        (("size", "length"), 0.2, "dictionary"),
        (("max_range",), "71.8", "valid number"),
        (("max_range",), True, "valid number"),
        (("max_range",), 2.0, "clutter.min_range must be below max_range"),
        (("clutter", "min_range"), MAX_RANGE, "clutter.min_range must be below max_range"),
        (("clutter", "flashes", "density"), 1e20, "less than or equal to 0.1"),
        (("clutter", "ghosts", "density"), 0.11, "less than or equal to 0.1"),
        (("clutter", "flashes", "score_mean"), 0.0, "greater than 0"),
        (("clutter", "ghosts", "life"), 0.0, "greater than 0"),
        (("clutter", "ghosts", "reported"), 1.1, "less than or equal to 1"),
        (("clutter", "ghosts", "reported"), -0.1, "greater than or equal to 0"),
        (("clutter", "ghosts", "jitter"), -0.1, "greater than or equal to 0"),
        (("clutter", "reach"), 0.0, "greater than 0"),
        (("clutter", "reach_width"), 0.0, "greater than 0"),
        (("clutter", "length", "mean"), 0.0, "greater than 0"),
        (("clutter", "length", "deviation"), -0.1, "greater than or equal to 0"),
        (("score", "ceiling"), float("nan"), "finite"),
        (("score", "constant"), float("inf"), "finite"),
        (("score", "hidden_range"), 0.0, "greater than 0"),
        (("score", "noise"), -1.0, "greater than or equal to 0"),
        (("size", "width", "constant"), "wide", "valid number"),
        (("clutter", "flashes", "density"), [1, 2], "valid number"),
        (("radial", "drift_share"), 0.9, "drift_share + fixed_share exceed 1"),
        (("flip", "fixed_share"), 0.9, "drift_share + fixed_share exceed 1"),
        (("size", "height", "drift_share"), 0.9, "drift_share + fixed_share exceed 1"),
        (("side_share",), 1.1, "less than or equal to 1"),
        (("side_share",), -1.1, "greater than or equal to -1"),
        (("pose",), {"position": -0.1, "yaw": 0.0, "drift_time": 1.0}, "greater than or equal"),
        (("pose",), {"position": 0.1, "yaw": -0.1, "drift_time": 1.0}, "greater than or equal"),
        (("pose",), {"position": 0.1, "yaw": 0.0, "drift_time": 0.0}, "greater than 0"),
        (("pose",), {"position": 0.1, "drift_time": 1.0}, "missing key"),
        (("pose",), 0.1, "dictionary"),
        (("evidence", "cars"), [1, 2], "valid"),
    ],
)
def test_bad_keys_and_values_are_named(
    tmp_path: Path, keys: tuple[str, ...], value: Any, reason: str
) -> None:
    """The message names file and key, and says what was expected."""
    path = changed(tmp_path, keys, value)
    message = refused(path)
    assert message.startswith(f"{path}: ")
    # A rule about two keys names the group that holds both.
    of_two_keys = "exceed" in reason or "must be below" in reason
    assert (".".join(keys[:-1] if of_two_keys else keys) or "(top level)") in message
    assert reason in message


def test_a_misspelt_key_is_told_the_known_ones(tmp_path: Path) -> None:
    """The keys of the very group in which it was not found."""
    message = refused(changed(tmp_path, ("radial", "per_rnage"), 0.1))
    assert "unknown key radial.per_rnage; expected one of: drift_share, drift_time" in message
    assert "per_range_squared" in message
    assert "clutter" not in message


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"name: [unclosed\nmax_range: 3\n", "YAML error at line 2"),
        (b"name: a: b\n", "YAML error at line 1"),
        (b"\tname: tab\n", "YAML error at line 1"),
        (b"name: \xff\xfe\n", "is not UTF-8 text"),
        (b"name: 2020-99-99\n", "YAML error: month must be in 1..12"),
        (b"name: !!int x\n", "YAML error"),
        (b"name: a\nname: b\n", "YAML error at line 2.*given twice"),
        (b"[" * 5000, "is nested too deeply"),
        (b"name: !!python/object/apply:os.system ['true']\n", "YAML error.*python/object"),
        (b"!!python/object:os.PathLike {}\n", "YAML error.*python/object"),
        (b'"two\\nlines": 1\n', "unknown key two lines"),
        (b"", "expected a mapping of keys"),
        (b"- a\n- list\n", "expected a mapping of keys"),
        (b"just words\n", "expected a mapping of keys"),
    ],
)
def test_files_that_are_no_profile_are_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    """Broken YAML, another encoding, Python objects (never constructed), other documents."""
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    assert re.match(re.escape(f"{path}: ") + reason, refused(path))


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    """Whether the suffix is .yaml or .yml."""
    missing = tmp_path / "missing.yaml"
    assert refused(missing) == f"{missing}: does not exist; expected a YAML file"
    assert "does not exist" in refused(str(tmp_path / "missing.yml"))
    folder = tmp_path / "folder.yaml"
    folder.mkdir()
    assert refused(folder) == f"{folder}: is not a regular file; expected a YAML file"


def test_a_profile_cannot_be_changed() -> None:
    """Profiles are frozen: the key of a run stays what it was."""
    with pytest.raises(ValueError, match="frozen"):
        load_profile("pointrcnn").max_range = 100.0  # type: ignore[misc]
