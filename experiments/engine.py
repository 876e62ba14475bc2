"""Inputs into outcomes, by a function of plain data, on a pool of processes.

Ctrl-C finishes what is under way; a worker that dies ends the work with `RunFailed`, and what was
finished before is not lost.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

Input = TypeVar("Input")
Outcome = TypeVar("Outcome")


class RunFailed(RuntimeError):
    """The work failed, not the input; the message is one line."""


def outcomes(
    work: Callable[[Input], Outcome],
    inputs: Sequence[Input],
    workers: int | None = None,
    warm_up: Sequence[Callable[[], object]] = (),
) -> Iterator[Outcome]:
    """The outcomes of `work` as they come.

    workers: processes, the machine's cores if None; 1 works in this process. warm_up: what the
    workers do first, each a part: compiling kernels, on a machine's first run. On Ctrl-C come
    those of the inputs under way, then the interrupt.

    Raises what `work` raises, and `RunFailed` if a worker dies.
    """
    workers = min(workers or cores(), max(len(inputs), 1))
    if workers == 1:
        yield from map(work, inputs)
        return
    waiting = iter(inputs)
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"))
    running: set[Future[Outcome]] = set()
    try:
        with _interrupts_ignored():
            for part in warm_up:
                pool.submit(part)
            running.update(pool.submit(work, one) for one in islice(waiting, workers))
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running.update(pool.submit(work, one) for one in islice(waiting, len(done)))
            yield from (future.result() for future in done)
    except BrokenProcessPool:
        raise RunFailed("a worker process died (killed, or out of memory)") from None
    except KeyboardInterrupt:
        yield from (future.result() for future in running if future.exception() is None)
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def cores() -> int:
    """Cores that this process may use; where the system does not tell, all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Ctrl-C reaches the whole process group; workers started in here leave it to the parent."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
