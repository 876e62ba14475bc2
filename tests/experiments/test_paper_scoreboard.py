"""Claim: each hypothesis gets the verdict that its rows deserve: identical filters never hold,
worse ones are contradicted, a known gain is in its interval, the stronger opponent counts, and what
has no rows is not tested."""

import json

import numpy as np
import polars as pl
import pytest

import mdkf
import scenarios
import sim_bridge
from experiments.claims import hypotheses as claims
from experiments.claims import scoreboard
from experiments.claims.hypotheses import Hypothesis
from experiments.claims.scoreboard import CONTRADICTED, DOES_NOT_HOLD, HOLDS, UNTESTABLE
from experiments.drift import drift
from experiments.estimates import RECORDED
from experiments.jobs import ROWS, as_rows
from experiments.occlusion import OcclusionProtocol
from mdkf.tables import FloatArray

RESAMPLES = 1999
REASON = {"untestable": "not asked for"}
ROWS_OF = {"study": "worlds", "detector": ["virconv"], "occlusion": ["none"], "bin": ["all"]}

Given = dict[str, FloatArray]
"""Values (scenarios, seeds) by filter."""


def claim(**given: object) -> Hypothesis:
    """A claim that `md` has the higher HOTA than `ca`, or as given."""
    default: dict[str, object] = {
        **{"id": "a", "quote": "better", "place": "here", "metric": "hota", "unit": "%"},
        **{"better": "higher", "contrasts": [{"filter": "md", "against": ["ca"]}]},
        **{"synthetic": ROWS_OF, "recorded": REASON},
    }
    return Hypothesis.model_validate(default | given)


def rows_of(given: Given, **everywhere: str) -> pl.DataFrame:
    """Rows of HOTA in `worlds` with VirConv, or as given."""
    measured = [
        {"scenario": f"scenario {k:02}", "seed": seed, "filter": name, "value": float(value)}
        for name, values in given.items()
        for (k, seed), value in np.ndenumerate(values)
    ]
    where = {"study": "worlds", "detector": "virconv", "occlusion": "none", "metric": "hota"}
    return as_rows(measured, **{**where, **everywhere})


def scores(seed: int, shape: tuple[int, int] = (18, 4)) -> FloatArray:
    """Scores of scenarios that differ a lot, and of seeds that differ little."""
    random = np.random.default_rng(seed)
    return 80 + random.normal(0, 5, (shape[0], 1)) + random.normal(0, 1, shape)


def judged(rows: pl.DataFrame, *hypotheses: Hypothesis) -> dict[str, object]:
    """The verdict on the first one, on the synthetic rows."""
    board = scoreboard.judge(rows, hypotheses, RESAMPLES)
    assert dict(board.schema) == scoreboard.SCOREBOARD
    return board.row(0, named=True)


def test_the_baseline_alone_is_asked_again_against_imm() -> None:
    """`also` becomes a hypothesis of its own, without the paper's effect."""
    contrasts = [{"filter": "md", "against": ["ca"], "also": ["imm", "imm-zero"]}]
    own, twin = claims.asked(claim(contrasts=contrasts, paper=0.3))
    assert (own.id, twin.id) == ("a", "a-imm")
    assert [part.against for part in claims.parts_of(own, "synthetic")] == [{"filter": "ca"}]
    opponents = [{"filter": "imm"}, {"filter": "imm-zero"}]
    assert [part.against for part in claims.parts_of(twin, "synthetic")] == opponents
    assert (own.paper, twin.paper) == (0.3, None)


def test_identical_filters_do_not_hold() -> None:
    """No effect, p = 1: neither claimed nor reversed, however often it is asked."""
    same = scores(0)
    line = judged(rows_of({"md": same, "ca": same}), *(claim(id=name) for name in "abc"))
    assert line["verdict"] == DOES_NOT_HOLD
    assert (line["effect"], line["low"], line["high"], line["p"]) == (0.0, 0.0, 0.0, 1.0)
    assert (line["scenarios_for"], line["scenarios_against"]) == (0, 0)


@pytest.mark.parametrize(("better", "verdict"), [("higher", CONTRADICTED), ("lower", HOLDS)])
def test_a_worse_filter_is_contradicted(better: str, verdict: str) -> None:
    """One point lower: the claim of a higher score is contradicted, that of a lower one holds."""
    random = np.random.default_rng(1)
    base = scores(1)
    rows = rows_of({"md": base - 1 + random.normal(0, 0.5, base.shape), "ca": base})
    line = judged(rows, claim(better=better))
    assert line["verdict"] == verdict
    assert line["low"] <= -1.0 <= line["high"]
    assert line["scenarios_for" if better == "lower" else "scenarios_against"] > 0


def test_a_small_known_gain_is_in_the_interval() -> None:
    """0.2 points, where scenarios scatter by 5: pairs cancel what both filters share. In 20 of 20
    draws the claim holds, and at least 17 of their intervals cover the gain."""
    random = np.random.default_rng(2)
    covered = 0
    for k in range(20):
        base = scores(k)
        gain = 0.2 + random.normal(0, 0.1, (18, 1)) + random.normal(0, 0.05, base.shape)
        line = judged(rows_of({"md": base + gain, "ca": base}), claim())
        assert line["verdict"] == HOLDS
        covered += line["low"] <= 0.2 <= line["high"]
    assert covered >= 17


def test_the_stronger_opponent_counts() -> None:
    """Better than CA and than IMM with one mixing, but as good as IMM with the other: does not
    hold, and what is shown is that against the stronger. Worse than it: contradicted."""
    random = np.random.default_rng(3)
    base = scores(3)
    noisy = {name: base + random.normal(0, 0.3, base.shape) for name in ("md", "ca", "imm")}
    asked = claim(contrasts=[{"filter": "md", "against": ["ca", "imm", "imm-zero"]}])
    for ahead, verdict in ((0.0, DOES_NOT_HOLD), (0.5, CONTRADICTED), (-1.0, HOLDS)):
        given = {"md": noisy["md"], "ca": noisy["ca"] - 2, "imm": noisy["imm"] - 2}
        given["imm-zero"] = base + ahead + random.normal(0, 0.3, base.shape)
        line = judged(rows_of(given), asked)
        assert line["verdict"] == verdict
        assert json.loads(str(line["against"])) == {"filter": "imm-zero"}
        assert line["parts"] == 3


def test_all_populations_must_agree() -> None:
    """A gain with one detector and none with the other does not hold; shown is the latter."""
    base = scores(4)
    random = np.random.default_rng(4)
    asked = claim(synthetic=ROWS_OF | {"detector": ["virconv", "casa"]})
    better = rows_of({"md": base + 1 + random.normal(0, 0.3, base.shape), "ca": base})
    for gain, verdict in ((0.0, DOES_NOT_HOLD), (1.0, HOLDS)):
        other = {"md": base + gain + random.normal(0, 0.3, base.shape), "ca": base}
        line = judged(pl.concat([better, rows_of(other, detector="casa")]), asked)
        assert line["verdict"] == verdict
        if gain == 0:
            assert json.loads(str(line["where"]))["detector"] == "casa"


def test_a_gap_that_grows_is_a_difference_of_differences() -> None:
    """By hand: 1.5 more at 50 m and beyond than nearby, by bin and by order of the filters."""
    base, random = scores(5), np.random.default_rng(5)
    small = rows_of({"md": base + 0.5, "imm": base}, bin="0-30 m")
    large = rows_of({"md": base + 2.0 + random.normal(0, 0.2, base.shape), "imm": base})
    contrast = {"filter": "md", "against": ["imm"], "than": {"bin": "0-30 m"}}
    line = judged(pl.concat([small, large]), claim(contrasts=[contrast]))
    assert line["verdict"] == HOLDS
    assert line["effect"] == pytest.approx(1.5, abs=0.1)

    orders = {"md": base + 0.5, "imm": base, "imm3": base, "md3": base + 0.5}
    than = {"filter": "md", "against": ["imm"]}
    asked = claim(contrasts=[{"filter": "md3", "against": ["imm3"], "than": than}])
    line = judged(rows_of(orders), asked)
    assert (line["effect"], line["p"], line["verdict"]) == (0.0, 1.0, DOES_NOT_HOLD)


def test_a_ratio_is_of_geometric_means() -> None:
    """A third of the time, give or take: holds as faster, and as under 0.4, not as under 0.3."""
    base, random = scores(6, (1, 12)), np.random.default_rng(6)
    rows = rows_of({"md": base / 3 * np.exp(random.normal(0, 0.05, base.shape)), "ca": base})
    for limit, verdict in ((None, HOLDS), (0.4, HOLDS), (0.3, CONTRADICTED)):
        line = judged(rows, claim(better="lower", measure="ratio", limit=limit))
        assert line["verdict"] == verdict
        assert line["low"] < 1 / 3 < line["high"]
        assert line["limit"] == (1.0 if limit is None else limit)


def test_a_value_of_its_own_is_held_against_its_limit() -> None:
    """Without an opponent."""
    rows = rows_of({"md": 0.06 + np.random.default_rng(7).normal(0, 0.005, (1, 40))})
    for limit, verdict in ((0.07, HOLDS), (0.05, CONTRADICTED)):
        line = judged(rows, claim(better="lower", contrasts=[{"filter": "md"}], limit=limit))
        assert line["verdict"] == verdict
        assert line["against"] is None


def test_what_has_no_rows_is_not_tested() -> None:
    """Nor what has several for one seed, one value alone, or none that is a number; each says
    why, and does not count as a test."""
    base = scores(8)
    rows = rows_of({"md": base + 1 + base / 100, "ca": base})
    missing = rows.with_columns(value=pl.lit(None, pl.Float64))
    one = rows.filter(scenario="scenario 00", seed=0)
    for given, reason in (
        (rows.filter(filter="md"), "no rows"),
        (pl.DataFrame(schema=ROWS), "no rows"),
        (missing, "no rows"),
        (pl.concat([rows, rows_of({"md": base, "ca": base})]), "several rows of one seed"),
        (one, "one value alone"),
    ):
        line = judged(given, claim())
        assert line["verdict"] == UNTESTABLE
        assert reason in str(line["reason"])
        assert line["effect"] is None
    board = scoreboard.judge(rows, [claim(), claim(id="b", synthetic=REASON)], RESAMPLES)
    tested, untested = board.filter(source="synthetic").to_dicts()
    assert untested["reason"] == "not asked for"
    assert tested["p_holm"] == tested["p"]
    assert scoreboard.counts(board).startswith(
        "synthetic: holds 1, does not hold 0, contradicted 0, cannot be tested here 1; recorded: "
    )


def test_rows_of_overlapping_jobs_count_once() -> None:
    """Two jobs of one seed that both have a row: the same verdict, of as many values."""
    base, random = scores(12), np.random.default_rng(12)
    rows = rows_of({"md": base + random.normal(0.1, 0.5, base.shape), "ca": base})
    assert judged(rows, claim()) == judged(pl.concat([rows, rows]), claim())


def test_recorded_sequences_stand_beside() -> None:
    """The same claim by jackknife over sequences: HOTA of all, and of all but one."""
    random = np.random.default_rng(9)
    gains = 0.5 + random.normal(0, 0.1, 11)
    sequences = ["val", *(f"val-{k:04}" for k in range(11))]
    whole = [gains.mean(), *(np.delete(gains, k).mean() for k in range(11))]
    recorded = as_rows(
        [
            {"scenario": scenario, "filter": name, "value": 70 + gain * (name == "md")}
            for name in ("md", "ca")
            for scenario, gain in zip(sequences, whole, strict=True)
        ],
        **{"study": RECORDED, "detector": "virconv", "occlusion": "none", "metric": "hota"},
    )
    base = scores(9)
    rows = pl.concat([rows_of({"md": base, "ca": base}), recorded])
    board = scoreboard.judge(rows, [claim(recorded=ROWS_OF | {"study": RECORDED})], RESAMPLES)
    synthetic, beside = board.to_dicts()
    assert (synthetic["source"], beside["source"]) == ("synthetic", "recorded")
    assert (synthetic["verdict"], beside["verdict"]) == (DOES_NOT_HOLD, HOLDS)
    assert beside["effect"] == pytest.approx(gains.mean())
    assert beside["n"] == 11


def test_the_number_of_hypotheses_is_corrected_for_by_holm() -> None:
    """A p-value of 0.02 to 0.05 of one test does not survive ten."""
    base, drawn = scores(10), np.random.default_rng(10).normal(0, 1, (18, 1))
    normal = (drawn - drawn.mean()) / drawn.std(ddof=1)
    rows = rows_of({"md": base + normal + 2.4 / np.sqrt(18), "ca": base})
    alone = judged(rows, claim())
    assert 0.01 < float(str(alone["p"])) < 0.05  # Student's t of 17 degrees beyond 2.4: 0.028
    assert alone["verdict"] == HOLDS
    assert judged(rows, *(claim(id=name) for name in "abcdefghij"))["verdict"] == DOES_NOT_HOLD


def test_a_line_names_the_rows_behind_it() -> None:
    """Effect and interval come again from the rows that it names."""
    base, random = scores(11), np.random.default_rng(11)
    given = {"md": base + 1, "imm": base + random.normal(0, 0.5, base.shape), "ca": base - 1}
    rows = pl.concat([rows_of(given), rows_of(given, bin="far")])
    contrasts = [{"filter": "md", "against": ["imm"], "than": {"bin": "far", "filter": "md"}}]
    contrasts[0]["than"]["against"] = ["ca"]
    for measure in ("difference", "ratio"):
        board = scoreboard.judge(rows, [claim(contrasts=contrasts, measure=measure)])
        line = board.row(0, named=True)
        found = scoreboard.again(rows, line)
        assert (found.effect, found.low, found.high) == (line["effect"], line["low"], line["high"])


def test_real_filters_get_the_verdicts_they_deserve() -> None:
    """Drift through gaps of simulated cars at constant velocity: CA against itself is no effect,
    and CA with a thousand times too much process noise, worse on purpose, is contradicted."""
    name, settings = "constant_velocity", mdkf.DETECTORS["virconv"]
    protocol = OcclusionProtocol.parse("mid:10")
    worse = mdkf.Kalman(order=2, process_density=(100.0, 10.0, 1.0))
    filters = {"ca": mdkf.estimator("ca"), "twin": mdkf.estimator("ca"), "worse": worse}
    measured = []
    for seed in range(12):
        trace = sim_bridge.simulate(scenarios.load(name), seed)
        detected = sim_bridge.detect(trace, "virconv", seed)
        gaps, occluded = protocol.gaps(detected), protocol.apply(detected)
        for label, estimator in filters.items():
            errors = drift(trace, occluded, gaps, estimator, settings)
            hidden = errors.filter(gaps.covers(errors["object_id"], errors["frame"]))
            measured.append({"seed": seed, "filter": label, "value": hidden["drift"].mean()})
    where = {"study": "closed form", "scenario": name, "metric": "drift"}
    asked = {"better": "lower", "metric": "drift", "synthetic": {"study": "closed form"}}
    same = claim(contrasts=[{"filter": "twin", "against": ["ca"]}], **asked)
    bad = claim(id="b", contrasts=[{"filter": "worse", "against": ["ca"]}], **asked)
    board = scoreboard.judge(as_rows(measured, **where), [same, bad], RESAMPLES)
    identical, worsened = board.filter(source="synthetic").to_dicts()
    assert (identical["verdict"], worsened["verdict"]) == (DOES_NOT_HOLD, CONTRADICTED)
    assert (identical["effect"], identical["p"]) == (0.0, 1.0)
    assert worsened["low"] > 0
    assert (worsened["n"], worsened["scenarios"]) == (12, 1)


def test_the_terminal_shows_every_hypothesis() -> None:
    """Even where there are no rows at all."""
    board = scoreboard.judge(pl.DataFrame(schema=ROWS))
    assert set(board["verdict"]) == {UNTESTABLE}
    assert scoreboard.table(board).row_count == len(claims.load())


def test_a_page_of_claims_about_nothing_finds_nothing() -> None:
    """Ten hypotheses without an effect: any of them holds or is contradicted in about one of
    twenty such pages; without the correction it would be in eight of twenty."""
    random = np.random.default_rng(13)
    hypotheses = [claim(id=str(k), metric=f"metric {k}") for k in range(10)]
    pages, wrong = 25, 0
    for _ in range(pages):
        effects = random.normal(0, 1, (10, 18, 1))
        zero = np.zeros((18, 1))
        rows = [
            rows_of({"md": own, "ca": zero}, metric=f"metric {k}") for k, own in enumerate(effects)
        ]
        board = scoreboard.judge(pl.concat(rows), hypotheses, 999)
        wrong += bool(board["verdict"].is_in([HOLDS, CONTRADICTED]).any())
    assert wrong <= 5  # of 1.25; six or more come in one of four hundred such tests
