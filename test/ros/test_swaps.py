"""Swaps under traffic: no tick is lost, none answered by a mixture of models, and a failed swap undoes itself."""

import itertools
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from harness import WAIT, numbers, parameters, predicted_by_the_core, stamp_of
from rcl_interfaces.srv import SetParameters

from rft_ros.parameters import Config
from rft_ros.rft import MEDIA, checked_states, wrenches
from rft_ros.tool import locate_mesh

MESHES, ZETAS, MODELS = ("plate", "sphere"), (1.0, 0.5, 0.25), ("constant", "linear")
MOTION = {"z": -0.03, "linear": (0.006, 0.004, -0.01)}


@pytest.mark.parametrize(
    ("start", "executor"), [("start_process", "events"), ("start_node", "single")]
)
def test_every_tick_is_answered_by_one_whole_model(request, start, executor):
    start = request.getfixturevalue(start)
    rft = start("-p", "mesh.file:=plate", "-p", f"executor:={executor}").wait_ready()
    client = rft.node.create_client(SetParameters, f"{rft.name}/set_parameters")
    assert client.wait_for_service(timeout_sec=WAIT)
    models = [*itertools.product(MESHES, ZETAS, MODELS)]
    expected = np.array(
        [predicted_by_the_core(mesh=m, zeta=z, alpha_y=a, **MOTION) for m, z, a in models]
    )
    changes = itertools.cycle(
        [*(("medium.zeta", z) for z in ZETAS), *(("alpha_y.model", a) for a in MODELS)]
    )
    predicted, pending, first, k = rft.received["wrench_predicted"], [], rft.moment(), 0

    def models_of(message):
        return [
            models[i]
            for i in np.flatnonzero(
                np.isclose(numbers(message), expected, 1e-12, 1e-15).all(axis=1)
            )
        ]

    def change(name, value):
        pending.append(
            client.call_async(SetParameters.Request(parameters=parameters({name: value})))
        )

    for mesh in ("plate", "sphere", "plate"):
        change("mesh.file", mesh)
        end, left = time.monotonic() + WAIT, 100  # ticks after its first answer
        while left > 0:
            assert time.monotonic() < end, f"{mesh} never answered"
            rft.send(first + k * 5_000_000, **MOTION)
            k += 1
            if k % 20 == 0:
                change(*next(changes))
            rft.spin(0.01)
            rft.until(lambda k=k: len(predicted) >= k - 50)  # so that no queue overflows
            left -= any(m == mesh for message in predicted[-1:] for m, *_ in models_of(message))
    rft.until(lambda: len(predicted) == k)
    assert [stamp_of(m) for m in predicted] == [first + i * 5_000_000 for i in range(k)]
    rft.until(lambda: all(f.done() for f in pending))
    assert all(f.result().results[0].successful for f in pending)
    answers = [models_of(message) for message in predicted]
    assert {len(fitting) for fitting in answers} == {1}, "an answer that no single model gives"
    used = {model for (model,) in answers}
    assert len(used) >= 6
    assert {mesh for mesh, *_ in used} == set(MESHES)


TRIANGLE = (
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
)


def test_zeta_set_together_with_the_mesh_in_force_holds_although_another_mesh_was_on_its_way(
    rft, tmp_path
):
    big = tmp_path / "big.stl"
    big.write_text("solid big\n" + TRIANGLE * 100_000 + "endsolid big\n")
    assert rft.set(mesh__file=str(big)) == (True, "")
    assert rft.set(mesh__file="plate", medium__zeta=0.33) == (True, "")
    assert rft.get("medium.zeta").double_value == 0.33
    np.testing.assert_allclose(
        numbers(rft.ask(rft.moment())), predicted_by_the_core(zeta=0.33), rtol=1e-15
    )
    assert "preparing" not in rft.trigger("status")[1]
    assert rft.set(medium__zeta=1.0)[0]


def test_a_mesh_that_is_turned_or_filled_while_the_node_runs_is_the_turned_or_the_filled_tool(
    start_node,
):
    rft = start_node("-p", "mesh.file:=root_tip").wait_ready()
    assert rft.set(mesh__hull=True, mesh__file="scoop") == (True, "")
    filled = predicted_by_the_core(mesh="scoop", hull=True, z=-0.01)
    rft.until(
        lambda: np.allclose(
            numbers(rft.ask(rft.moment(), z=-0.01)), filled, rtol=1e-12, atol=1e-15
        )
    )
    assert rft.set(mesh__hull=False, mesh__file="root_tip") == (True, "")
    assert rft.set(mesh__quaternion=[1.0, 0.0, 0.0, 0.0]) == (True, "")
    turned = predicted_by_the_core(mesh="root_tip", quaternion=(1.0, 0.0, 0.0, 0.0), z=-0.01)
    rft.until(
        lambda: np.allclose(
            numbers(rft.ask(rft.moment(), z=-0.01)), turned, rtol=1e-12, atol=1e-15
        )
    )
    success, why = rft.set(mesh__quaternion=[0.0, 0.0, 0.0, 3.0])
    assert not success
    assert "mesh.quaternion has norm 3; it must be 1" in why


def test_a_swap_that_fails_is_undone_even_if_the_file_in_force_is_gone(start_node, tmp_path):
    gone, bad = tmp_path / "gone.stl", tmp_path / "bad.stl"
    gone.write_bytes(locate_mesh("plate").read_bytes())
    bad.write_text("solid nothing\nendsolid nothing\n")
    rft = start_node("-p", f"mesh.file:={gone}").wait_ready()
    gone.unlink()
    assert rft.set(mesh__file=str(bad), mesh__scale=0.0005) == (True, "")
    for said in (
        f"parameters set: mesh.file '{gone}' -> '{bad}', mesh.scale 0.0 -> 0.0005",
        "not swapped, the model in force stays: ",
        f"parameters set: mesh.file '{bad}' -> '{gone}', mesh.scale 0.0005 -> 0.0 (the swap failed)",
    ):
        rft.until(lambda said=said: said in rft.said())
    assert rft.get("mesh.file").string_value == str(gone)
    assert rft.set(medium__zeta=0.5) == (True, "")
    np.testing.assert_allclose(
        numbers(rft.ask(rft.moment())), predicted_by_the_core(zeta=0.5), rtol=1e-15
    )


def test_a_node_goes_on_where_a_failed_swap_cannot_be_undone(start_node, tmp_path):
    bad = tmp_path / "bad.stl"
    bad.write_text("solid nothing\nendsolid nothing\n")
    rft = start_node("-p", "mesh.file:=plate").wait_ready()
    rft.refuse(lambda p: p.name == "mesh.file" and p.value == "plate", why="the plate is locked")
    assert rft.set(mesh__file=str(bad)) == (True, "")
    rft.until(lambda: "could not be set back: the plate is locked" in rft.said())
    assert rft.set(medium__zeta=0.5) == (True, "")
    np.testing.assert_allclose(
        numbers(rft.ask(rft.moment())), predicted_by_the_core(zeta=0.5), rtol=1e-15
    )


def test_an_alpha_y_table_that_was_deleted_stays_in_force_until_another_is(start_node, tmp_path):
    table, other = tmp_path / "alpha_y.csv", tmp_path / "other.csv"
    for file, stress in ((table, 0.2), (other, 0.1)):
        file.write_text(f"beta,alpha_y\n0,{stress}\n180,0.0\n")
    rft = start_node(
        "-p", "mesh.file:=plate", "-p", "alpha_y.model:=table", "-p", f"alpha_y.table:={table}"
    ).wait_ready()
    before = numbers(rft.ask(rft.moment(), **MOTION))
    table.unlink()
    assert not rft.set(alpha_y__table=str(other), mesh__scale=0.002, mesh__file="/none/there.stl")[
        0
    ]
    for mesh in ("sphere", "plate"):
        assert rft.set(mesh__file=mesh) == (True, "")
        rft.until(lambda mesh=mesh: rft.diagnostic("model")[2]["tool"] == mesh)
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment(), **MOTION)), before)
    assert rft.set(alpha_y__table=str(other)) == (True, "")
    rft.until(lambda: not np.array_equal(numbers(rft.ask(rft.moment(), **MOTION)), before))


def test_a_medium_of_ones_own_comes_into_force_live_and_a_bad_file_is_undone(start_node, tmp_path):
    mine, bad = tmp_path / "mine.yaml", tmp_path / "bad.csv"
    mine.write_text(
        yaml.safe_dump(
            {name: 0.5 * value for name, value in MEDIA["generic"].coefficients.items()}
        )
    )
    bad.write_text("beta_deg,gamma_deg,alpha_x,alpha_z\n0,90,0,200000\n")
    rft = start_node("-p", "mesh.file:=plate").wait_ready()
    whole = numbers(rft.ask(rft.moment(), **MOTION))
    assert rft.set(medium__file=str(mine)) == (True, "")
    rft.until(
        lambda: np.allclose(numbers(rft.ask(rft.moment(), **MOTION)), 0.5 * whole, rtol=1e-12)
    )
    mine.unlink()
    assert rft.set(medium__file=str(bad)) == (True, "")
    rft.until(lambda: rft.get("medium.file").string_value == str(mine))
    assert f"the model in force stays: stress map '{bad}'" in rft.said()
    assert "N/cm³" in rft.said()
    assert rft.set(medium__zeta=2.0) == (True, "")
    np.testing.assert_allclose(numbers(rft.ask(rft.moment(), **MOTION)), whole, rtol=1e-12)
    assert rft.diagnostic("model")[2]["medium"] == "mine"


FILES = {
    "medium.file": "medium.yaml",
    "alpha_y.table": "alpha_y.csv",
    "mesh.file": "tool.stl",
    "ground.file": "map.csv",
}


def test_no_file_that_a_parameter_names_delays_a_pose_while_its_drive_stalls(
    start_process, tmp_path
):
    """The worker process stands still, as at a drive that does not answer."""
    write_files(tmp_path)
    rft = start_process("-p", "mesh.file:=sphere", "-p", "ground.cell:=0.01").wait_ready()
    before = numbers(rft.ask(rft.moment(), **MOTION))
    (worker,) = children(rft.process.pid)
    os.kill(worker, signal.SIGSTOP)
    named = {name.replace(".", "__"): str(tmp_path / file) for name, file in FILES.items()}
    assert rft.set(alpha_y__model="table", **named) == (True, "")
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment(), **MOTION)), before)
    os.kill(worker, signal.SIGCONT)
    rft.until(lambda: "preparing" not in rft.trigger("status")[1])
    values = {
        **Config().values,
        "medium.mobilization_length": 0.0,
        "ground.cell": 0.01,
        "alpha_y.model": "table",
    }
    model = Config.of(
        {**values, **{name: str(tmp_path / file) for name, file in FILES.items()}}
    ).model()
    state = checked_states(
        [0.0, 0.0, MOTION["z"], 0.0, 0.0, 0.0, 1.0, *MOTION["linear"], 0.0, 0.0, 0.0]
    )
    expected = wrenches(model.tool.plates, model.law, state, surface_height=0.002)[0]
    # heights are float32
    np.testing.assert_allclose(numbers(rft.ask(rft.moment(), **MOTION)), expected[:6], rtol=1e-7)


def write_files(folder):
    """A file for each parameter of `FILES`; the ground is level at 2 mm."""
    coefficients = {name: 0.5 * value for name, value in MEDIA["generic"].coefficients.items()}
    (folder / FILES["medium.file"]).write_text(yaml.safe_dump(coefficients))
    (folder / FILES["alpha_y.table"]).write_text("beta,alpha_y\n0,0.2\n180,0.0\n")
    (folder / FILES["mesh.file"]).write_bytes(locate_mesh("plate").read_bytes())
    heights = [f"{x:g},{y:g},0.002" for x in CENTRES for y in CENTRES]
    (folder / FILES["ground.file"]).write_text("\n".join(["x,y,h", *heights, ""]))


CENTRES = 0.01 * (np.arange(-10, 10) + 0.5)


def children(process):
    """The ids of a process's child processes."""
    return [
        int(text) for text in Path(f"/proc/{process}/task/{process}/children").read_text().split()
    ]


def test_a_pipe_in_place_of_a_file_is_refused_before_it_is_opened(rft, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    needs = {"alpha_y.table": {"alpha_y__model": "table"}, "ground.file": {"ground__cell": 0.01}}
    for parameter in FILES:
        success, why = rft.set(
            **{parameter.replace(".", "__"): str(pipe)}, **needs.get(parameter, {})
        )
        assert not success
        assert f"{parameter} '{pipe}' is a pipe" in why
