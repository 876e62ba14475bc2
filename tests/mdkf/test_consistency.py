"""Claim: on simulations that follow a filter's own assumptions, its covariance tells its error.

NEES, the squared error normalised by the covariance, sums over N independent runs to
chi2(N dim) if the filter is right; NIS, the innovation's, to chi2 with two degrees of freedom for
each measurement. A track starts at its first position z with P0 whatever R is, so the truth is
drawn from N([z, 0, ..], P0). All intervals are two-sided and hold 99 % of all correct filters,
for all the times tested at once (Bonferroni).
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

from mdkf import InteractingMultipleModel, Kalman
from mdkf.imm import ImmState
from mdkf.motion import process_noise, transition
from tests.mdkf.scenes import DT, IMM, Array, covariances, last, states

RUNS, FRAMES = 400, 61
TIMES = (1, 4, 15, 30, 60)
"""Frames after which NEES is taken; 30 lies in the gap of frames 26 to 32."""

PER_DETECTION = "per detection"
NOISE: dict[str, Any] = {
    "diagonal": np.diag([0.030874, 0.009379]),
    "correlated": np.array([[0.030874, 0.012], [0.012, 0.009379]]),
    PER_DETECTION: PER_DETECTION,
}


def interval(degrees: int, looks: int) -> Array:
    """Bounds of chi2(degrees) that hold in 99 % of all cases for `looks` of them at once."""
    tail = 0.005 / looks
    return chi2.ppf([tail, 1 - tail], degrees)


def assert_average(values: Array, expected: float, looks: int) -> None:
    """The mean of independent values (N,) lies as near to the expectation as N allows.

    For normalised errors that are not chi-square: those of a mixture have the right expectation
    tr(P^-1 P) = dim, but longer tails. The interval is the central limit theorem's, from the
    values' own deviation.
    """
    error = values.mean() - expected
    limit = norm.ppf(1 - 0.005 / looks) * values.std(ddof=1) / np.sqrt(len(values))
    assert abs(error) < limit, f"mean {values.mean():.4g}, expected {expected} +- {limit:.2g}"


def normalised(error: Array, covariance: Array) -> Array:
    """Squares e' P^-1 e of errors (n, d)."""
    return np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])


def noise_of(kind: Any, frames: int, runs: int, seed: int) -> Array:
    """Covariances (frames, runs, 2, 2): one matrix, or each detection's own."""
    if isinstance(kind, str):
        return covariances(np.random.default_rng(seed), (frames, runs))
    return np.broadcast_to(kind, (frames, runs, 2, 2))


def simulate(
    rng: np.random.Generator, estimator: Any, mode: Array, R: Array, dt: Array, stay: float = 1.0
) -> tuple[Array, Array]:
    """Truth (T, n, 2m) and measured positions (T, n, 2) of chains that obey the models.

    mode (n,): each run's motion order less one. With stay < 1 it jumps; a derivative that the
    new model lacks ends, and one that the old model lacked starts at zero (`zero` mixing).
    A seventh of the measurements is missing, and for all runs the frames 26 to 32.
    """
    n, m = len(mode), estimator.order + 1
    known = np.arange(m) <= mode[:, None, None] + 1
    z = np.zeros((len(dt) + 1, n, 2))
    z[0] = rng.normal(0, 100, (n, 2))
    x = rng.normal(size=(n, 2, m)) * np.sqrt(estimator.start_variance[:m]) * known
    x[..., 0] += z[0]
    truth = [x]
    for step, noise in zip(dt, R[1:], strict=True):
        leaves = rng.random(n) > stay
        mode = np.where(leaves, (mode + rng.integers(1, max(m - 1, 2), n)) % (m - 1), mode)
        x = (x * (np.arange(m) <= mode[:, None, None] + 1)) @ transition(m - 1, step).T
        for j in range(m - 1):
            L = np.linalg.cholesky(process_noise(j + 1, step, estimator.process_density))
            moved = rng.normal(size=(n, 2, j + 2)) @ L.T
            x[..., : j + 2] += moved * (mode == j)[:, None, None]
        truth.append(x)
        k = len(truth) - 1
        root = np.linalg.cholesky(noise)
        z[k] = x[..., 0] + np.einsum("nij,nj->ni", root, rng.normal(size=(n, 2)))
        z[k, rng.random(n) < 1 / 7] = np.nan
    z[26:33] = np.nan
    return np.stack(truth).reshape(len(truth), n, 2 * m), z


def kalman_scene(order: int, kind: str, uneven: bool) -> tuple[Array, Array, Array, Array]:
    """Truth, measurements, R and dt of RUNS runs that obey a Kalman filter's model."""
    rng = np.random.default_rng([order, list(NOISE).index(kind), uneven])
    dt = rng.uniform(0.02, 0.4, FRAMES - 1) if uneven else np.full(FRAMES - 1, DT)
    R = noise_of(NOISE[kind], FRAMES, RUNS, seed=order)
    truth, z = simulate(rng, Kalman(order=order), np.full(RUNS, order - 1), R, dt)
    return truth, z, R, dt


def sums(estimator: Any, truth: Array, z: Array, R: Array, dt: Array) -> tuple[Array, float, int]:
    """NEES summed over the runs at each of TIMES; NIS over all measurements, and their number.

    The innovations of a correct filter are independent, so that NIS adds up over time too.
    """
    found = [
        (np.sum(normalised(state.mean - x, state.covariance)), estimator.diagnostics(state)["nis"])
        for state, x in zip(states(estimator, z, R, dt), truth, strict=True)
    ]
    nees = np.array([found[t][0] for t in TIMES])
    nis = np.concatenate([nis[~np.isnan(nis)] for _, nis in found])
    return nees, float(nis.sum()), len(nis)


@pytest.mark.parametrize("uneven", [False, True], ids=["even", "uneven"])
@pytest.mark.parametrize("kind", NOISE)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_nees_and_nis_of_a_kalman_filter_are_chi_square(
    order: int, kind: str, uneven: bool
) -> None:
    """The whole state's NEES at five times, before, in and after a gap, and NIS over all."""
    nees, nis, measured = sums(Kalman(order=order), *kalman_scene(order, kind, uneven))
    low, high = interval(RUNS * 2 * (order + 1), len(TIMES) + 1)
    assert ((low < nees) & (nees < high)).all(), (low, nees, high)
    low, high = interval(2 * measured, len(TIMES) + 1)
    assert low < nis < high


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("wrong", ["R / 2", "R * 2", "R of the other axis", "Q / 4", "dt * 0.8"])
def test_a_wrong_filter_is_noticed(order: int, wrong: str) -> None:
    """The power of the above: each of these leaves the intervals, NEES and NIS alike."""
    truth, z, R, dt = kalman_scene(order, "correlated", uneven=False)
    estimator = Kalman(order=order)
    if wrong == "Q / 4":
        smaller = tuple(q / 4 for q in estimator.process_density)
        estimator = replace(estimator, process_density=smaller)
    R = R * {"R / 2": 0.5, "R * 2": 2.0}.get(wrong, 1.0)
    if wrong == "R of the other axis":
        R = R[..., ::-1, ::-1]
    nees, nis, measured = sums(estimator, truth, z, R, dt * (0.8 if wrong == "dt * 0.8" else 1))
    low, high = interval(RUNS * 2 * (order + 1), len(TIMES) + 1)
    assert ((nees < low) | (high < nees)).any()
    low, high = interval(2 * measured, len(TIMES) + 1)
    assert not low < nis < high


def mixture(state: ImmState) -> tuple[Array, Array]:
    """Mean (n, 2m) and covariance (n, 2m, 2m) of all models together."""
    mean = np.einsum("nk,nka->na", state.probability, state.mean)
    spread = state.mean - mean[:, None]
    parts = state.covariance + np.einsum("nka,nkb->nkab", spread, spread)
    return mean, np.einsum("nk,nkab->nab", state.probability, parts)


@pytest.mark.parametrize("name", IMM)
def test_imm_that_hardly_switches_knows_its_error(name: str) -> None:
    """Truth of one model for each run, drawn from the prior: the bank, with stay -> 1, is then
    the exact posterior mixture, whose NEES has the expectation dim (`assert_average`): position's
    and the whole state's."""
    runs = 2000
    estimator = replace(IMM[name], stay=1 - 1e-12)
    rng = np.random.default_rng(estimator.order)
    dt = np.full(FRAMES - 1, DT)
    R = noise_of(NOISE["correlated"], FRAMES, runs, seed=0)
    modes = rng.integers(0, estimator.order, runs)
    truth, z = simulate(rng, estimator, modes, R, dt)
    m = estimator.order + 1
    for t, state in enumerate(states(estimator, z, R, dt)):
        if t in TIMES:
            error = estimator.position(state) - truth[t][:, ::m]
            nees = normalised(error, estimator.covariance(state))
            assert_average(nees, 2, 2 * len(TIMES))
            mean, covariance = mixture(state)
            assert_average(normalised(mean - truth[t], covariance), 2 * m, 2 * len(TIMES))


@pytest.mark.parametrize("name", IMM)
def test_imm_of_equal_models_is_their_kalman_filter(name: str) -> None:
    """CA and CJ whose higher derivatives stay zero are CV, however often the bank switches: NEES
    and NIS are chi-square again, and the estimates those of the Kalman filter."""
    model: dict[str, Any] = {
        "process_density": (0.1, 0.0, 0.0),
        "start_variance": (2.0, 4.0, 1e-15, 1e-15),
    }
    cv = Kalman(order=1, **model)
    truth, z, R, dt = kalman_scene(1, PER_DETECTION, uneven=True)
    estimator = replace(IMM[name], stay=0.7, **model)
    looks = len(TIMES) + 1
    total, measured = 0.0, 0
    pairs = zip(states(estimator, z, R, dt), states(cv, z, R, dt), truth, strict=True)
    for t, (state, single, x) in enumerate(pairs):
        np.testing.assert_allclose(estimator.position(state), cv.position(single), rtol=1e-9)
        np.testing.assert_allclose(
            estimator.covariance(state), cv.covariance(single), rtol=1e-9, atol=1e-12
        )
        nis = estimator.diagnostics(state)["nis"]
        total, measured = total + np.nansum(nis), measured + np.sum(~np.isnan(nis))
        if t in TIMES:
            nees = normalised(estimator.position(state) - x[:, ::2], estimator.covariance(state))
            low, high = interval(2 * RUNS, looks)
            assert low < nees.sum() < high
    low, high = interval(2 * measured, looks)
    assert low < total < high


@pytest.mark.parametrize("name", [n for n in IMM if "zero" in n])
@pytest.mark.parametrize("stay", [0.8, 0.95])
def test_imm_that_switches_is_not_overconfident(name: str, stay: float) -> None:
    """Modes that jump by the bank's own Markov matrix, as zero mixing understands a jump.

    An IMM merges the models' pasts and is no exact filter. Over 20 000 runs its position's NEES
    is 1.85 to 2.02 where 2 is right while cars are seen, and 1.67 to 1.90 in the gap, where it
    is too careful. So the interval of as many runs as the Kalman filters' holds while they are
    seen, and in the gap its upper bound.
    """
    estimator = replace(IMM[name], stay=stay)
    rng = np.random.default_rng([estimator.order, round(100 * stay)])
    dt = np.full(FRAMES - 1, DT)
    R = noise_of(NOISE["correlated"], FRAMES, RUNS, seed=0)
    modes = rng.integers(0, estimator.order, RUNS)
    truth, z = simulate(rng, estimator, modes, R, dt, stay)
    low, high = interval(2 * RUNS, len(TIMES))
    for t, state in enumerate(states(estimator, z, R, dt)):
        if t in TIMES:
            error = estimator.position(state) - truth[t][:, :: estimator.order + 1]
            nees = normalised(error, estimator.covariance(state)).sum()
            assert nees < high
            assert nees > low or t == 30


def donors(rng: np.random.Generator, members: Any, cars: Any, group: int) -> Any:
    """For each of `cars` a random one of `members` of its own group of rows."""
    first, end = np.searchsorted(members, [cars // group * group, (cars // group + 1) * group])
    return members[(first + rng.random(len(cars)) * (end - first)).astype(int)]


@pytest.mark.parametrize("name", IMM)
@pytest.mark.parametrize("stay", [0.7, 0.95])
def test_imm_in_a_gap_has_the_moments_of_switching_cars(name: str, stay: float) -> None:
    """Without measurements merging loses nothing: mean and covariance are exact, however often
    the modes jump, so errors average 0 and NEES dim.

    The cars are drawn from a bank whose models differ, after a turn. When a car's mode jumps to
    a model with more derivatives, the new ones are zero (`zero`), or those of a random car of
    that model, whatever its position (`unbiased`). Cars that pass these on are not independent:
    there are 60 groups of 1000, and the groups are.
    """
    estimator: InteractingMultipleModel = replace(IMM[name], stay=stay)
    K, m, groups, group = estimator.order, estimator.order + 1, 60, 1000
    cars = groups * group
    t = DT * np.arange(25)[:, None, None]
    z = np.concatenate([8 * np.sin(t), 12 * np.cos(1.5 * t)], axis=-1)
    chances = np.array([0.5, 0.3, 0.2][:K])
    state = last(estimator, z, NOISE["correlated"])
    state = replace(state, probability=chances[None] / chances.sum())
    assert np.ptp(state.mean[0, :, 1]) > 0.1

    rng = np.random.default_rng([K, round(100 * stay)])
    mode = rng.choice(K, cars, p=state.probability[0])
    x = np.empty((cars, 2, m))
    for j in range(K):
        P, members = state.covariance[0, j], int(np.sum(mode == j))
        drawn = rng.multivariate_normal(state.mean[0, j], P, members, method="eigh")
        x[mode == j] = drawn.reshape(-1, 2, m)

    times = (1, 4, 10)
    looks = len(times) * (2 * m + 2)
    for step in range(1, times[-1] + 1):
        state = estimator.predict(state, DT)
        old, before = mode, x.copy()
        jumps = rng.random(cars) > stay
        mode = np.where(jumps, (mode + rng.integers(1, max(K, 2), cars)) % K, mode)
        x *= np.arange(m) <= mode[:, None, None] + 1
        for j in range(K if estimator.mixing == "unbiased" else 0):
            for i in range(j):
                new = np.flatnonzero((old == i) & (mode == j))
                giver = donors(rng, np.flatnonzero(old == j), new, group)
                x[new, :, i + 2 : j + 2] = before[giver, :, i + 2 : j + 2]
        x = x @ transition(m - 1, DT).T
        for j in range(K):
            L = np.linalg.cholesky(process_noise(j + 1, DT, estimator.process_density))
            x[mode == j, :, : j + 2] += rng.normal(size=(np.sum(mode == j), 2, j + 2)) @ L.T
        if step in times:
            share = np.bincount(mode, minlength=K) / cars
            limit = norm.ppf(1 - 0.005 / looks) * 0.5 / np.sqrt(cars)
            np.testing.assert_allclose(state.probability[0], share, atol=limit)
            mean, covariance = mixture(state)
            error = x.reshape(cars, 2 * m) - mean
            nees = normalised(error, covariance)
            nees_of_position = normalised(error[:, ::m], estimator.covariance(state))
            assert_average(nees.reshape(groups, -1).mean(axis=1), 2 * m, looks)
            assert_average(nees_of_position.reshape(groups, -1).mean(axis=1), 2, looks)
            for entry in error.reshape(groups, -1, 2 * m).mean(axis=1).T:
                assert_average(entry, 0, looks)
