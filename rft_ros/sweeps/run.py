"""Run a design study: chunks of variants go to workers, local or on a Dask cluster; every variant gets one row.

The output folder holds the state of the run: `study.json` and a file for each finished chunk. The same study with the
same folder continues where it stopped, and computes chunks with failed rows again.
"""

import csv
import io
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import Literal

from rft_ros.errors import InputError, file_errors
from rft_ros.files import whole
from rft_ros.progress import bar
from rft_ros.sweeps.design import Design, Variant
from rft_ros.sweeps.outcomes import RESULTS, row_of

__all__ = ["Report", "run"]

_CHUNK_SECONDS = 0.5  # of one worker; a scheduler takes about 1 ms per task
_PROBE_SECONDS = 0.1  # spent on measuring the time per variant
_RESTARTS = 5  # of the pool, when the system kills a worker

Rows = tuple[list[list[str]], float]
"""Rows of a chunk, and the seconds they took."""

Compute = Callable[[Sequence[Variant]], Rows]


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """The outcome of a run. `rows`: in the table. `computed`: of these, by this run. `failed`: rows without numbers.

    `seconds`: wall time. `busy`: the workers' time, summed [s]. `workers`: their number. `chunk`: variants per task.
    """

    file: Path
    rows: int
    computed: int
    failed: int
    seconds: float
    busy: float
    workers: int
    chunk: int

    def lines(self) -> list[str]:
        """Sentences for the terminal."""
        text = [f"{self.rows:,} variants, {self.failed:,} without numbers -> {self.file}"]
        if self.computed:
            idle = max(0.0, 1.0 - self.busy / (self.seconds * self.workers))
            text.append(
                f"{self.computed:,} computed in {self.seconds:.1f} s by {self.workers} workers, {self.chunk} per task,"
                f" {self.computed / self.seconds:,.0f} per second; workers idle for {100 * idle:.0f} %"
            )
        return text


def rows_of(variants: Sequence[Variant], columns: Sequence[str], fingerprint: int) -> Rows:
    """Compute rows; runs in a worker."""
    start = time.perf_counter()
    return [row_of(variant, columns, fingerprint) for variant in variants], time.perf_counter() - start


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
    columns = _columns(design)
    compute = partial(rows_of, columns=columns, fingerprint=design.fingerprint)
    with file_errors(f"output folder '{out}'", "written"):
        (out / "chunks").mkdir(parents=True, exist_ok=True)
        chunk = _chunk_size(design, out, compute)
        chunks = [range(k, min(k + chunk, len(design))) for k in range(0, len(design), chunk)]
        missing = [k for k, rows in enumerate(chunks) if not _finished(_file(out, k), len(rows))]
        start, busy, computed, used = time.perf_counter(), 0.0, 0, 0
        if missing:
            tasks = {k: [design.variant(i) for i in chunks[k]] for k in missing}
            done = len(design) - sum(map(len, tasks.values()))
            with (
                _workers(scheduler, workers or os.cpu_count() or 1) as (used, executor),
                bar(design.file.stem, len(design), delay=0.0) as update,
            ):
                update(done, design.file.stem)
                for k, (rows, seconds) in _answers(executor, tasks, compute):
                    with whole(_file(out, k)) as part:
                        part.write_text(_text(rows), encoding="utf-8")
                    computed, busy = computed + len(rows), busy + seconds
                    rate, finished = computed / (time.perf_counter() - start), done + computed
                    update(finished, f"{design.file.stem}: {finished:,} of {len(design):,}, {rate:,.0f}/s")
        spent = time.perf_counter() - start
        rows = [row for k in range(len(chunks)) for row in _read(_file(out, k))]
        file = _table(out, columns, rows, form)
    failed = sum(bool(row[-1]) for row in rows)
    return Report(
        file=file, rows=len(rows), computed=computed, failed=failed, seconds=spent, busy=busy, workers=used, chunk=chunk
    )


def _columns(design: Design) -> list[str]:
    parts = {"tool": design.tools, "motion": design.motions, "medium": design.media}
    own = dict.fromkeys(f"{part}.{key}" for part, entries in parts.items() for entry in entries for key in entry)
    return [*own, *RESULTS, "reason"]


def _chunk_size(design: Design, out: Path, compute: Compute) -> int:
    """Variants per chunk: as recorded in the folder, or so that a chunk takes a worker half a second."""
    file = out / "study.json"
    if file.exists():
        try:
            kept = json.loads(file.read_text(encoding="utf-8"))
            chunk, fingerprint = int(kept["chunk"]), int(kept["fingerprint"])
        except (ValueError, KeyError, TypeError):
            raise InputError(f"'{file}' is not a record of a study; choose another output folder") from None
        if fingerprint != design.fingerprint:
            raise InputError(
                f"'{out}' holds the rows of a study other than '{design.file}', or of other meshes, states files or"
                " another version of rft_ros; choose another folder or delete this one"
            )
        return chunk
    compute([design.variant(0)])  # compiles
    count, start = 0, time.perf_counter()
    while (spent := time.perf_counter() - start) < _PROBE_SECONDS:
        compute([design.variant(count % len(design))])
        count += 1
    chunk = max(1, min(round(_CHUNK_SECONDS * count / spent), math.ceil(len(design) / (4 * (os.cpu_count() or 1)))))
    with whole(file) as part:
        part.write_text(
            json.dumps({"chunk": chunk, "fingerprint": design.fingerprint, "variants": len(design)}) + "\n",
            encoding="utf-8",
        )
    return chunk


@contextmanager
def _workers(scheduler: str | None, count: int) -> Iterator[tuple[int, Callable[[], Executor]]]:
    """The number of workers, and a function that returns a new executor of them."""
    if scheduler is None:
        yield count, partial(ProcessPoolExecutor, count, get_context("spawn"), _end_with_parent)
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError("--scheduler needs Dask: pip install 'rft_ros[sweep]'") from None
    try:
        client = Client(scheduler, timeout="10s")  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at '{scheduler}': {error}") from None
    with client:
        used = len(client.scheduler_info(n_workers=-1)["workers"])
        if not used:
            raise InputError(f"the Dask scheduler at '{scheduler}' has no workers")
        yield used, partial(client.get_executor, pure=False, retries=3)


def _end_with_parent() -> None:
    """In a worker: end when the parent process has ended, even if it was killed."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _answers(
    executor: Callable[[], Executor], tasks: Mapping[int, Sequence[Variant]], compute: Compute
) -> Iterator[tuple[int, Rows]]:
    left = dict(tasks)
    for restart in range(_RESTARTS + 1):
        pool, futures = executor(), dict[Future[Rows], int]()
        try:
            for k, variants in left.items():
                futures[pool.submit(compute, variants)] = k
            for future in as_completed(futures):
                rows = future.result()
                del left[futures[future]]
                yield futures[future], rows
            return
        except BrokenProcessPool:
            if restart == _RESTARTS:
                raise InputError(f"workers were killed {restart + 1} times; out of memory?") from None
        finally:
            for future in futures:
                future.cancel()
            pool.shutdown()


def _file(out: Path, chunk: int) -> Path:
    return out / "chunks" / f"{chunk:06d}.csv"


def _finished(file: Path, rows: int) -> bool:
    """Whether the file of a chunk has all its rows, none with a reason why it failed."""
    return file.exists() and [row[-1:] for row in _read(file)] == [[""]] * rows


def _text(rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _read(file: Path) -> list[list[str]]:
    with file.open(encoding="utf-8", newline="") as lines:
        return list(csv.reader(lines))


def _table(out: Path, columns: list[str], rows: list[list[str]], form: str) -> Path:
    text, file = _text([columns, *rows]), out / f"results.{form}"
    if form == "csv":
        with whole(file) as part:
            part.write_text(text, encoding="utf-8")
        return file
    try:
        import pyarrow  # type: ignore[import-untyped]
        from pyarrow import csv as arrow_csv
        from pyarrow import parquet
    except ImportError:
        raise InputError("--format parquet needs pyarrow: pip install 'rft_ros[sweep]'") from None
    typed = arrow_csv.ConvertOptions(column_types={"reason": pyarrow.string()})  # it may be empty in every row
    with whole(file) as part:
        parquet.write_table(arrow_csv.read_csv(io.BytesIO(text.encode()), convert_options=typed), part)
    return file
