"""How few plates the paper's bodies need: errors at the 95th percentile over motions not used for the choice."""

import numpy as np
import pytest

from rft_ros.rft import MEDIA, Agarwal2023, alpha_y_model, treers2021, wrenches
from rft_ros.sweeps.motions import circumnutation, oscillating_insertion
from rft_ros.tool import load_tool, random_motions, reduced_for_any_motion

GENERIC = MEDIA["generic"]
CONSTANT, LINEAR = (
    treers2021(GENERIC, alpha_y_model(name, GENERIC), zeta=0.33) for name in ("constant", "linear")
)
BODIES = {"ellipsoid-exp": (9.6, 9.6, 18.05), "root-tip": (0.0, 0.0, 35.5)}
SCENES = {"ellipsoid-exp": oscillating_insertion(), "root-tip": circumnutation()}


@pytest.fixture
def body(shared_data):
    return lambda name, rule: load_tool(
        str(shared_data / "paper" / f"{name}.stl"), origin=BODIES[name], integration=rule
    )


def percentile_95(tool, plates, law, states):
    """The force's error, relative to each state's own force."""
    full, few = (wrenches(p, law, states)[:, :3] for p in (tool.facets, plates))
    off, size = np.linalg.norm(few - full, axis=1), np.linalg.norm(full, axis=1)
    return np.percentile(off[size > 0.0] / size[size > 0.0], 95.0)


@pytest.mark.parametrize(("rule", "most"), [("refined", 200), ("centroid", 560)])
def test_the_ellipsoid_in_any_motion_needs_few_plates_for_2_5_percent_of_its_own_force(
    body, rule, most
):
    """From a quarter submerged to deep."""
    tool = body("ellipsoid-exp", rule)
    plates, _ = reduced_for_any_motion(tool.facets, tool.corners, 0.025)
    assert len(plates) <= most
    others = (
        Agarwal2023(),
        Agarwal2023(density=1500.0),
        treers2021(GENERIC, LINEAR.alpha_y, density=1500.0),
    )
    for law in (CONSTANT, LINEAR, *others):  # plates are chosen with the first two
        assert (
            percentile_95(tool, plates, law, random_motions(tool.corners, 3000, seed=99)) < 0.028
        ), law
