"""Claim: an ablation changes one choice and nothing else, and its default is the filter itself."""

from dataclasses import asdict, fields, replace

import numpy as np
import polars as pl
import pytest

import mdkf
from experiments.jobs import as_rows
from experiments.paper.ablations import CHANGE, answer
from experiments.studies import ablations
from experiments.studies.ablations import Ablation
from experiments.studies.variants import DELETION, SUBJECT, ConstantWeights, Variant, variants
from mdkf import Kalman, MotionDynamics, TrackerSettings, filter_sequence
from mdkf.testing import check_estimator


@pytest.mark.parametrize(
    "one", variants(), ids=lambda one: f"{one.choice} {one.value} {one.filter}"
)
def test_a_variant_differs_from_its_filter_in_one_choice(one: Variant) -> None:
    """In one parameter, or one rule of the tracker; the default in none, and it says so."""
    usual = mdkf.estimator(one.filter)
    changed = list(one.rules)
    if type(one.estimator) is type(usual):
        own = asdict(one.estimator) | {"factors": getattr(one.estimator, "motion_factors", None)}
        its = asdict(usual) | {"factors": getattr(usual, "motion_factors", None)}
        changed += [name for name in own if own[name] != its[name]]
    else:
        assert one.choice == "weights"
        changed.append("weights")
    assert len(changed) == (0 if one.name == one.filter else 1)
    assert set(one.rules) <= {field.name for field in fields(TrackerSettings)}


def test_every_choice_has_one_default_for_each_filter_and_names_are_told_apart() -> None:
    """One name, one estimator with one set of rules."""
    for choice in {one.choice for one in variants()}:
        own = [one for one in variants() if one.choice == choice]
        for name in {one.filter for one in own}:
            usual = [one for one in own if one.filter == name and one.name == name]
            assert len(usual) == 1, choice
    meanings: dict[str, set[str]] = {}
    for one in variants():
        built = repr(one.estimator).replace("factors=(0.15, 0.2)", "factors=None")
        meanings.setdefault(one.name, set()).add(f"{built} {dict(one.rules)}")
    assert all(len(found) == 1 for found in meanings.values())


def test_constant_weights_are_a_weighted_prediction() -> None:
    """x = F W x from numpy's matrices; with weights of one it is the Kalman filter to the bit."""
    damped, plain = ConstantWeights(weights=(0.9, 0.5)), Kalman(order=2)
    rng = np.random.default_rng(0)
    noise = np.tile(0.02 * np.eye(2), (3, 1, 1))
    state = plain.start(rng.normal(size=(3, 2)), noise)
    for _ in range(4):
        state = plain.update(plain.predict(state, 0.1), rng.normal(size=(3, 2)), noise)
    F = np.kron(np.eye(2), np.array([[1, 0.1, 0.005], [0, 1, 0.1], [0, 0, 1]]))
    W = np.diag([1, 0.9, 0.5, 1, 0.9, 0.5])
    found = damped.predict(state, 0.1)
    np.testing.assert_allclose(found.mean, state.mean @ (F @ W).T, rtol=1e-12)
    np.testing.assert_array_equal(found.covariance, plain.predict(state, 0.1).covariance)
    seen = np.cumsum(rng.normal(size=(30, 3, 2)), axis=0)
    ones = ConstantWeights(weights=(1.0, 1.0))
    for name in ("position", "velocity", "covariance"):
        one, other = (getattr(filter_sequence(f, seen, noise[0], 0.1), name) for f in (ones, plain))
        np.testing.assert_array_equal(one, other)
    check_estimator(ConstantWeights())


def test_md_with_full_weights_is_constant_acceleration() -> None:
    """What the table says of the weights 1, 1."""
    seen = np.cumsum(np.random.default_rng(1).normal(size=(40, 5, 2)), axis=0)
    full = replace(MotionDynamics(), factors=(1e-9, 1e-9))
    one, other = (filter_sequence(f, seen, 0.02 * np.eye(2), 0.1) for f in (full, Kalman(order=2)))
    np.testing.assert_array_equal(one.position, other.position)


def test_one_world_has_a_row_for_every_variant_and_score() -> None:
    """The default's are those of the filter of the table of worlds."""
    from experiments.studies.worlds import Setting, World

    rows = Ablation("passing_van", 0).rows()
    names = {one.name for one in variants()}
    assert set(rows["filter"]) == names
    assert set(rows.filter(bin="all", metric="hota")["filter"]) == names
    setting = Setting(ablations.DETECTOR, ablations.OCCLUSION, (SUBJECT, "ca"))
    whole = World("passing_van", 0, setting).rows()
    for name in (SUBJECT, "ca"):
        for part in ("hota", "lost", "drift"):
            where = {"filter": name, "metric": part, "bin": "all"}
            assert rows.filter(**where)["value"].item() == whole.filter(**where)["value"].item()
    bounds = {one.name for one in variants() if one.choice == DELETION and one.rules}
    assert rows.filter(pl.col("filter").is_in(list(bounds)), metric="drift").is_empty()


def test_changes_are_paired_differences_from_the_default() -> None:
    """What all suffer in a seed drops out."""
    rng = np.random.default_rng(2)
    rows = []
    hard = 10 * rng.normal(size=(3, 4))
    for k, name in enumerate(dict.fromkeys(one.name for one in variants())):
        for (scenario, seed), value in np.ndenumerate(hard):
            row = {"scenario": str(scenario), "seed": seed, "filter": name}
            rows.append({**row, "metric": "hota", "value": value + k})
    cells = answer(as_rows(rows, study=ablations.STUDY)).cells
    changed = cells.filter(table="window", column=f"{CHANGE}HOTA")
    assert changed["line"].to_list() == ["3", "5", "20", "30"]
    assert changed["value"].to_list() == pytest.approx([-2, -1, 1, 2])
    assert (changed["high"] - changed["low"]).max() == pytest.approx(0, abs=1e-9)
