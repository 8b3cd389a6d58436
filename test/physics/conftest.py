"""A body and states with no symmetry, for laws that hold for any body."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scenes import random_plates, random_scene

from rft_ros.rft import Plates


@pytest.fixture(scope="session")
def random_body() -> Plates:
    """250 plates of every attitude within 4 cm of the tool frame's origin."""
    return random_plates(np.random.default_rng(1), 250)


@pytest.fixture(scope="session")
def random_states() -> NDArray[np.float64]:
    """40 states around the surface, tumbling."""
    return random_scene(np.random.default_rng(2), 40)
