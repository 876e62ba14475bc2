"""Claim: an input that kills its worker is told as dead, and no other: those under way beside it,
and those that waited, come out as if nothing had happened."""

import os
import signal
import time
from functools import partial

import pytest

from experiments import engine


def halved(number: int, deadly: frozenset[int]) -> float:
    """Half a number; some kill the process, once others have begun beside them."""
    time.sleep(0.01)
    if number in deadly:
        os.kill(os.getpid(), signal.SIGKILL)
    return number / 2


@pytest.mark.parametrize("deadly", [{0}, {3}, {7}, {2, 3}, {0, 5, 6}])
def test_only_what_kills_its_worker_is_dead(deadly: set[int]) -> None:
    """Wherever it stands, and whoever is its neighbour."""
    work = partial(halved, deadly=frozenset(deadly))
    found = list(engine.outcomes(work, range(8), 2, dead=lambda number: -number - 1.0))
    expected = [-n - 1.0 if n in deadly else n / 2 for n in range(8)]
    assert sorted(found) == sorted(expected)


def test_without_a_word_for_it_a_death_ends_it() -> None:
    """As one line, not as the pool's own error."""
    work = partial(halved, deadly=frozenset({1}))
    with pytest.raises(engine.RunFailed, match="a worker process died"):
        list(engine.outcomes(work, range(3), 2))
