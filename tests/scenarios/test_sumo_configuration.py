"""Claims about reading a SUMO configuration: what is taken of it, and every flaw in one line."""

import dataclasses
import json
from pathlib import Path

import pytest

import scenarios
from scenarios import ConfiguredScenario, ScenarioError
from scenarios.sumo_configuration import read_configuration
from scenarios.sumo_files import seconds
from tests.sim_bridge.town import Edit, instead, replaced, write_town


def loaded(path: Path, **parameters: float) -> ConfiguredScenario:
    scenario = scenarios.load(path, **parameters)
    assert isinstance(scenario, ConfiguredScenario)
    return scenario


def test_files_times_and_traffic_options_are_taken(tmp_path: Path) -> None:
    """And nothing else: no output, seed, step length, report, GUI or TraCI."""
    taken = read_configuration(write_town(tmp_path))
    assert taken.network == tmp_path / "network.net.xml"
    assert [path.name for path in taken.routes] == ["types.rou.xml", "demand.rou.xml"]
    assert [path.name for path in taken.additional] == ["detectors.add.xml"]
    assert (taken.begin, taken.end) == (100.0, 160.0)
    assert taken.options == {"default.speeddev": "0.05"}


def test_a_configuration_is_a_scenario(tmp_path: Path) -> None:
    """Named after its file, as long as its times say."""
    scenario = loaded(write_town(tmp_path))
    assert (scenario.name, scenario.source) == ("town", "sumo")
    assert (scenario.warmup, scenario.duration, scenario.begin) == (0.0, 60.0, 100.0)
    assert loaded(tmp_path / "town.sumocfg", warmup=15).duration == 45.0
    assert loaded(tmp_path / "town.sumocfg", duration=600).duration == 600.0


def test_without_an_end_a_minute_is_recorded(tmp_path: Path) -> None:
    """Also with SUMO's own way to say so."""
    for edit in (replaced('<end value="0:02:40"/>', ""), replaced("0:02:40", "-1")):
        scenario = loaded(write_town(tmp_path, {"town.sumocfg": edit}))
        assert (scenario.duration, scenario.configuration.end) == (60.0, None)


def test_short_names_sections_and_absolute_paths_do_not_matter(tmp_path: Path) -> None:
    """SUMO knows options by other names, wherever they stand; files may be anywhere."""
    path = write_town(tmp_path / "a")
    short = tmp_path / "short.sumocfg"
    folder = path.parent
    short.write_text(
        f'<sumoConfiguration><n v="a/network.net.xml"/><r v="{folder}/types.rou.xml,'
        f'a/demand.rou.xml"/><a v="a/detectors.add.xml"/><b v="100"/></sumoConfiguration>'
    )
    one, other = read_configuration(path), read_configuration(short)
    assert (one.network, one.routes, one.additional) == (
        *(other.network, other.routes, other.additional),
    )


def test_identity_holds_every_file_and_no_path(tmp_path: Path) -> None:
    """A copy elsewhere is the same scenario; a change in any of the five files makes another."""
    identity = loaded(write_town(tmp_path / "one")).identity()
    assert loaded(write_town(tmp_path / "two")).identity() == identity
    assert str(tmp_path) not in identity
    assert len(json.loads(identity)["files"]) == 6  # the configuration is the definition, too
    for name in (
        *("town.sumocfg", "network.net.xml", "types.rou.xml", "demand.rou.xml"),
        "detectors.add.xml",
    ):
        path = write_town(tmp_path / name, {name: lambda text: text + "<!-- more -->"})
        assert loaded(path).identity() != identity, name
    scenario = loaded(tmp_path / "one" / "town.sumocfg")
    assert dataclasses.replace(scenario, ego="first").identity() != identity


FLAWS: dict[str, tuple[Edit, tuple[str, ...]]] = {
    "not XML": (instead("town"), ("not well-formed",)),
    "empty": (instead(""), ("not well-formed",)),
    "another root": (instead("<routes/>"), ("<sumoConfiguration>", "<routes>")),
    "no network": (replaced('<net-file value="network.net.xml"/>', ""), ("net-file", "one file")),
    "two networks": (replaced('"network.net.xml"', '"network.net.xml,demand.rou.xml"'), ("2",)),
    "lost network": (replaced("network.net.xml", "lost.net.xml"), ("net-file", "lost.net.xml")),
    "lost routes": (replaced("demand.rou.xml", "lost.rou.xml"), ("route-files", "lost.rou.xml")),
    "lost additional": (
        replaced("detectors.add.xml", "lost.add.xml"),
        ("additional-files", "lost.add.xml"),
    ),
    "a folder": (replaced("network.net.xml", "."), ("net-file", "no such file")),
    "a device": (replaced("network.net.xml", "/dev/zero"), ("net-file", "no such file")),
    "no routes": (replaced("types.rou.xml, demand.rou.xml", ""), ("route-files", "at least one")),
    "empty range": (replaced("0:02:40", "100"), ("end", "after begin", "100 s")),
    "range too short": (replaced("0:02:40", "100.5"), ("end", "1 s after begin")),
    "no time": (replaced('begin value="100"', 'begin value="soon"'), ("begin", "'soon'")),
    "not finite": (replaced('begin value="100"', 'begin value="nan"'), ("begin", "'nan'")),
    "given twice": (replaced("<time>", '<time><b value="3"/>'), ("begin", "twice")),
    "unknown option": (
        replaced("default.speeddev", "defualt.speeddev"),
        ("'defualt.speeddev'", "take it out"),
    ),
    "misspelt option": (replaced("net-file", "net-fiel"), ("'net-fiel'", "did you mean net-file?")),
    "another state": (replaced("<time>", '<time><load-state value="s.xml"/>'), ("load-state",)),
    "mesoscopic": (replaced("<time>", '<time><mesosim value="true"/>'), ("mesosim",)),
    "entities": (
        replaced("<configuration>", '<!DOCTYPE c [<!ENTITY a "aa">]><configuration>'),
        ("<!DOCTYPE",),
    ),
    "include": (replaced("<time>", '<time><include href="x"/>'), ("<include>",)),
    "too large": (replaced("<time>", "<time>" + " " * 1_000_001), ("larger than 1000000",)),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_a_flawed_configuration_is_refused_in_one_line(flaw: str, tmp_path: Path) -> None:
    """The message names the file and the option."""
    edit, parts = FLAWS[flaw]
    path = write_town(tmp_path, {"town.sumocfg": edit})
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert len(message) < 400 + len(str(path))
    for part in parts:
        assert part in message


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-32"])
def test_an_encoding_that_could_hide_entities_is_refused(encoding: str, tmp_path: Path) -> None:
    """Only UTF-8 is read: SUMO's parser would follow what is not seen here."""
    path = tmp_path / "town.sumocfg"
    path.write_bytes('<!DOCTYPE c [<!ENTITY a "aa">]><configuration/>'.encode(encoding))
    with pytest.raises(ScenarioError, match="UTF-8"):
        scenarios.load(path)


def test_a_path_that_is_no_file(tmp_path: Path) -> None:
    """A folder, or nothing there."""
    (tmp_path / "folder.sumocfg").mkdir()
    for name, part in (("folder.sumocfg", "regular file"), ("none.sumocfg", "cannot be read")):
        with pytest.raises(ScenarioError, match=part):
            scenarios.load(tmp_path / name)


MINE = """\
name: mine
purpose: A town.
source: sumo
configuration: town.sumocfg
duration: 20.0
"""


@pytest.mark.parametrize(
    ("more", "parts"),
    [
        ("network: network.net.xml", ("unknown key network", "configuration")),
        ("configuration: other.sumocfg", ("'configuration' is given twice",)),
        (
            "parameters:\n  v: {unit: m, default: 1, minimum: 1, maximum: 1, description: d}",
            ("no parameters",),
        ),
        ("ego: 3", ("key ego", "string")),
    ],
)
def test_a_flawed_file_around_a_configuration(
    more: str, parts: tuple[str, ...], tmp_path: Path
) -> None:
    """Keys that do not go with it, and flaws of its own, are named."""
    write_town(tmp_path)
    path = tmp_path / "mine.yaml"
    path.write_text(MINE)
    assert loaded(path).duration == 20.0
    path.write_text(MINE + more)
    with pytest.raises(ScenarioError) as caught:
        scenarios.load(path)
    for part in parts:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [("90", 90.0), (" 1.5 ", 1.5), ("0:01:30", 90.0), ("1:00:00:00", 86_400.0), ("-1", -1.0)],
)
def test_times_as_sumo_writes_them(text: str, value: float) -> None:
    """Seconds, hours:minutes:seconds, days before them."""
    assert seconds(text) == value


@pytest.mark.parametrize("text", ["", "noon", "1:30", "nan", "inf", "1e12", "1:2:3:4:5", "a:0:0"])
def test_what_is_no_time(text: str) -> None:
    """Refused, not guessed."""
    with pytest.raises(ValueError, match="is no time"):
        seconds(text)
