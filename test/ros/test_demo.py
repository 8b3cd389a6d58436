"""The demo's claims: in its virtual grains the fixed model is off, the node learns the force and reports the layer."""

import numpy as np
import pytest

from rft_ros.demo import virtual_arm
from rft_ros.demo.virtual_arm import LAYER_DEPTH_M
from rft_ros.estimator import Estimator, PoseSample, QualityFlag, TwistSample, WrenchSample
from rft_ros.installation import share_directory
from rft_ros.parameters import Config, read_parameter_file
from rft_ros.rft import QUATERNION, VELOCITY


def descent(mode):
    """Depth [m], measured and predicted force, its deviation [N] and the surprise flag at each moment in the grains."""
    values = read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml").values
    values |= {"learning.mode": mode, "sensor.bias": virtual_arm.LOAD_CELL.bias}
    config = Config.of(values)
    estimator = Estimator(config, config.model())
    rows = {}
    for t, state, reading in virtual_arm.moments(12.0):
        if t < virtual_arm.PAUSE_S:
            continue
        stamp, numbers = round((t + 1.0) * 1e9), state.tolist()
        estimator.push(WrenchSample(stamp, "ft_sensor", reading))
        estimator.push(TwistSample(stamp, "world", tuple(numbers[VELOCITY]), tuple(numbers[10:])))
        answer = estimator.push_pose(
            PoseSample(stamp, "world", tuple(numbers[:3]), tuple(numbers[QUATERNION]))
        )
        surprised = bool(answer.quality_flags & QualityFlag.SURPRISE)
        rows[stamp] = [estimator.depth(), *answer.predicted[:3], *answer.sigma[:3], surprised]
    estimator.finish()
    for m in estimator.measurements():
        rows[m.stamp] += m.compensated[:3]
    found = np.array([row for row in rows.values() if len(row) == 11 and row[0] > 0.0])
    return found[:, 0], found[:, 8:], found[:, 1:4], found[:, 4:7], found[:, 7] > 0.0


@pytest.fixture(scope="module")
def descents():
    return {mode: descent(mode) for mode in ("off", "apply")}


def test_from_10_mm_to_the_layer_the_fixed_model_is_off_and_the_learned_one_is_right(descents):
    error = {}
    for mode, (depth, measured, predicted, *_) in descents.items():
        used = (depth > 0.010) & (depth < LAYER_DEPTH_M)
        off = np.linalg.norm(predicted[used] - measured[used], axis=1) / np.linalg.norm(
            measured[used], axis=1
        )
        error[mode] = np.median(off)
    assert error["off"] > 0.2
    assert error["apply"] < 0.05


def test_the_band_holds_most_of_the_measured_forces(descents):
    depth, measured, predicted, sigma, _ = descents["apply"]
    inside = np.abs(measured - predicted)[depth > 0.01] < 2.0 * sigma[depth > 0.01]
    assert inside.mean() > 0.9


def test_only_the_hard_layer_is_a_surprise_and_at_once(descents):
    depth, *_, surprised = descents["apply"]
    assert not surprised[depth < LAYER_DEPTH_M].any()
    assert surprised[(depth > LAYER_DEPTH_M) & (depth < LAYER_DEPTH_M + 0.003)].any()
