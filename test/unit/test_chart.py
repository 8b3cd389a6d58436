"""The charts: scenes, points, the Pareto front, and the files written."""

import csv

import numpy as np
import pytest
import trimesh

from studies import chart, models
from studies.__main__ import main
from studies.chart import CHOSEN, FULL, MERGED, NUMPY, Point, front, points
from studies.chart_scenes import Scene, scenes
from studies.dem import CYCLE_RUNS, FAST_RUNS, RUNS
from studies.models import CHOICES, GROUPS

SCENES = {scene.name: scene for scene in scenes()}


@pytest.mark.parametrize("name", SCENES)
def test_a_scenes_body_is_closed_faces_outwards_and_gets_finer(name):
    counts = []
    for level in range(3):
        vertices, faces = SCENES[name].mesh(level)
        mesh = trimesh.Trimesh(vertices, faces)
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.volume > 0.0
        assert (mesh.area_faces > 0.0).all()
        counts.append(len(faces))
    assert counts == sorted(set(counts))


def point(time, error, plates=1):
    return Point(
        scene="s", integration="refined", alpha_y="constant", reduction=FULL, plates=plates, time=time, error=error
    )


def test_nothing_beats_the_front_in_both_time_and_error_by_more_than_noise():
    candidates = [point(1.0, 0.5), point(2.0, 0.1), point(2.5, 0.3), point(3.0, 0.099), point(4.0, 0.05)]
    assert [p.time for p in front(candidates)] == [1.0, 2.0, 4.0]


SPHERE = SCENES["deep sphere"]
SMALL = Scene(name="ball", mesh=SPHERE.mesh, levels=3, reference=4, delivered=1, states=SPHERE.states)


@pytest.fixture(scope="module")
def found():
    """The points of the small scene, each timed three times; few are chosen."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chart, "_ROUNDS", 3)
        patch.setattr(chart, "_CHOSEN", (5, 10, 20))
        return points(SMALL)


def test_finer_meshes_take_longer_and_approach_the_converged_force(found):
    assert {p.reduction for p in found} == {FULL, MERGED, CHOSEN, NUMPY}
    finest = {}
    for rule in ("centroid", "refined"):
        full = [p for p in found if (p.integration, p.reduction, p.alpha_y) == (rule, FULL, "constant")]
        assert [p.plates for p in full] == [80, 320, 1280]
        assert [p.error for p in full] == sorted((p.error for p in full), reverse=True)
        finest[rule] = full[-1].error
    assert finest["refined"] < finest["centroid"]
    by_numpy, compiled = (
        [p for p in found if p.reduction == how and p.integration == "centroid"] for how in (NUMPY, FULL)
    )
    for one, other in zip(by_numpy, compiled[::2], strict=True):
        assert one.error == pytest.approx(other.error, rel=0.2)  # over fewer states


def test_the_chart_of_models_separates_the_choices(tmp_path, monkeypatch):
    monkeypatch.setattr(models, "median_seconds", lambda calls: [1e-3] * len(calls))  # tested above
    # all choices over all recordings take 250 s of CPU; test/golden/test_learning_runs.py has their errors
    monkeypatch.setattr(models, "_RECORDED", ("cmu",))
    monkeypatch.setattr(models, "_NAMES", {name: models._NAMES[name] for name in ("published", "default, learned")})
    assert main(["models", "-o", str(tmp_path)]) == 0
    with (tmp_path / "models.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(CHOICES) * len((*RUNS, *FAST_RUNS, *CYCLE_RUNS))
    mean = {
        (c.name, group): np.mean([float(r["median_error"]) for r in rows if r["choice"] == c.name and member(r["run"])])
        for c in CHOICES
        for group, member in GROUPS.items()
    }
    along, ellipsoid = "plate in its own plane", "ellipsoid (straight, pitching)"
    assert mean["refined", along] < 0.8 * mean["published", along]
    assert mean["refined, memory 3 mm", ellipsoid] < 0.75 * mean["refined", ellipsoid]
