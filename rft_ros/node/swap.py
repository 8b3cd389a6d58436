"""Loads files in the background, and prepares models for changed parameters.

The node keeps answering with the old model meanwhile.
"""

import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import PARTS, needed, prepare, prepare_later
from rft_ros.files import checked_file
from rft_ros.messages import decoder
from rft_ros.node.tool_worker import ToolWorker, files_in, named
from rft_ros.parameters import Config, MeshConfig, Model, Part, Values, parameter_values
from rft_ros.tool import checked_mesh, locate_mesh

_ANSWERS_WITHIN = 0.05
"""s; a tick waits so long for a drive that does not say whether a file exists."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """Everything that is made from a `config`. It is made once, when the parameters are validated.

    The estimator can use `config` and `model` at once. `model` uses only files already loaded: those of the parameters
    `in_force`. `loaded` has what was made of them, by part.
    """

    config: Config
    model: Model
    in_force: Config
    loaded: dict[str, Any]

    @property
    def missing(self) -> dict[str, Part]:
        """The parts of the config that are not loaded yet."""
        return _parts_besides(self.in_force, self.config)


class Failed(NamedTuple):
    """A load that has failed for a `reason`. `undo`: the parameters to set back to their old values."""

    undo: Values
    reason: str


class _Load(NamedTuple):
    """A part that is being loaded in the background. `since`: start, a time of `time.monotonic` [s]."""

    wanted: Part
    loaded: "Future[dict[str, Any]]"
    since: float


class Swap:
    """Loads the parts of a model (`Config.parts`).

    The constructor loads what `config` needs, or raises InputError. Each part is loaded on its own, so that a change of
    other parameters does not disturb it. A thread waits for the worker and reads its answer: in the node's own thread
    100,000 plates would delay a tick by 30 ms; in this one 50,000 plates delay it by 3 to 15 ms.
    """

    def __init__(
        self, worker: ToolWorker, config: Config, *, on_cold_cache: Callable[[], None]
    ) -> None:
        self._worker = worker
        self._file_thread = ThreadPoolExecutor(1)
        self._check_thread = ThreadPoolExecutor(1)
        self._code = needed(config)
        prepare(self._code, on_cold_cache)
        self._code_thread = prepare_later(PARTS - self._code)
        # after the code is in the cache; otherwise the worker compiles it, too
        loaded = worker.load(config.parts())
        self.last_failure = ""
        """Why the last swap failed; empty once one has succeeded."""
        self._loads: dict[str, _Load] = {}  # by part
        self.prepared = _made(config, config, loaded, generation=0)
        """The parameters and the model that are used now."""

    def prepare(self, config: Config) -> Prepared:
        """Prepare a change to these parameters, without reading files. Raises InputError for unusable values."""
        self._check_code(needed(config))
        before = self.prepared
        generation = before.model.generation + 1
        made = _made(config, before.in_force, before.loaded, generation=generation)
        # on a busy machine a thread starts 20 ms late, and a change of the medium needs none
        known = before.missing
        new = {name: part for name, part in made.missing.items() if part != known.get(name)}
        if new:
            check = self._check_thread.submit(_check_files, new)
            # without an answer the drive stalls, and the worker finds what is wrong
            if wait([check], _ANSWERS_WITHIN).done:
                check.result()
        return made

    def _check_code(self, parts: frozenset[str]) -> None:
        """Raise InputError if machine code for these parts still compiles, as in the seconds after a first start."""
        missing = parts - self._code
        if missing and self._code_thread is not None and self._code_thread.is_alive():
            raise InputError(
                f"{' and '.join(sorted(missing))} still compiles; try again in ten seconds"
            )

    @property
    def preparing(self) -> str:
        """A description of what is being loaded, and for how long; empty if nothing is."""
        now = time.monotonic()
        loads = [
            f"{named({part: load.wanted})} for {now - load.since:.0f} s"
            for part, load in self._loads.items()
        ]
        return " and ".join(loads)

    def want(self, prepared: Prepared) -> None:
        """Use what was prepared, and start to load what is missing for it. A load of the same files goes on."""
        self.prepared = prepared
        missing = prepared.missing
        for part in [*self._loads]:
            if self._loads[part].wanted != missing.get(part):
                # one that has begun sees that it is no longer wanted
                self._loads.pop(part).loaded.cancel()
        for part, wanted in missing.items():
            if part not in self._loads:
                loaded = self._file_thread.submit(self._load, part, wanted)
                self._loads[part] = _Load(wanted, loaded, since=time.monotonic())

    def _load(self, part: str, wanted: Part) -> dict[str, Any]:
        if part == "ground":
            # takes 0.3 s the first time; in this thread no tick waits for it
            decoder("surface", ros1=False)
        return self._worker.load({part: wanted}, lambda: self.prepared.missing.get(part) == wanted)

    def poll(self) -> Prepared | Failed | None:
        """Takes a load that has ended: returns the new `prepared`, or why it failed; None while all still run."""
        ended = [part for part, load in self._loads.items() if load.loaded.done()]
        if not ended:
            return None
        part = ended[0]
        load = self._loads.pop(part)
        before = self.prepared
        try:
            loaded = load.loaded.result()
        except InputError as error:
            self.last_failure = str(error)
            return Failed(undo=_in_force(before.in_force, load.wanted), reason=self.last_failure)
        self.last_failure = ""
        self.prepared = _made(
            before.config,
            before.in_force.changed(parameter_values(load.wanted)),
            before.loaded | loaded,
            generation=before.model.generation + 1,
        )
        return self.prepared


def _made(
    config: Config, in_force: Config, loaded: Mapping[str, Any], *, generation: int
) -> Prepared:
    """What is made from a config; each part that has to be loaded stays as it is in force."""
    kept: dict[str, Any] = {}
    for part in _parts_besides(in_force, config).values():
        kept |= _in_force(in_force, part)
    now = config.changed(kept)
    used = {name: loaded[name] for name in now.parts()}
    return Prepared(
        config=config, model=now.model(used, generation=generation), in_force=now, loaded=used
    )


def _parts_besides(before: Config, config: Config) -> dict[str, Part]:
    """The parts of a config that another one does not have."""
    known = before.parts()
    return {name: part for name, part in config.parts().items() if part != known.get(name)}


def _in_force(config: Config, part: Part) -> Values:
    """The values in a config of the parameters of a part, by name."""
    values = config.values
    return {name: values[name] for name in parameter_values(part)}


def _check_files(parts: Mapping[str, Part]) -> None:
    """Raise InputError for a file of these parts that does not exist or cannot be read. Does not open it."""
    for part in parts.values():
        if isinstance(part, MeshConfig):
            checked_mesh(locate_mesh(part.file), "mesh.file")
            continue
        for name, file in files_in(part).items():
            checked_file(Path(file), name)
