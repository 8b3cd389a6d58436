"""Which parts of a trial a listening doctor has seen: the tool in the air, pressed down, and dragged along x and y."""

from rft_ros.doctor.checkup import Cell
from rft_ros.estimator import Estimate, Estimator, PoseSample, Sample
from rft_ros.rft.frames import Placement
from rft_ros.rft.motion_kinds import kind_between

_RATE_HZ = 10.0  # of the poses that are looked at, so that listening takes little CPU time
_STEP_M = 0.001  # over which a kind of motion is judged: noise of poses is far smaller
_MIN_PATH_M = 0.01  # of each motion in the grains: after it the force follows the new direction
_MIN_AIR_S = 1.0
_MIN_GRAINS_S = 4.0  # several starts and stops, which show a delay of the load cell
_LONGEST_STEP_S = 0.5  # between two poses; over a longer gap the tool may have been anywhere
_MAX_WAIT_S = 5.0  # without poses or readings that can be used there is nothing to wait for

_AIR = "air"
_GRAINS = "more time in the grains"
_PRESS = "press"
_DRAGS = {"x": "drag along x", "y": "drag along y"}


class SeenMotion:
    """Follows the samples of a cell as they arrive."""

    def __init__(self, cell: Cell) -> None:
        config = cell.config.changed({"learning.mode": "off", "max_rate": _RATE_HZ})
        self._estimator = Estimator(config, cell.model)
        self._middle = Placement(cell.model.tool.middle)
        self._radius = 0.5 * cell.model.tool.size
        self._air_s = 0.0
        self._grains_s = 0.0
        self._last_stamp = 0  # of the last pose [ns]
        self._paths = dict.fromkeys((_PRESS, *_DRAGS.values()), 0.0)
        # of the tool's middle where the path was measured last; None in the air
        self._place: Placement | None = None

    def add(self, sample: Sample) -> None:
        """Add the next sample that arrived."""
        for pose, answer in self._estimator.answers(sample):
            if isinstance(answer, Estimate):
                self._follow(pose, in_air=answer.submerged_area == 0.0)

    def _follow(self, pose: PoseSample, *, in_air: bool) -> None:
        seconds = 1e-9 * (pose.stamp - self._last_stamp)
        self._last_stamp = pose.stamp
        if not 0.0 < seconds < _LONGEST_STEP_S:
            seconds = 0.0
        if in_air:
            self._air_s += seconds
            self._place = None
            return
        self._grains_s += seconds
        place = pose.place.of(self._middle)
        if self._place is None:
            self._place = place
            return
        path, _ = place.apart(self._place)
        if path < _STEP_M:
            return
        kind = kind_between(self._place, place, radius=self._radius)
        if kind == "drag":
            x, y = (abs(place.position[k] - self._place.position[k]) for k in (0, 1))
            kind = _DRAGS["x" if x >= y else "y"]
        self._place = place
        if kind in self._paths:
            self._paths[kind] += path

    @property
    def missing(self) -> list[str]:
        """The parts of a trial that were not seen yet."""
        missing = [] if self._air_s >= _MIN_AIR_S else [_AIR]
        missing += [kind for kind, path in self._paths.items() if path < _MIN_PATH_M]
        return missing if self._grains_s >= _MIN_GRAINS_S else [*missing, _GRAINS]

    def is_enough(self, seconds: float) -> bool:
        """Whether to stop after listening for `seconds` [s]: all was seen, or nothing that can be used comes."""
        is_blind = not (self._estimator.estimates and self._estimator.last_reading)
        return not self.missing or (is_blind and seconds >= _MAX_WAIT_S)
