"""Claim: a trace from the cache has the bytes of a simulated one, and the cache fails nobody."""

import dataclasses
import json
import multiprocessing
import os
import resource
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest

import scenarios
import sim_bridge
from mdkf import Trace
from scenarios import Scenario
from sim_bridge import SeedRefused, TraceCache, read_table, trace_cache, user_cache, write_table
from sim_bridge.trace_cache import _makers

SHORT = dataclasses.replace(scenarios.load("bus_stop"), duration=4.0)
OTHER = dataclasses.replace(scenarios.load("emergency_braking"), duration=4.0)


@pytest.fixture
def cache(tmp_path: Path) -> TraceCache:
    """An empty one, whose folder is yet to be made."""
    return TraceCache(tmp_path / "cache" / "traces")


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Name and seed of everything that is simulated in this process."""
    calls = []
    genuine = trace_cache.simulate

    def counted(scenario: Scenario, seed: int, dt: float = 0.1) -> Trace:
        calls.append((scenario.name, seed))
        return genuine(scenario, seed, dt)

    monkeypatch.setattr(trace_cache, "simulate", counted)
    return calls


def only(cache: TraceCache) -> Path:
    """The one file in a cache; nothing else is there, no temporary name either."""
    (path,) = cache.folder.iterdir()
    return path


def test_the_second_time_nothing_is_simulated(
    cache: TraceCache, simulated: list[tuple[str, int]], tmp_path: Path
) -> None:
    """And the trace is the same to the last byte of the file that it makes, provenance included."""
    pure = sim_bridge.simulate(SHORT, 3)
    first, second = cache.simulate(SHORT, 3), cache.simulate(SHORT, 3)
    assert simulated == [("bus_stop", 3)]
    for name, trace in (("pure", pure), ("first", first), ("second", second)):
        assert trace == pure
        assert trace.provenance == trace.ego.provenance == pure.provenance
        write_table(trace, tmp_path / name)
    written = {(tmp_path / name).read_bytes() for name in ("pure", "first", "second")}
    assert written == {only(cache).read_bytes()}
    for column, values in pure.columns().items():
        kept = getattr(second, column)
        assert (kept.dtype, kept.tobytes()) == (values.dtype, values.tobytes())
        assert kept.flags.c_contiguous == values.flags.c_contiguous
    assert sim_bridge.detect(second, seed=3) == sim_bridge.detect(pure, seed=3)


def test_whatever_decides_the_trace_decides_the_file(
    cache: TraceCache, simulated: list[tuple[str, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seed, time between frames, a parameter, the duration, the sources: each is a miss of its
    own, and each is a hit afterwards."""
    slow = dataclasses.replace(scenarios.load("bus_stop", speed=9.0), duration=4.0)
    longer = dataclasses.replace(SHORT, duration=4.5)
    worlds = [(SHORT, 0, 0.1), (SHORT, 1, 0.1), (SHORT, 0, 0.2), (slow, 0, 0.1), (longer, 0, 0.1)]
    made = [cache.simulate(*world) for world in worlds]
    assert len({trace.content_hash() for trace in made}) == len(simulated) == len(worlds)
    assert [cache.simulate(*world) for world in worlds] == made
    assert len(simulated) == len(worlds)
    assert cache.size()[0] == len(worlds)
    monkeypatch.setattr(trace_cache, "_makers", lambda: "other sources")
    assert cache.simulate(*worlds[0]) == made[0]
    assert len(simulated) == len(worlds) + 1


def test_every_source_that_makes_traces_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A changed line in any module of scenarios or sim_bridge, or in mdkf's tables, is another
    version; so is another release of a simulator. A changed tracker is not."""
    root = Path(scenarios.__file__).parents[1]
    for package in ("scenarios", "sim_bridge", "mdkf"):
        (tmp_path / package).mkdir()
        for path in (root / package).glob("*.py"):
            shutil.copy(path, tmp_path / package)
    monkeypatch.setattr(trace_cache, "__file__", str(tmp_path / "sim_bridge" / "trace_cache.py"))
    monkeypatch.setattr(trace_cache.scenarios, "__file__", str(tmp_path / "scenarios" / "x"))
    monkeypatch.setattr(trace_cache.mdkf, "__file__", str(tmp_path / "mdkf" / "__init__.py"))

    def version() -> str:
        _makers.cache_clear()
        return _makers()

    try:
        known = {version()}
        assert version() in known
        tables = ("mdkf/table.py", "mdkf/tables.py")
        for source in ("scenarios/schema.py", "sim_bridge/kinematics.py", *tables):
            path = tmp_path / source
            path.write_text(path.read_text() + "# changed\n")
            assert version() not in known
            known.add(version())
        tracker = tmp_path / "mdkf" / "tracker.py"
        tracker.write_text("# changed\n")
        assert version() in known
        monkeypatch.setattr(trace_cache, "version", lambda package: f"{package} 99")
        assert version() not in known
    finally:
        _makers.cache_clear()


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def foreign(path: Path) -> None:
    path.write_text("frame,x,y\n")


def other_parquet(path: Path) -> None:
    pl.DataFrame({"x": [1.0]}).write_parquet(path)


def other_header(path: Path) -> None:
    header = json.loads(pl.read_parquet_metadata(path)["mdkf"]) | {"provenance": ["seed"]}
    pl.read_parquet(path).write_parquet(path, metadata={"mdkf": json.dumps(header)})


def altered(path: Path) -> None:
    metadata = {"mdkf": pl.read_parquet_metadata(path)["mdkf"]}
    data = pl.read_parquet(path).with_columns(pl.col("x") + 1e-9)
    data.write_parquet(path, metadata=metadata)


def of_another_seed(path: Path) -> None:
    write_table(sim_bridge.simulate(SHORT, 4), path)


def of_another_scenario(path: Path) -> None:
    write_table(sim_bridge.simulate(OTHER, 3), path)


def detections(path: Path) -> None:
    write_table(sim_bridge.detect(sim_bridge.simulate(SHORT, 3), seed=3), path)


@pytest.mark.parametrize(
    "spoil",
    [
        *(truncated, emptied, foreign, other_parquet, other_header, altered),
        *(of_another_seed, of_another_scenario, detections),
    ],
)
def test_what_is_no_such_trace_is_a_miss_and_is_replaced(
    cache: TraceCache, simulated: list[tuple[str, int]], spoil: Callable[[Path], None]
) -> None:
    """Whatever lies under the name, the answer is right, and the next one is quick again."""
    wanted = cache.simulate(SHORT, 3)
    whole = only(cache).read_bytes()
    spoil(only(cache))
    assert only(cache).read_bytes() != whole
    assert cache.simulate(SHORT, 3) == wanted
    assert simulated == [("bus_stop", 3)] * 2
    assert only(cache).read_bytes() == whole
    assert cache.simulate(SHORT, 3) == wanted
    assert len(simulated) == 2


def test_a_folder_under_the_name_is_let_be(cache: TraceCache) -> None:
    """It cannot be replaced; the trace is right all the same."""
    wanted = cache.simulate(SHORT, 3)
    path = only(cache)
    path.unlink()
    (path / "inside").mkdir(parents=True)
    assert cache.simulate(SHORT, 3) == wanted
    assert (path / "inside").is_dir()


def test_a_refused_seed_is_refused_again(
    cache: TraceCache, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refusals pass through, and leave nothing."""

    def refuse(*_: object) -> None:
        raise SeedRefused("bus_stop, seed 3: two cars overlap")

    monkeypatch.setattr(trace_cache, "simulate", refuse)
    for _ in range(2):
        with pytest.raises(SeedRefused):
            cache.simulate(SHORT, 3)
    assert cache.size() == (0, 0)


def test_the_longest_unused_goes_first(tmp_path: Path, simulated: list[tuple[str, int]]) -> None:
    """A cache with room for two of three: the one that was read again stays."""
    unbounded = TraceCache(tmp_path)
    for seed in (0, 1, 2):
        unbounded.simulate(OTHER, seed)
    three = unbounded.size()[1]
    unbounded.clear()
    simulated.clear()
    cache = TraceCache(tmp_path, max_bytes=three - 1)
    for seed in (0, 1):
        cache.simulate(OTHER, seed)
    for path in tmp_path.iterdir():  # both were used long ago ...
        os.utime(path, (0, 0))
    cache.simulate(OTHER, 0)  # ... and this one now
    cache.simulate(OTHER, 2)
    assert cache.size()[0] == 2
    assert cache.size()[1] < three
    simulated.clear()
    cache.simulate(OTHER, 0)
    cache.simulate(OTHER, 2)
    assert simulated == []
    cache.simulate(OTHER, 1)
    assert simulated == [("emergency_braking", 1)]


def test_clearing_takes_the_caches_own_files_alone(cache: TraceCache) -> None:
    """Also temporary ones of writers that died; whatever else lies in the folder stays, and so does
    the temporary file of a writer that may be alive, while traces come and go."""
    cache.simulate(OTHER, 0)
    path = only(cache)
    mine = cache.folder / "mine.parquet"
    dead, alive = (cache.folder / f".{path.name}.{word}.part" for word in ("dead", "alive"))
    for extra in (mine, dead, alive):
        extra.write_bytes(b"x")
    hours_ago = time.time() - 7200.0
    os.utime(dead, (hours_ago, hours_ago))
    cache.simulate(OTHER, 1)
    assert not dead.exists()
    assert alive.exists()
    assert cache.size()[0] == 2
    assert cache.clear() == 2
    assert list(cache.folder.iterdir()) == [mine]
    assert cache.clear() == 0


def hash_in_a_process(folder: Path, start: object, sender: object) -> None:
    """Simulate with a cache as soon as told, and send the trace's hash."""
    start.wait()  # type: ignore[attr-defined]
    sender.send(TraceCache(folder).simulate(SHORT, 3).content_hash())  # type: ignore[attr-defined]


def test_two_processes_write_one_trace_at_once(cache: TraceCache) -> None:
    """Both miss, both write, and a third keeps asking meanwhile: everybody gets the same bytes,
    one whole file stays, and no temporary one."""
    context = multiprocessing.get_context("spawn")
    start = context.Event()
    pipes = [context.Pipe(duplex=False) for _ in range(2)]
    processes = [
        context.Process(target=hash_in_a_process, args=(cache.folder, start, sender))
        for _, sender in pipes
    ]
    for process in processes:
        process.start()
    start.set()
    wanted = sim_bridge.simulate(SHORT, 3).content_hash()
    while any(process.is_alive() for process in processes):
        for path in cache.folder.glob("[!.]*"):
            assert read_table(path, Trace).content_hash() == wanted
    assert [receiver.recv() for receiver, _ in pipes] == [wanted, wanted]
    assert [process.exitcode for process in processes] == [0, 0]
    assert only(cache).suffix == ".parquet"
    assert read_table(only(cache), Trace).content_hash() == wanted


def hash_with_a_full_disk(folder: Path, sender: object) -> None:
    """Simulate where no file can grow beyond a thousand bytes."""
    trace = sim_bridge.simulate(SHORT, 3)  # SUMO's own files are larger
    trace_cache.simulate = lambda *_: trace
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    sender.send(TraceCache(folder).simulate(SHORT, 3).content_hash())  # type: ignore[attr-defined]


def test_a_full_disk_fails_nothing(cache: TraceCache) -> None:
    """The trace comes all the same, and no half of it stays."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=hash_with_a_full_disk, args=(cache.folder, sender))
    process.start()
    assert receiver.recv() == sim_bridge.simulate(SHORT, 3).content_hash()
    process.join()
    assert process.exitcode == 0
    assert list(cache.folder.iterdir()) == []


@pytest.mark.parametrize("inside", ["", "traces"])
def test_a_file_where_the_folder_should_be_fails_nothing(tmp_path: Path, inside: str) -> None:
    """Nor does one above it."""
    file = tmp_path / "here"
    file.write_text("a file")
    cache = TraceCache(file / inside)
    assert cache.simulate(OTHER, 0) == sim_bridge.simulate(OTHER, 0)
    assert cache.size() == (0, 0)
    assert cache.clear() == 0
    assert file.read_text() == "a file"


@pytest.mark.parametrize("mode", [0o000, 0o555])
def test_a_folder_of_somebody_else_fails_nothing(
    cache: TraceCache, monkeypatch: pytest.MonkeyPatch, mode: int
) -> None:
    """One that may not be searched, and one that may only be read; root goes as nobody."""
    first = cache.simulate(OTHER, 0)
    second = sim_bridge.simulate(OTHER, 1)
    monkeypatch.setattr(trace_cache, "simulate", lambda _, seed, dt: (first, second)[seed])
    superuser = os.geteuid() == 0
    cache.folder.chmod(mode)
    # pytest makes its folders for root alone, one deeper in each of several processes.
    for folder in cache.folder.parents if superuser else ():
        if "pytest" in str(folder):
            folder.chmod(0o755)
    if superuser:
        os.seteuid(65534)
    try:
        assert [cache.simulate(OTHER, seed) for seed in (0, 1)] == [first, second]
        assert cache.size()[0] == (mode != 0)
    finally:
        if superuser:
            os.seteuid(0)
        cache.folder.chmod(0o755)
    assert cache.size()[0] == 1


def test_formulas_and_recordings_are_not_kept(cache: TraceCache) -> None:
    """They take no longer than reading a file."""
    scenario = scenarios.load("circle")
    assert cache.simulate(scenario, 0) == sim_bridge.simulate(scenario, 0)
    assert not cache.folder.exists()


def test_the_users_cache_is_where_the_environment_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MDKF_CACHE, XDG_CACHE_HOME if it is absolute, ~/.cache; and off."""
    assert user_cache() is None  # in tests, by tests/conftest.py
    monkeypatch.setenv("MDKF_CACHE", str(tmp_path / "mine"))
    assert user_cache() == TraceCache(tmp_path / "mine" / "traces")
    monkeypatch.delenv("MDKF_CACHE")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert user_cache() == TraceCache(tmp_path / "xdg" / "mdkf" / "traces")
    for absent in ("", "relative"):
        monkeypatch.setenv("XDG_CACHE_HOME", absent)
        assert user_cache() == TraceCache(tmp_path / "home" / ".cache" / "mdkf" / "traces")
