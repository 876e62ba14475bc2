"""A sweep's tasks on a cluster: the workers of a running Dask scheduler.

Where it runs (SSH, SLURM, Kubernetes) is Dask's business: all that is needed is its address. Rows
come back through the scheduler; the workers need this package in the same place, not the folder of
results.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError

from experiments import engine
from experiments.engine import RunFailed
from experiments.sweeps import task
from experiments.sweeps.progress import Progress
from experiments.sweeps.sweep import SweepError
from experiments.sweeps.task import Rows, Task

TIMEOUT = 10
"""How long a scheduler may take to answer [s]."""

AHEAD = 2
"""Tasks with the cluster for each of its threads: one that runs, one that waits."""


def on_cluster(
    address: str,
    tasks: Sequence[Task],
    progress: Progress,
    dead: Callable[[Task], Rows | None],
) -> Iterator[Rows | None]:
    """The rows of tasks as they come; those that `dead` gives of a task when more of the workers
    that did it died than the scheduler allows (`distributed.scheduler.allowed-failures`).

    Raises `SweepError` for what is no address, `RunFailed` without Dask, without an answer from the
    scheduler, and when it is lost.
    """
    try:
        from distributed import Client, KilledWorker
        from distributed.comm.addressing import resolve_address
    except ImportError:
        raise RunFailed("--dask needs Dask: install mdkf[cluster]") from None
    try:
        # Not left to the client: one that could not be made hangs, and complains, when deleted.
        resolve_address(address)
    except (OSError, OverflowError, ValueError) as error:
        raise SweepError(
            f"--dask {address}: {error}; expected an address such as tcp://10.0.0.1:8786"
        ) from None
    try:
        client = Client(address, timeout=TIMEOUT, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        told = " ".join(str(error).split())
        raise RunFailed(f"no Dask scheduler answers at {address}: {told}") from None
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise RunFailed(f"the Dask scheduler at {address} has no workers")
        progress.workers = threads
        try:
            work: Callable[[Task], Rows | None] = task.do
            yield from engine.on_executor(
                work,
                tasks,
                client.get_executor(),
                AHEAD * threads,
                (KilledWorker,),
                dead,
            )
        except CancelledError:
            raise RunFailed(f"the Dask scheduler at {address} is gone") from None
