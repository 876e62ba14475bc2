"""Claim: the paper's claims are hypotheses of a file that names only what there is, IMM among the
opponents, and a file that is wrong is told in one line."""

from dataclasses import astuple
from pathlib import Path

import pytest

import mdkf
from experiments import bins
from experiments.claims import hypotheses as claims
from experiments.claims.hypotheses import ClaimsError, load
from experiments.estimates import RECORDED
from experiments.occlusion import OcclusionProtocol
from experiments.studies import worlds

PAPER = load()


def test_the_papers_claims_name_only_what_there_is() -> None:
    """Filters, detectors, occlusions and bins of simulated worlds are known: a misspelt one would
    be "cannot be tested here" for good."""
    levels = [f"{name}, {level}" for name, *_ in bins.RANGES for level in ("LEVEL_1", "LEVEL_2")]
    regimes = [f"regime {name.replace('_', ' ')}" for name in mdkf.tables.REGIMES]
    known = {"all", *levels, *(name for name, *_ in bins.RANGES), *regimes}
    asked = [part for one in PAPER for part in claims.parts_of(one, "synthetic")]
    asked += [part for one in PAPER for part in claims.parts_of(one, "recorded")]
    scored = [part for part in asked if part.where["study"] in (worlds.STUDY, RECORDED)]
    own = [part for part in scored if part.where["metric"] not in ("mse", "spread")]
    sides = [side for part in own for side in astuple(part) if side is not None]
    named = {(column, name) for side in sides for column, name in side.items()}
    assert len(own) > 300
    for column, name in named:
        if column == "filter":
            mdkf.estimator(name)
        if column == "occlusion":
            OcclusionProtocol.parse(name)
        if column == "bin":
            assert name in known
        if column == "detector":
            assert name in mdkf.DETECTORS


def test_imm_is_an_opponent_with_both_mixings() -> None:
    """Wherever tracking or errors of MD are compared, by the claim itself or by its twin. filterpy
    knows one way of mixing; what is timed, or has a limit of its own, is compared as it is."""
    by_id = {one.id: one for one in PAPER}
    assert len(by_id) == len(PAPER)
    compared = [one for one in PAPER if one.synthetic.study in (worlds.STUDY, "scenes")]
    assert len(compared) > 40
    mixings = {"md": {"imm", "imm-zero"}, "md3": {"imm3", "imm3-zero"}}
    for one in compared:
        twin = by_id.get(f"{one.id}-imm", one)
        if one.limit is None and not one.id.startswith("jerk-"):
            for contrast in twin.contrasts:
                assert mixings[contrast.filter] <= set(contrast.against)


GOOD = """
claims:
  - id: a
    quote: better
    place: here
    metric: hota
    unit: "%"
    better: higher
    contrasts: [{filter: md, against: [ca]}]
    synthetic: {study: worlds, detector: [virconv]}
    recorded: {untestable: nothing is recorded}
"""


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("metric: hota", "metrik: hota", "unknown key claims.0.metrik"),
        ("detector:", "detektor:", "unknown key claims.0.synthetic.detektor"),
        ("filter: md", "filter: md, than: {range: far}", "unknown key claims.0.contrasts.0.than."),
        ("    place: here\n", "", "missing key claims.0.place"),
        ("better: higher", "better: more", "key claims.0.better"),
        ("{filter: md, against: [ca]}", "", "key claims.0.contrasts"),
        ("study:", "untestable: why, study:", "synthetic: expected either study or untestable"),
        ("study: worlds, ", "", "synthetic: expected either study or untestable"),
        ("against: [ca]", "against: ca", "key claims.0.contrasts.0.against"),
        ("[ca]", "[ca], than: {filter: cj}", "than.filter and than.against together"),
        ("[ca]", "[ca], than: {filter: cj, against: [a, b]}", "as many than.against as against"),
    ],
)
def test_a_bad_file_is_told_in_one_line(tmp_path: Path, old: str, new: str, told: str) -> None:
    """With its name and the key."""
    path = tmp_path / "claims.yaml"
    path.write_text(GOOD)
    assert load(path)[0].id == "a"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(ClaimsError) as error:
        load(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert told in message
    assert "\n" not in message


def test_ids_are_given_once(tmp_path: Path) -> None:
    """Two hypotheses of one name would overwrite each other."""
    path = tmp_path / "claims.yaml"
    path.write_text(GOOD + GOOD.replace("claims:\n", "").lstrip("\n"))
    with pytest.raises(ClaimsError, match="id 'a' is given twice"):
        load(path)
