"""The paper's numbers, orders and monotonic statements, as its studies compute them here, and the docs' tables."""

from pathlib import Path

import numpy as np
import published_rule
import pytest

from rft_ros.sweeps import motions
from studies import circumnutation, convergence, horizontal, oscillation, plates
from studies.__main__ import run_study
from studies.paper import ALPHA_Y, ellipsoid, leading_face, plate, root_tip
from studies.result import table_in
from studies.sampling import work_of

TABLES = {
    "dem": "accuracy.md",
    "horizontal": "paper.md",
    "oscillation": "paper.md",
    "circumnutation": "paper.md",
}


@pytest.mark.parametrize(("name", "page"), TABLES.items())
def test_the_table_in_the_docs_is_the_studys(name, page):
    (result,) = run_study(name)
    text = (Path(__file__).resolve().parents[2] / "docs" / page).read_text(encoding="utf-8")
    assert table_in(text, name) == result.table.markdown()


@pytest.fixture(scope="module")
def strokes():
    """Of the ellipsoid, by the frequency of its pitch; 0 is straight."""
    tool = ellipsoid()
    pitching = {
        f: oscillation.stroke(tool, amplitude_deg=9.0, frequency=f)
        for f in oscillation.FREQUENCIES.values()
    }
    return {0.0: oscillation.stroke(tool, amplitude_deg=0.0), **pitching}


@pytest.fixture(scope="module")
def spheres():
    return convergence.convergence(levels=range(5), reference=6)


class TestHorizontal:
    def test_the_published_fit_reaches_the_published_maximum_forces(self):
        """0.83 N of F1, of which 0.9 N was measured, and 5.8 N of F23: the normalisers N1 and N23."""
        f1, f23 = horizontal.fitted_forces(np.array([0.0, 90.0]))
        assert f1 == pytest.approx([0.0, 0.832324700111401], abs=1e-12)
        assert f23 == pytest.approx([5.81083560370960, 0.0], abs=1e-12)
        assert f1[1] == pytest.approx(horizontal.PUBLISHED["F1"], abs=0.1)
        assert f23[0] == pytest.approx(horizontal.PUBLISHED["F23"], abs=0.05)

    @pytest.mark.parametrize("alpha_y", ALPHA_Y)
    def test_our_forces_over_their_maximum_are_the_velocity_weights(self, alpha_y):
        f1, f23, _ = horizontal.drag_forces(leading_face(plate()), alpha_y)
        psi = np.deg2rad(horizontal.PSI)
        assert f1 / f1.max() == pytest.approx(
            [published_rule.f1(u) for u in np.sin(psi)], abs=1e-6
        )
        assert f23[:-1] / f23.max() == pytest.approx(
            [published_rule.f23(w) for w in np.cos(psi[:-1])], abs=1e-6
        )

    def test_the_edges_carry_the_force_that_the_paper_subtracts(self):
        own, whole = (
            horizontal.drag_forces(p, "constant")[0].max()
            for p in (leading_face(plate()), plate().plates)
        )
        assert whole - own == pytest.approx(
            horizontal.PUBLISHED["F1 raw"] - horizontal.PUBLISHED["F1"], abs=0.15
        )


class TestPlates:
    def test_the_intrusion_angle_is_the_papers(self):
        for phi in plates.PHIS:
            assert plates.gamma_deg(phi, 0.0) == pytest.approx(phi)
            assert np.tan(np.deg2rad(plates.gamma_deg(phi, 60.0))) == pytest.approx(
                2.0 * np.tan(np.deg2rad(phi))
            )

    @pytest.mark.parametrize("beta", plates.BETAS)
    @pytest.mark.parametrize("phi", plates.PHIS)
    def test_turning_a_plate_along_its_motion_moves_force_from_e2_to_e1(self, beta, phi):
        stress = plates.stresses(leading_face(plate()), beta, phi, "constant")
        assert (np.diff(stress[:, 0]) > 0.0).all()
        assert (np.diff(stress[:, 1]) < 0.0).all()

    def test_simulated_plates_agree_with_the_model_except_the_one_that_moves_along_itself(self):
        points = {p.run: p for p in plates.simulated_points()}
        assert len(points) == 6
        along = points.pop("plate_b90_psi90_phi0")
        assert along.measured[0] > 3.0 * along.model[0]
        for p in points.values():
            measured, model = np.array(p.measured), np.array(p.model)
            assert np.linalg.norm(model - measured) < 0.25 * np.linalg.norm(measured)


class TestOscillation:
    def test_the_released_codes_pitch_gives_the_papers_frequency_in_the_vertical_force(
        self, strokes
    ):
        assert oscillation.vertical_frequency(strokes[0.625]) == pytest.approx(1.25, abs=0.02)
        assert oscillation.vertical_frequency(strokes[1.25]) == pytest.approx(2.5, abs=0.02)

    def test_pitching_lowers_the_vertical_work_and_raises_the_total(self, strokes):
        vertical, total = (
            [one.work.vertical for one in strokes.values()],
            [one.work.total for one in strokes.values()],
        )
        assert (np.diff(vertical) < 0.0).all()
        assert (np.diff(total) > 0.0).all()
        assert vertical[0] == pytest.approx(total[0])

    def test_at_the_turning_points_of_the_pitch_the_vertical_force_is_that_of_the_straight_insertion(
        self, strokes
    ):
        """Once the body is half submerged: lower between the turning points, up to 2.7 % higher at them."""
        for frequency in (0.625, 1.25):
            deep = strokes[0.0].depths > 0.018
            share = strokes[frequency].forces[deep, 2] / strokes[0.0].forces[deep, 2]
            assert share.min() < 0.7
            assert 1.0 < share.max() < 1.03


class TestCircumnutation:
    @pytest.mark.parametrize("tilt", circumnutation.TILTS)
    def test_turning_more_for_each_depth_lowers_the_vertical_work_and_raises_the_total(self, tilt):
        """Beyond 100 mm the total falls to within 0.5 % of the straight insertion."""
        tool = root_tip()
        pitches = circumnutation.PITCHES
        works = [
            work_of(tool.plates, motions.circumnutation(tilt_deg=tilt, pitch=p), 401)
            for p in pitches
        ]
        straight = work_of(
            tool.plates, circumnutation.straight_limit(motions.circumnutation(tilt_deg=tilt)), 401
        )
        assert (np.diff([w.vertical for w in (*works, straight)]) > 0.0).all()
        total = np.array([w.total for w in works])
        assert (np.diff(total[pitches <= 0.1]) < 0.0).all()
        assert (total[pitches < 0.1] > straight.total).all()
        assert (total > 0.995 * straight.total).all()
        assert straight.vertical == pytest.approx(straight.total)

    def test_a_long_pitch_is_the_straight_limit(self):
        motion = motions.circumnutation(pitch=100.0)
        straight = circumnutation.straight_limit(motion)
        turning, straight = (work_of(root_tip().plates, m, 401) for m in (motion, straight))
        assert turning.vertical == pytest.approx(straight.vertical, rel=1e-3)

    @pytest.mark.parametrize("rule", ["centroid", "refined"])
    def test_work_converges_with_the_square_of_the_time_step(self, rule):
        found = circumnutation.step_errors(rule)
        assert found.order == pytest.approx(2.0, abs=0.1)
        assert found.errors[-1] < 1e-6


class TestConvergence:
    def test_both_rules_converge_with_the_square_of_the_facets_size(self, spheres):
        for one in spheres.values():
            assert (np.diff(one.errors) < 0.0).all()
            assert convergence.order(one) == pytest.approx(2.0, abs=0.35)

    def test_the_refined_rule_needs_a_quarter_of_the_facets(self, spheres):
        assert (spheres["refined"].errors[:-1] < spheres["centroid"].errors[1:]).all()
        assert spheres["refined"].errors[2] < 0.01 < spheres["centroid"].errors[2]
