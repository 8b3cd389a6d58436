"""What `rft doctor` says of random cells, right and with single faults: ``python -m bench.doctor --random N``.

Everything runs in this process; every eighth cell also goes through a bag. The same seeds give the same cells.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.random_cells import RandomCell, Recording, random_cell
from bench.random_faults import FAULTS, Setup, faulty, fits, right
from rft_ros.bags.options import ReplayOptions, topics_of
from rft_ros.diagnosis import TOOL_TOLERANCE_SHARE, Finding
from rft_ros.doctor.checkup import Cell, Checkup, examine_bag
from rft_ros.estimator import PoseSample, Sample, TwistSample, WrenchSample
from rft_ros.parameters import Config, Value

START_NS = 1_700_000_000_000_000_000
ARRIVAL_NS = 1_000_000
EFFECTS = frozenset({"estimates", "compiled"})
"""Findings that another one explains."""
RIGHT = "right"
BAG_EVERY = 8
SEED_STEP = 2
"""Odd seeds are for choosing limits, even ones for reporting."""

Verdict = Literal["clean", "named alone", "named with others", "only another", "silent"]
Written = Literal["nothing written", "clean again", "still a finding", "wrong, then all right"]

# how far a written value may lie from the true one
NEAR_SURFACE_M = 0.004
NEAR_DELAY_S = 0.015
NEAR_BIAS_N = 0.5
NEAR_BIAS_SHARE = 0.05
NEAR_MASS_KG = 0.06
NEAR_LEVER_M = 0.03
NEAR_ZETA_SHARE = 0.25
MAX_MISFIT_MORE = 0.1
"""A mended file may explain this share less of the readings than the right one."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A cell with a fault, or with none, what the doctor found and what its file led to."""

    cell: RandomCell
    kind: str
    findings: Sequence[Finding]
    verdict: Verdict
    written: Written
    wrong_values: str = ""

    @property
    def again(self) -> str:
        """The command that shows this case alone."""
        return f"python -m bench.doctor --random 1 --seed {self.cell.seed} --kinds '{self.kind}'"


def findings_of(setup: Setup) -> list[Finding]:
    """What the doctor finds wrong with a set-up."""
    checkup = Checkup(_cell(setup), live=False)
    for stamp, sample in samples_of(setup.recording):
        checkup.push(sample, stamp + ARRIVAL_NS)
    return [finding for finding in checkup.findings() if not finding.ok]


def findings_from_bag(setup: Setup) -> list[Finding]:
    """The same by way of a bag."""
    with tempfile.TemporaryDirectory() as folder:
        bag = write_bag(Path(folder) / "bag", setup.recording)
        found = examine_bag(_cell(setup), bag, ReplayOptions())
    return [finding for finding in found if not finding.ok]


def _cell(setup: Setup) -> Cell:
    config = Config.of(setup.parameters)
    return Cell(
        file=Path("cell.yaml"),
        config=config,
        named=setup.parameters,
        model=config.changed({"tolerance": TOOL_TOLERANCE_SHARE}).model(),
        topics=topics_of(config),
    )


def stamp_ns(seconds: float) -> int:
    """A time of a recording as a stamp [ns]."""
    return START_NS + round(1e9 * seconds)


def samples_of(recording: Recording) -> Iterator[tuple[int, Sample]]:
    """The samples of a recording in the order of their stamps [ns]."""
    samples: list[tuple[int, Sample]] = []
    for seconds, wrench in zip(
        recording.wrench_time.tolist(), recording.wrenches.tolist(), strict=True
    ):
        stamp = stamp_ns(seconds)
        samples.append((stamp, WrenchSample(stamp, "ft_sensor", tuple(wrench))))
    for k, seconds in enumerate(recording.time.tolist()):
        stamp = stamp_ns(seconds)
        if recording.twists is not None:
            twist = recording.twists[k].tolist()
            samples.append(
                (stamp, TwistSample(stamp, "world", tuple(twist[:3]), tuple(twist[3:])))
            )
        pose = recording.poses[k].tolist()
        samples.append((stamp, PoseSample(stamp, "world", tuple(pose[:3]), tuple(pose[3:]))))
    yield from sorted(samples, key=lambda one: one[0])


def write_bag(path: Path, recording: Recording) -> Path:
    """A bag of a recording, on the node's topics."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test" / "unit"))
    from recordings import write_ros2  # type: ignore[import-not-found]

    rows: list[tuple[str, int, int, tuple[float, ...]]] = []
    for stamp, sample in samples_of(recording):
        if isinstance(sample, WrenchSample):
            rows.append(("wrench", stamp + ARRIVAL_NS, stamp, sample.wrench))
        elif isinstance(sample, TwistSample):
            rows.append(("twist", stamp + ARRIVAL_NS, stamp, (*sample.linear, *sample.angular)))
        elif isinstance(sample, PoseSample):
            rows.append(
                ("pose", stamp + ARRIVAL_NS, stamp, (*sample.position, *sample.quaternion))
            )
    written: Path = write_ros2(path, rows)
    return written


def verdict_of(kind: str, findings: Iterable[Finding]) -> Verdict:
    """Whether the findings name the fault."""
    causes = FAULTS[kind].causes if kind != RIGHT else ()
    names = {finding.name for finding in findings} - EFFECTS
    if kind == RIGHT:
        return "only another" if names else "clean"
    named = {name for name in names if name in causes}
    # alternatives that fit alike are named in one finding
    is_sure = not any(finding.alike for finding in findings)
    if named:
        return "named alone" if named == names and is_sure else "named with others"
    return "only another" if names else "silent"


def remedies(findings: Iterable[Finding]) -> dict[str, Value]:
    """What ``--write`` changes in the file."""
    changes: dict[str, Value] = {}
    for finding in findings:
        if not finding.alike:
            changes |= finding.remedy
    return changes


def wrong_values(cell: RandomCell, setup: Setup, changes: dict[str, Any]) -> str:
    """Which written values are wrong, in words; "" if none is."""
    true = {**cell.parameters, **setup.true}
    mended = Setup(parameters={**setup.parameters, **changes}, recording=setup.recording)
    wrong = [name for name in changes if not _is_near(cell, name, changes[name], true.get(name))]
    misfit = fits(mended)
    of_right = fits(right(cell))
    if misfit > of_right + MAX_MISFIT_MORE:
        wrong.append(f"misfit {misfit:.2f} for {of_right:.2f}")
    return ", ".join(wrong)


def _is_near(cell: RandomCell, name: str, value: Any, true: Any) -> bool:
    """Whether a written value is near the true one; of an orientation the misfit tells, since others are alike."""
    far = (
        np.abs(np.subtract(value, true)).max()
        if isinstance(true, tuple | float)
        and name
        not in (
            "sensor.quaternion",
            "mesh.quaternion",
            "mesh.origin",
            "mesh.scale",
        )
        else 0.0
    )
    limits = {
        "surface_height": NEAR_SURFACE_M,
        "sensor.delay": NEAR_DELAY_S,
        "sensor.bias": max(NEAR_BIAS_N, NEAR_BIAS_SHARE * cell.peak),
        "sensor.mass": NEAR_MASS_KG,
        "sensor.position": NEAR_LEVER_M,
        "medium.zeta": NEAR_ZETA_SHARE * cell.true_zeta if cell.true_zeta else np.inf,
    }
    return bool(far <= limits.get(name, np.inf))


def examined(cell: RandomCell, kind: str, *, by_bag: bool = False) -> Case | None:
    """The case of a cell and a kind of fault; None if the cell cannot have it."""
    setup = right(cell) if kind == RIGHT else faulty(cell, kind)
    if setup is None:
        return None
    findings = findings_from_bag(setup) if by_bag else findings_of(setup)
    changes = remedies(findings)
    written: Written = "nothing written"
    wrong = ""
    if changes:
        mended = Setup(parameters={**setup.parameters, **changes}, recording=setup.recording)
        again = findings_of(mended)
        wrong = wrong_values(cell, setup, changes)
        written = "clean again"
        if again:
            written = "still a finding"
        elif wrong:
            written = "wrong, then all right"
    return Case(
        cell=cell,
        kind=kind,
        findings=findings,
        verdict=verdict_of(kind, findings),
        written=written,
        wrong_values=wrong,
    )


def kinds_of(k: int, count: int) -> list[str]:
    """The kinds of fault of the k-th cell: `count` of them, so that all kinds come round alike."""
    names = list(FAULTS)
    return [names[(k * count + i) % len(names)] for i in range(min(count, len(names)))]


def report(count: int, *, seed: int, faults: int, kinds: Sequence[str]) -> None:
    """Print what the doctor says of `count` random cells, each right and with some faults."""
    console = Console(width=170)
    cases: list[Case] = []
    skipped = 0
    for k in range(count):
        cell = random_cell(seed + SEED_STEP * k)
        for kind in kinds or [RIGHT, *kinds_of(k, faults)]:
            case = examined(cell, kind, by_bag=k % BAG_EVERY == 0)
            if case is None:
                skipped += 1
                continue
            cases.append(case)
            good = ("clean", "named alone")
            if (
                case.verdict in good
                and case.written in ("nothing written", "clean again")
                and not kinds
            ):
                continue
            console.print(
                f"[bold]{kind}[/bold] of {cell.title}: {case.verdict}; {case.written}",
                highlight=False,
            )
            if case.wrong_values:
                console.print(f"   wrong: {case.wrong_values}", markup=False)
            for finding in case.findings:
                console.print(f"   {finding.text}", markup=False, highlight=False)
            console.print(f"   {case.again}", markup=False, highlight=False)
    console.print(_summary(cases))
    console.print(_by_kind(cases))
    console.print(
        f"{skipped} faults left out: the cell cannot have them, or nobody could see them"
    )


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100.0 * part / max(whole, 1):.0f} %)"


def _summary(cases: Sequence[Case]) -> Table:
    table = Table("what", "cells", title="rft doctor on random cells")
    rights = [case for case in cases if case.kind == RIGHT]
    wrongs = [case for case in cases if case.kind != RIGHT]
    table.add_row(
        "right cells blamed", _share(sum(case.verdict != "clean" for case in rights), len(rights))
    )
    verdicts = Counter(case.verdict for case in wrongs)
    for verdict in ("named alone", "named with others", "only another", "silent"):
        table.add_row(f"faults: {verdict}", _share(verdicts[verdict], len(wrongs)))
    outcomes = Counter(case.written for case in cases if case.written != "nothing written")
    for outcome in ("clean again", "still a finding", "wrong, then all right"):
        table.add_row(f"files written: {outcome}", _share(outcomes[outcome], outcomes.total()))
    return table


def _by_kind(cases: Sequence[Case]) -> Table:
    columns = ("clean", "named alone", "named with others", "only another", "silent")
    table = Table("kind", *columns, "clean again", "still", "wrong")
    for kind in (RIGHT, *FAULTS):
        of_kind = [case for case in cases if case.kind == kind]
        if not of_kind:
            continue
        verdicts = Counter[str](case.verdict for case in of_kind)
        outcomes = Counter[str](case.written for case in of_kind)
        numbers = [verdicts[column] for column in columns]
        numbers += [
            outcomes[name] for name in ("clean again", "still a finding", "wrong, then all right")
        ]
        table.add_row(kind, *(str(number or "") for number in numbers))
    return table
