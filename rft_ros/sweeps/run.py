"""Run a design study: chunks of variants go to workers, local or on a Dask cluster; every variant gets one row.

The output folder holds the state of the run: the study's checksum in `study.json`, and a file for each finished chunk.
The same study with the same folder continues where it stopped, and computes chunks with failed rows again.
"""

import csv
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import lru_cache, partial
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.files import whole
from rft_ros.parameters import model_of, tool_request
from rft_ros.progress import bar
from rft_ros.states_file import read_states, wrenches_along
from rft_ros.sweeps.design import Design, Variant, motion_of, parameters_of
from rft_ros.sweeps.motions import sample
from rft_ros.tool import Tool, ToolRequest

__all__ = ["RESULTS", "Report", "evaluate", "row_of", "run"]

Array = NDArray[np.float64]
Rows = list[list[str]]

RESULTS = (
    *(f"{kind}_{axis}" for kind in ("peak", "mean") for axis in ("fx", "fy", "fz", "tx", "ty", "tz")),
    *("peak_force", "vertical_work", "total_work", "path", "plates"),
)
"""Columns of results: wrench on the tool [N], [N m], world axes, peaks by magnitude, signed; work on the grains [J];
path of the tool frame's origin [m]; number of plates."""

_CHUNKS, _MOST_ROWS = 32, 100  # enough chunks to share and to continue with; few enough for a scheduler: 1 ms a task
_PATIENCE = 10.0  # with a scheduler [s]
_ATTEMPTS = 6  # with new workers, when the system kills one


class Report(NamedTuple):
    """The outcome of a run. `rows`: in the table; `computed`: by this run in `seconds`; `failed`: without numbers."""

    file: Path
    rows: int
    computed: int
    failed: int
    seconds: float

    def lines(self) -> list[str]:
        """Sentences for the terminal."""
        rate = f"{self.computed:,} computed in {self.seconds:.1f} s, {self.computed / self.seconds:,.0f} per second"
        return [f"{self.rows:,} variants, {self.failed:,} without numbers -> {self.file}", *[rate][: self.computed]]


def evaluate(variant: Variant, fingerprint: int = 0) -> dict[str, float]:
    """The results of a variant by column. Raises InputError or ValueError if it cannot be computed.

    Files are read once for each `fingerprint`, that of the design.
    """
    values: Mapping[str, Any] = parameters_of(tool=variant["tool"], medium=variant["medium"])
    model = model_of(values, tool=_tool(tool_request(values), fingerprint))
    times, states = _motion(tuple(variant["motion"].items()), fingerprint)
    scene = {"mobilization_length": model.mobilization_length, "surface_height": values["surface_height"]}
    wrench = wrenches_along(model.tool.plates, model.law, times, states, **scene, where="motion", threads=1)[:, :6]
    peak = wrench[np.abs(wrench).argmax(axis=0), np.arange(6)]
    work = trapezoid(-wrench * states[:, 7:13], times, axis=0)  # positive where the grains resist
    path = np.linalg.norm(np.diff(states[:, :3], axis=0), axis=1).sum()
    force = np.linalg.norm(wrench[:, :3], axis=1).max()
    results = [*peak, *wrench.mean(axis=0), force, work[2], work.sum(), path, len(model.tool.plates)]
    if not np.isfinite(results).all():
        raise InputError("its forces, work or path are too large")
    return dict(zip(RESULTS, map(float, results), strict=True))


# `_fingerprint` is part of the caches' keys: a worker of a cluster sees files change between studies.
@lru_cache(maxsize=64)
def _tool(request: ToolRequest, _fingerprint: int) -> Tool:
    return request.load()


@lru_cache(maxsize=4096)
def _motion(items: tuple[tuple[str, Any], ...], _fingerprint: int) -> tuple[Array, Array]:
    """Times and states of a motion, from the items of its entry."""
    entry = dict(items)
    return read_states(Path(entry["states_file"])) if "states_file" in entry else sample(*motion_of(entry))


def row_of(variant: Variant, columns: Sequence[str], fingerprint: int = 0) -> list[str]:
    """A row of the table: the variant's values, then its results or the reason why it has none."""
    cells = {f"{part}.{key}": value for part, values in variant.items() for key, value in values.items()}
    try:
        cells |= evaluate(variant, fingerprint)
    except (ValueError, TypeError, ArithmeticError, MemoryError) as error:
        cells["reason"] = reason_of(error)
    return [str(cells.get(name, "")) for name in columns]


def rows_of(variants: Sequence[Variant], columns: Sequence[str], fingerprint: int) -> Rows:
    """Compute rows; runs in a worker."""
    return [row_of(variant, columns, fingerprint) for variant in variants]


def run(
    design: Design,
    out: Path,
    *,
    scheduler: str | None = None,
    workers: int | None = None,
    form: Literal["csv", "parquet"] = "csv",
) -> Report:
    """Compute the missing rows of a design and write the table to the folder `out`.

    `scheduler`: address of a Dask scheduler, such as tcp://10.0.0.1:8786; without it, `workers` processes here
    (default: one per core). The table has the same bytes however it was computed. Raises InputError.
    """
    parts = {"tool": design.tools, "motion": design.motions, "medium": design.media}
    own = dict.fromkeys(f"{part}.{key}" for part, entries in parts.items() for entry in entries for key in entry)
    columns, total, name = [*own, *RESULTS, "reason"], len(design), design.file.stem
    with file_errors(f"output folder '{out}'", "written"):
        (out / "chunks").mkdir(parents=True, exist_ok=True)
        record, fingerprint = out / "study.json", design.fingerprint()
        if record.exists() and record.read_bytes() != f"{fingerprint}\n".encode():
            raise InputError(
                f"'{out}' holds the rows of a study other than '{design.file}', or of other meshes, states files or"
                " another version of rft_ros; choose another folder or delete this one"
            )
        _write(record, [[str(fingerprint)]])
        size = min(-(-total // _CHUNKS), _MOST_ROWS)
        chunks = {out / "chunks" / f"{k:06d}.csv": range(k, min(k + size, total)) for k in range(0, total, size)}
        tasks = {
            file: [design.variant(i) for i in numbers]
            for file, numbers in chunks.items()
            if not (file.exists() and [row[-1:] for row in _read(file)] == [[""]] * len(numbers))
        }
        computed, start = sum(map(len, tasks.values())), time.perf_counter()
        if tasks:
            compute = partial(rows_of, columns=columns, fingerprint=fingerprint)
            with _workers(scheduler, workers or os.cpu_count()) as executor, bar(name, total) as update:
                done = total - computed
                update(done, name)
                for file, rows in _answers(executor, tasks, compute):
                    _write(file, rows)
                    done += len(rows)
                    update(done, f"{name}: {done:,} of {total:,}")
        seconds = time.perf_counter() - start
        rows = [row for file in chunks for row in _read(file)]
        _write(table := out / "results.csv", [columns, *rows])
        table = _parquet(table) if form == "parquet" else table
    return Report(table, total, computed, sum(bool(row[-1]) for row in rows), seconds)


@contextmanager
def _workers(scheduler: str | None, count: int | None) -> Iterator[Callable[[], Executor]]:
    """A function that returns a new executor."""
    if scheduler is None:
        yield partial(ProcessPoolExecutor, count, get_context("spawn"), _end_with_parent)
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs Dask: pip install 'rft_ros[sweep]'") from None
    try:
        client = Client(scheduler, timeout=_PATIENCE)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at '{scheduler}': {error}") from None
    with client:
        if not client.scheduler_info(n_workers=-1)["workers"]:
            raise InputError(f"the Dask scheduler at '{scheduler}' has no workers")
        yield partial(client.get_executor, pure=False, retries=3)


def _end_with_parent() -> None:
    """In a worker: end when the parent process has ended, even if it was killed."""

    def watch() -> None:
        parent_process().join()  # type: ignore[union-attr]
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _answers(
    executor: Callable[[], Executor], tasks: Mapping[Path, Sequence[Variant]], compute: Callable[..., Rows]
) -> Iterator[tuple[Path, Rows]]:
    left = dict(tasks)
    for _ in range(_ATTEMPTS):
        pool, futures = executor(), dict[Future[Rows], Path]()
        try:
            for file, variants in left.items():
                futures[pool.submit(compute, variants)] = file
            for future in as_completed(futures):
                rows = future.result()
                del left[futures[future]]
                yield futures[future], rows
            return
        except BrokenProcessPool:
            continue
        finally:
            for future in futures:
                future.cancel()
            pool.shutdown()
    raise InputError(f"workers were killed {_ATTEMPTS} times; out of memory?")


def _write(file: Path, rows: Iterable[Sequence[str]]) -> None:
    with whole(file) as part, part.open("w", encoding="utf-8", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(rows)


def _read(file: Path) -> Rows:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.reader(lines))


def _parquet(table: Path) -> Path:
    """The table as a Parquet file beside it."""
    try:
        import pyarrow  # type: ignore[import-untyped]
        from pyarrow import csv as arrow_csv
        from pyarrow import parquet
    except ImportError:
        raise InputError("--format parquet needs pyarrow: pip install 'rft_ros[sweep]'") from None
    typed = arrow_csv.ConvertOptions(column_types={"reason": pyarrow.string()})  # it may be empty in every row
    with whole(table.with_suffix(".parquet")) as part:
        parquet.write_table(arrow_csv.read_csv(table, convert_options=typed), part)
    return table.with_suffix(".parquet")
