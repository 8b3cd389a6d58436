"""Runs a design study: workers here or on a Dask cluster compute chunks of variants, with one row for each variant.

The output folder has a file for each finished chunk, below a folder named by the study's checksum. The same study with
the same output folder continues where it stopped.
"""

import csv
import json
import os
import platform
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.files import read_text, whole
from rft_ros.parameters import Part, config_of_options
from rft_ros.progress import bar
from rft_ros.rft import AXES, FORCE, POSITION, TWIST, WRENCH
from rft_ros.states_file import read_states, wrenches_along
from rft_ros.sweeps.design import Content, Design, Variant, checksum_of, motion_of
from rft_ros.sweeps.motions import sample

Array = NDArray[np.float64]

RESULTS = (
    *(f"{kind}_{axis}" for kind in ("peak", "mean") for axis in AXES),
    *("peak_force", "vertical_work", "total_work", "path", "plates"),
)
"""Columns of results: wrench on the tool [N], [N m], world axes, peaks by magnitude, signed; work on the grains [J];
path of the tool frame's origin [m]; number of plates."""

_CHUNK_COUNT = 32  # enough to share among workers, few enough for a scheduler (1 ms for each)
_MAX_ROW_COUNT = 100  # of a chunk
_SCHEDULER_TIMEOUT_S = 10.0  # to wait for a scheduler
_SAME_FILE_ADVICE = "give an absolute path, and copy the file to all machines"
_ADVICE = {
    "mesh": _SAME_FILE_ADVICE,
    "file": _SAME_FILE_ADVICE,
    "release": "install the same release on all machines",
}


def evaluate(variant: Variant) -> dict[str, float]:
    """The results of a variant by column. Raises InputError or ValueError if it cannot be computed."""
    from scipy.integrate import trapezoid  # takes 0.3 s, and only this command needs it

    config = config_of_options({**variant.tool, **variant.medium})
    model = config.model({name: _LOADERS[name](part) for name, part in config.parts().items()})
    times, states = _motion(tuple(variant.motion.items()))
    if (np.diff(times) < 0.0).any():
        raise InputError(
            f"states file '{variant.motion['states_file']}': t goes back; work needs it in order"
        )
    height = config.surface_height
    wrench = wrenches_along(
        model, times, states, surface_height=height, where="motion", threads=1
    )[:, WRENCH]
    peak = wrench[np.abs(wrench).argmax(axis=0), np.arange(len(AXES))]
    work = trapezoid(-wrench * states[:, TWIST], times, axis=0)  # positive where the grains resist
    path = np.linalg.norm(np.diff(states[:, POSITION], axis=0), axis=1).sum()
    force = np.linalg.norm(wrench[:, FORCE], axis=1).max()
    results = np.array(
        [*peak, *wrench.mean(axis=0), force, work[2], work.sum(), path, len(model.tool.plates)]
    )
    if not np.isfinite(results).all():
        raise InputError("its forces, work or path are too large")
    return dict(zip(RESULTS, results.tolist(), strict=True))


# Few values are cached, since tools vary slowest and media fastest: 400 motions of 20,000 samples took 0.9 GB.
# `_check_contents` clears them, since files may change between two studies of one worker in a cluster.
def _load(part: Part) -> Any:
    return part.load()


_LOADERS = {
    part: lru_cache(maxsize=size)(_load)
    for part, size in {"tool": 4, "ground": 4, "medium": 16, "table": 16}.items()
}


@lru_cache(maxsize=16)
def _motion(items: tuple[tuple[str, Any], ...]) -> tuple[Array, Array]:
    """Times and states of a motion, from the items of its entry."""
    entry = dict(items)
    if "states_file" in entry:
        return read_states(Path(entry["states_file"]))
    return sample(*motion_of(entry))


def rows_of(
    variants: Sequence[Variant], columns: Sequence[str], contents: tuple[Content, ...] = ()
) -> list[list[str]]:
    """Rows of the table: a variant's values, then its results or the reason why it has none. Runs in a worker.

    Raises InputError if one of the `contents` is another one in this process.
    """
    _check_contents(contents)
    rows = []
    for variant in variants:
        cells = _cells(variant)
        try:
            cells |= evaluate(variant)
        except (ValueError, TypeError, ArithmeticError, MemoryError) as error:
            cells["reason"] = reason_of(error)
        rows.append([str(cells.get(name, "")) for name in columns])
    return rows


@lru_cache(maxsize=1)
def _check_contents(contents: tuple[Content, ...]) -> None:
    """Check the contents of a study once, and forget what was read for another one."""
    for kind, name, checksum in contents:
        if checksum_of(kind, name) != checksum:
            there = f"on {platform.node()}, in {Path.cwd()}"
            raise InputError(
                f"a worker ({there}) has another {kind} '{name}' than this process; {_ADVICE[kind]}"
            )
    for cache in (*_LOADERS.values(), _motion):
        cache.cache_clear()


def _cells(variant: Variant) -> dict[str, Any]:
    return {
        f"{part}.{key}": value
        for part, entry in variant._asdict().items()
        for key, value in entry.items()
    }


def run(
    design: Design,
    out: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    before_workers: Callable[[], None] = lambda: None,
) -> tuple[int, int]:
    """Compute the missing rows of a design and write ``results.csv`` to the folder `out`.

    Returns the number of rows that it computed, and the number of rows without results. `scheduler`: address of a Dask
    scheduler; without it, `workers` processes here (default: one per core). The table has the same bytes either way.
    `before_workers` is called before they start, unless all rows are there. Raises InputError.
    """
    names = [name for variant in design.variants for name in _cells(variant)]
    columns = [*dict.fromkeys(names), *RESULTS, "reason"]
    folder = out / f"chunks_{design.fingerprint():08x}"
    size = min(-(-len(design.variants) // _CHUNK_COUNT), _MAX_ROW_COUNT)
    chunks = {
        folder / f"{k:06d}.json": design.variants[k : k + size]
        for k in range(0, len(design.variants), size)
    }
    with file_errors(f"output folder '{out}'", "written"):
        folder.mkdir(parents=True, exist_ok=True)
    missing = {
        file: chunk for file, chunk in chunks.items() if not _is_finished(file, chunk, columns)
    }
    if missing:
        before_workers()
        with _workers(scheduler, workers) as pool:
            _compute(design, missing, columns, pool)
    failures = _write_table(out / "results.csv", columns, chunks)
    return sum(map(len, missing.values())), failures


def _is_finished(file: Path, chunk: Sequence[Variant], columns: Sequence[str]) -> bool:
    """Whether a chunk has its rows; not where its file is missing, or where a copy of it was cut."""
    try:
        _rows_in(file, chunk, columns)
    except InputError:
        return False
    return True


def _rows_in(file: Path, chunk: Sequence[Variant], columns: Sequence[str]) -> list[list[str]]:
    """The rows of a chunk from its file. Raises InputError, unless there is a whole one for each variant."""
    text = read_text(file, "results")
    try:
        rows = json.loads(text)
    except (ValueError, RecursionError):
        rows = None
    is_whole = isinstance(rows, list) and len(rows) == len(chunk)
    if not is_whole or any(not _is_row(row, columns) for row in rows):
        needed_rows = f"the rows of {len(chunk)} variants"
        raise InputError(f"results '{file}' are not {needed_rows}; run the study again")
    return list(rows)


def _is_row(row: object, columns: Sequence[str]) -> bool:
    return isinstance(row, list) and len(row) == len(columns)


def _write_table(
    file: Path, columns: Sequence[str], chunks: Mapping[Path, Sequence[Variant]]
) -> int:
    """Write the rows of all chunks; returns the number of those without results. Raises InputError."""
    reason = columns.index("reason")
    failures = 0
    with whole(file) as part, part.open("w", encoding="utf-8", newline="") as out:
        table = csv.writer(out, lineterminator="\n")
        table.writerow(columns)
        for chunk_file, chunk in chunks.items():
            rows = _rows_in(chunk_file, chunk, columns)
            table.writerows(rows)
            failures += sum(1 for row in rows if row[reason])
    return failures


def _compute(
    design: Design,
    chunks: Mapping[Path, Sequence[Variant]],
    columns: Sequence[str],
    pool: Executor,
) -> None:
    """Compute chunks, and write each to its file when it is finished."""
    name = design.file.stem
    total = len(design.variants)
    finished_rows = total - sum(map(len, chunks.values()))
    contents = design.contents()
    with bar(name, total) as update:
        try:
            futures = {
                pool.submit(rows_of, chunk, columns, contents): file
                for file, chunk in chunks.items()
            }
        except BrokenProcessPool:  # `_workers` says what it means
            raise
        except (OSError, RuntimeError) as error:  # RuntimeError: no thread can be started
            fewer = "give fewer --workers, or end other processes"
            raise InputError(f"a worker cannot be started: {reason_of(error)}; {fewer}") from None
        for future in as_completed(futures):
            rows = future.result()
            with whole(futures[future]) as part:
                part.write_text(json.dumps(rows), encoding="utf-8")
            finished_rows += len(rows)
            update(finished_rows, f"{name}: {finished_rows:,} of {total:,}")


@contextmanager
def _workers(scheduler: str | None, count: int | None) -> Iterator[Executor]:
    if scheduler is None:
        pool = ProcessPoolExecutor(count, get_context("spawn"), _end_with_parent)
        try:
            yield pool
        except BrokenProcessPool:
            again = "the same command continues with what it has finished"
            raise InputError(
                f"the system ended a worker, perhaps for want of memory; {again}"
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs Dask: pip install 'dask[distributed]'") from None
    try:
        client = Client(scheduler, timeout=_SCHEDULER_TIMEOUT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at '{scheduler}': {error}") from None
    with client:
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise InputError(
                f"the Dask scheduler at '{scheduler}' has no workers; start some with dask worker"
            )
        yield client.get_executor(pure=False, retries=3)  # type: ignore[no-untyped-call]


def _end_with_parent() -> None:
    """In a worker: end when the parent process has ended, even if it was killed, and leave Ctrl-C to it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        parent_process().join()  # type: ignore[union-attr]
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
