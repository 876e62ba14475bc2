"""Inputs into outcomes, by a function of plain data, on a pool of processes or on a cluster.

Ctrl-C finishes what is under way; what was finished before a worker died is not lost.
"""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from itertools import islice
from multiprocessing import connection
from typing import TypeVar

Input = TypeVar("Input")
Outcome = TypeVar("Outcome")

Parts = Sequence[Callable[[], object]]


class RunFailed(RuntimeError):
    """The work failed, not the input; the message is one line."""


DIED = "a worker process died (killed, or out of memory)"


def outcomes(
    work: Callable[[Input], Outcome],
    inputs: Sequence[Input],
    workers: int | None = None,
    warm_up: Parts = (),
    dead: Callable[[Input], Outcome] | None = None,
) -> Iterator[Outcome]:
    """The outcomes of `work` as they come.

    workers: processes, the machine's cores if None; 1 works in this process. warm_up: what the
    workers do first, each a part: compiling kernels, on a machine's first run. dead: the outcome
    of an input whose worker dies; the others' are not affected. On Ctrl-C come the outcomes of the
    inputs under way, then the interrupt.

    Raises what `work` raises, and `RunFailed` if a worker dies and `dead` is None.
    """
    workers = workers or cores()
    # One input alone is done here too, unless it may be the death of who does it.
    if workers == 1 or not inputs or (len(inputs) == 1 and dead is None):
        yield from map(work, inputs)
        return
    workers = min(workers, len(inputs))
    waiting, suspects = iter(inputs), list[Input]()
    # One more is with them, so that nobody idles while what came of another is taken care of.
    width = workers + 1
    while not (yield from _on_processes(work, waiting, workers, width, warm_up, suspects)):
        if dead is None:
            raise RunFailed(DIED)
        # All that was under way is done again, one at a time: now who is under way is to blame.
        again, blamed = iter(suspects), list[Input]()
        while not (yield from _on_processes(work, again, 1, 1, (), blamed)):
            yield dead(blamed.pop())
        suspects.clear()


def on_executor(
    work: Callable[[Input], Outcome],
    inputs: Iterable[Input],
    executor: Executor,
    width: int,
    deaths: tuple[type[BaseException], ...],
    dead: Callable[[Input], Outcome],
) -> Iterator[Outcome]:
    """The outcomes of `work` on someone else's executor, such as a cluster's, as they come.

    width: how many inputs are with it at a time. deaths: what a future raises whose worker died
    for good; `dead` gives the outcome of its input. Ctrl-C as in `outcomes`.
    """
    for one, future in _finished(executor, work, iter(inputs), width):
        try:
            outcome = future.result()
        except deaths:
            outcome = dead(one)
        yield outcome


def cores() -> int:
    """Cores that this process may use; where the system does not tell, all."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _on_processes(
    work: Callable[[Input], Outcome],
    waiting: Iterator[Input],
    workers: int,
    width: int,
    warm_up: Parts,
    suspects: list[Input],
) -> Generator[Outcome, None, bool]:
    """Outcomes by a pool of its own, until all are done or a worker dies, which breaks the pool:
    what was with it then goes to `suspects`. width: inputs that are with it at a time. Returns
    whether none died."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_die_with_parent)
    try:
        with _interrupts_ignored():
            for part in warm_up:
                pool.submit(part)
        for one, future in _finished(pool, work, waiting, width):
            if isinstance(future.exception(), BrokenProcessPool):
                suspects.append(one)
            else:
                yield future.result()
    finally:
        pool.shutdown(cancel_futures=True)
    return not suspects


def _finished(
    pool: Executor, work: Callable[[Input], Outcome], waiting: Iterator[Input], width: int
) -> Iterator[tuple[Input, Future[Outcome]]]:
    """Inputs and their futures, as they are finished; `width` of them are under way at a time. A
    broken pool is given nothing more."""
    under_way: dict[Future[Outcome], Input] = {}

    def begin(number: int) -> None:
        with _interrupts_ignored():
            for one in islice(waiting, number):
                under_way[_submitted(pool, work, one)] = one

    begin(width)
    try:
        while under_way:
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            if not any(isinstance(future.exception(), BrokenProcessPool) for future in done):
                begin(len(done))
            for future in done:
                yield under_way.pop(future), future
    except KeyboardInterrupt:
        for future, one in under_way.items():
            if future.exception() is None:
                yield one, future
        raise


def _submitted(pool: Executor, work: Callable[[Input], Outcome], one: Input) -> Future[Outcome]:
    """The future of one input; of a pool that breaks just now one that says so."""
    try:
        return pool.submit(work, one)
    except BrokenProcessPool as error:
        future: Future[Outcome] = Future()
        future.set_exception(error)
        return future


def _die_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def watch() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


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
