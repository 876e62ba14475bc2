"""Estimators of somebody else's at work: what goes wrong in one is told in one line."""

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

import mdkf
from experiments.engine import RunFailed
from mdkf import Estimator


@contextmanager
def told_of(estimator: Estimator) -> Iterator[None]:
    """Whatever an estimator that is not this project's raises becomes `RunFailed`, with its class,
    the error, and the last line of its own file on the way there. This project's own errors are
    mistakes, and keep their traceback."""
    kind = type(estimator)
    try:
        yield
    except Exception as error:
        if kind.__module__.partition(".")[0] == mdkf.__name__:
            raise
        told = f"estimator {kind.__qualname__}: {type(error).__name__}: {error}"
        file = getattr(sys.modules.get(kind.__module__), "__file__", None)
        own = [at for at in traceback.extract_tb(error.__traceback__) if at.filename == file]
        place = f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""
        raise RunFailed(" ".join(f"{told}{place}".split())) from error
