"""The node as a user meets it: parameters, topics and services over DDS."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import OUTPUTS, numbers, predicted_by_the_core, stamp_of
from recordings import cdr

from rft_ros.errors import InputError
from rft_ros.tool import load_tool, locate_mesh

S = 1_000_000_000


def test_a_pose_is_answered_by_three_wrenches_with_its_stamp_in_the_sensor_frame(rft):
    stamp = rft.moment()
    predicted = rft.ask(stamp, force=(0.0, 0.0, 3.0))
    rft.until(lambda: all(any(stamp_of(m) == stamp for m in rft.received[t]) for t in OUTPUTS))
    assert predicted.header.frame_id == "ft_sensor"
    np.testing.assert_array_equal(numbers(predicted), predicted_by_the_core())
    compensated, residual = (
        next(m for m in rft.received[t] if stamp_of(m) == stamp)
        for t in ("wrench_compensated", "wrench_residual")
    )
    np.testing.assert_array_equal(numbers(compensated)[:3], [0.0, 0.0, 3.0])
    np.testing.assert_array_equal(numbers(residual), numbers(compensated) - numbers(predicted))
    waits = rft.ask(stamp + S // 20, force=None)
    for frame in (
        "wrist",
        "ft_sensor",
    ):  # ends the comparison, which keeps the frame of its prediction
        assert rft.set(sensor_frame=frame)[0]
    rft.until(lambda: any(m.header == waits.header for m in rft.received["wrench_residual"]))


def test_the_page_of_the_node_names_each_of_its_topics_and_services(rft):
    page = (Path(__file__).parents[2] / "docs" / "topics.md").read_text(encoding="utf-8")
    namespace, _, name = rft.name.rpartition("/")
    node, of = rft.node, (name, namespace or "/")
    found = node.get_publisher_names_and_types_by_node(
        *of
    ) + node.get_subscriber_names_and_types_by_node(*of)
    found += [
        service
        for service in node.get_service_names_and_types_by_node(*of)
        if "Trigger" in service[1][0]
    ]
    own = {
        topic.removeprefix(f"{rft.name}/")
        for topic, _ in found
        if topic.startswith(f"{rft.name}/")
    }
    assert {"wrench_predicted", "pose", "tare"} <= own
    assert [topic for topic in own if f"\n| `~/{topic}` |" not in page] == []


def test_laws_densities_and_memory_change_without_a_restart(rft):
    motion = {"linear": (0.1, 0.06, -0.5)}
    assert rft.set(law="agarwal2023", sensor__position=[0.0, 0.0, 0.1]) == (True, "")
    rft.until(lambda: rft.diagnostic("model")[2]["law"] == "agarwal2023")
    assert rft.set(sensor__position=[0.0, 0.0, 0.0]) == (True, "")
    for density in (1500.0, 0.0):
        assert rft.set(medium__density=density) == (True, "")
        found, expected = (
            numbers(rft.ask(rft.moment(), **motion)),
            predicted_by_the_core(law="agarwal2023", density=density, **motion),
        )
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15)
    assert rft.set(medium__mobilization_length=0.003) == (True, "")
    rft.until(lambda: rft.diagnostic("model")[2]["preparing"] == "")
    # nothing has built up yet
    assert abs(numbers(rft.ask(rft.moment(), **motion))[2]) < 1e-6 * expected[2]
    assert rft.set(law="treers2021", medium__mobilization_length=0.0) == (True, "")
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), predicted_by_the_core())


def test_a_table_of_alpha_y_swaps_and_one_that_cannot_be_used_is_refused_without_quoting_it(
    rft, tmp_path
):
    table, secret = tmp_path / "alpha_y.csv", tmp_path / "secret.csv"
    table.write_text("beta,alpha_y\n0,0.2035\n180,0.0\n")
    secret.write_text("beta,alpha_y\nroot:hunter2\n")
    assert "alpha_y.table" in refusal(rft, alpha_y__model="table")
    for file, why in (
        ("~nobody_1/table.csv", "does not exist; give the path"),
        ("/dev/zero", "is a pipe, socket or device; give a regular file"),
    ):
        assert f"alpha_y.table '{file}' {why}" in refusal(
            rft, alpha_y__model="table", alpha_y__table=file
        )
    assert rft.set(alpha_y__model="table", alpha_y__table=str(table)) == (True, "")
    rft.until(lambda: rft.diagnostic("model")[2]["alpha_y"] == "table")
    assert rft.set(alpha_y__table=str(secret)) == (True, "")
    rft.until(lambda: rft.get("alpha_y.table").string_value == str(table))
    assert f"alpha_y.table '{secret}' line 2 is not 2 numbers" in rft.said()
    assert "hunter2" not in rft.said()
    assert rft.set(medium__zeta=0.5) == (True, "")
    assert numbers(rft.ask(rft.moment()))[2] == pytest.approx(
        predicted_by_the_core(zeta=0.5)[2], rel=1e-12
    )
    assert rft.set(alpha_y__model="constant", alpha_y__table="", medium__zeta=1.0) == (True, "")
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), predicted_by_the_core())


def refusal(rft, **values):
    successful, reason = rft.set(**values)
    assert not successful
    return reason


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("medium__zeta", "much", "medium.zeta"),
        ("medium__name", "custard", "custard"),
        ("mesh__file", "no_such_mesh", "no_such_mesh"),
        (
            "mesh__file",
            "/none/there.stl",
            "/none/there.stl' does not exist; give a path, or one of abb_plate",
        ),
        ("mesh__origin", [0.0, 1.0], "mesh.origin"),
        ("executor", "single", "executor"),
        ("tool_frame", "world", "world_frame and tool_frame are both 'world'"),
    ],
)
def test_a_bad_value_is_refused_with_a_sentence_and_nothing_changes(rft, name, value, words):
    before = rft.get(name.replace("__", "."))
    assert words in refusal(rft, **{name: value})
    assert rft.get(name.replace("__", ".")) == before
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), predicted_by_the_core())


def test_a_reason_is_named_while_it_lasts_and_logged_when_it_begins_and_when_it_ends(start_node):
    rft = start_node("-p", "mesh.file:=plate").wait_ready()
    _, message, values = rft.diagnostic("estimates")
    assert (message, values["trust"]) == ("no estimates", "NO")

    def without_poses():
        rft.twist.publish(cdr("twist", rft.moment(), [0.0] * 6, "camera"))
        return rft.diagnostic("inputs")[1]

    rft.until(lambda: "no poses, twist_frame_unknown" in without_poses())

    def until_logged(sentence, **inputs):
        rft.until(
            lambda: rft.send(rft.moment(), **inputs) or rft.spin(0.1) or sentence in rft.said()
        )

    until_logged("began: wrench_missing", force=None)
    sentence = "pose frame_id 'elsewhere' is not world_frame 'world'"

    def in_an_unknown_frame():  # sent again, since a report that comes before this one is awaited is not looked at
        rft.send(rft.moment(), frame="elsewhere", force=None)
        rft.send(rft.moment(), force=None)
        return rft.diagnostic("inputs")[1]

    rft.until(lambda: sentence in in_an_unknown_frame())
    assert rft.last_status("inputs")[0] == b"\x01"
    until_logged(f"began: pose_frame_unknown ({sentence}; set", force=None)
    assert "rft doctor proposes the frames" in rft.said()
    until_logged("ended: pose_frame_unknown", force=None)
    assert "ended: wrench_missing" not in rft.said()
    until_logged("ended: wrench_missing")
    assert rft.said().count("began: wrench_missing") == 1


def test_a_short_history_of_poses_is_a_problem_only_if_it_lasts(start_node):
    rft = start_node("-p", "mesh.file:=plate", "-p", "twist_source:=pose_difference").wait_ready()
    begin = rft.moment()
    stamps = itertools.count(begin, 10_000_000)

    def reported(stamp):
        rft.send(stamp)
        rft.spin(0.01)
        return rft.last_status("inputs")[2]

    rft.diagnostic("inputs")
    rft.until(lambda: "count.pose_history_short" in reported(next(stamps)))
    seen = len(rft.diagnostics)
    while len(rft.diagnostics) < seen + 2:
        reported(next(stamps))
    assert "began: pose_history_short" not in rft.said()
    rft.until(lambda: reported(rft.moment()) and "began: pose_history_short" in rft.said())


def test_unreadable_messages_are_counted_and_the_node_continues(rft):
    def count():
        return int(rft.diagnostic("inputs")[2].get("count.message_unreadable", 0))

    before = count()
    for garbage in (
        b"\x00\x01\x00\x00",
        b"\x00\x01\x00\x00" + b"\xff" * 40,
        b"\x00\x07\x00\x00" + b"\x00" * 120,
    ):
        for topic in (rft.pose, rft.twist, rft.wrench):
            topic.publish(garbage)
    rft.until(lambda: count() >= before + 9)
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), predicted_by_the_core())


def test_tare_is_refused_in_the_grains_and_makes_the_reading_zero_in_the_air(rft):
    def at_rest_in_the_air(force):
        start, air = rft.moment(), {"z": 0.1, "linear": (0.0, 0.0, 0.0), "force": force}
        for k in range(41):
            rft.send(start + k * S // 20, **air)
        rft.ask(start + 2 * S + 1, **air)
        return start + 2 * S + 1

    def tared(force):
        """The answer to a tare at rest; asked again on a machine so busy that the poses are old meanwhile."""
        while True:
            at_rest_in_the_air(force)
            answer = rft.trigger("tare")
            if "come, the last one is" not in answer[1]:
                return answer

    def in_the_grains():
        rft.ask(rft.moment(), force=(1.0, 2.0, 3.0))
        successful, message = rft.trigger("tare")
        return not successful and "in the grains" in message

    rft.until(in_the_grains)
    assert tared((1.0, 2.0, 3.0)) == (True, "sensor.bias set to [1, 2, 3, 0, 0, 0] N, N m")
    rft.until(
        lambda: any(
            "set: sensor.bias" in line and "(tare)" in line for line in rft.said().splitlines()
        )
    )
    stamp = at_rest_in_the_air((1.0, 2.0, 3.0))
    rft.until(lambda: any(stamp_of(m) == stamp for m in rft.received["wrench_compensated"]))
    compensated = next(m for m in rft.received["wrench_compensated"] if stamp_of(m) == stamp)
    np.testing.assert_allclose(numbers(compensated), 0.0, atol=1e-12)
    successful, message = tared((8e6, 0.0, 0.0))
    assert not successful and "sensor.bias is 8e+06; it must lie between" in message
    rft.refuse(lambda p: p.name == "sensor.bias" and p.value[0] == 4.0, why="locked at 4 N")
    assert tared((4.0, 0.0, 0.0)) == (False, "locked at 4 N")
    assert rft.set(sensor__bias=[0.0] * 6)[0]


def test_the_last_residual_of_a_run_is_published_although_no_message_comes_any_more(rft):
    start = rft.moment()
    rft.ask(start, force=(0.0, 0.0, 3.0))
    last = start + S // 20
    rft.ask(last, force=None)
    rft.until(lambda: any(stamp_of(m) == last for m in rft.received["wrench_residual"]))


@pytest.mark.parametrize(
    ("silent", "what"), [("pose", "poses"), ("wrench", "load-cell samples"), ("both", "poses")]
)
def test_a_tare_is_refused_once_an_input_is_silent_and_names_it(rft, silent, what):
    """The other input goes on, or none."""
    start = rft.moment()
    air = {"z": 0.1, "linear": (0.0, 0.0, 0.0), "force": (1.0, 2.0, 3.0)}
    for k in range(41):
        rft.send(start + k * S // 20, **air)
    rft.ask(start + 2 * S + 1, **air)
    stamp = start + 2 * S + 1

    def refused():
        nonlocal stamp
        stamp += S // 20
        if silent == "pose":
            rft.wrench.publish(cdr("wrench", stamp, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)))
        elif silent == "wrench":
            rft.send(stamp, **air | {"force": None})
        successful, why = rft.trigger("tare")
        return not successful and f"tare refused: no {what} come, the last one is" in why

    rft.until(refused)
    assert rft.set(sensor__bias=[0.0] * 6)[0]


def test_a_second_publisher_of_the_poses_is_named_and_its_poses_are_no_noise(rft):
    other = rclpy.create_node("old_driver")
    try:
        other.create_publisher(PoseStamped, f"{rft.name}/pose", 10)
        found = f"2 publishers on {rft.name}/pose (old_driver, peer): stop all but one"
        rft.until(lambda: found in rft.diagnostic("inputs")[1])
        start = rft.moment()
        for k in range(400):
            rft.send(start + k * 8_000_000, z=0.1 + 0.003 * (k % 2))
        rft.ask(start + 4 * S, z=0.1)
        rft.diagnostic("inputs")
        assert "noise" not in rft.said()
    finally:
        other.destroy_node()
    rft.until(lambda: "publishers" not in rft.diagnostic("inputs")[1])


def test_the_log_names_the_unit_of_poses_in_millimetres_and_does_not_ask_to_smooth_them(
    start_node,
):
    rft = start_node("-p", "mesh.file:=plate", "-p", "twist_source:=pose_difference").wait_ready()
    random = np.random.default_rng(1)
    start = rft.moment()
    for k in range(400):
        z = 350.0 - 0.02 * k + 0.003 * random.standard_normal()
        rft.send(start + k * 8_000_000, z=z, linear=None)
    rft.until(
        lambda: rft.send(rft.moment(), z=350.0, linear=None) or "in millimetres" in rft.said()
    )
    assert "smooth the poses" not in rft.said()


def test_relative_files_lie_beside_the_parameter_file_whose_values_ros_takes(
    start_node, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    arguments = []
    for zeta, key in ((0.25, "/**/rft"), (0.5, "/**")):
        file = tmp_path / f"{zeta}" / "cell.yaml"
        file.parent.mkdir()
        (file.parent / "tool.stl").write_bytes(locate_mesh("plate").read_bytes())
        names = {
            "alpha_y.model": "table",
            "alpha_y.table": "table.csv",
            "mesh.file": "tool.stl",
            "medium.zeta": zeta,
        }
        file.write_text(
            f"'{key}':\n  ros__parameters:\n"
            + "".join(f"    {k}: {v}\n" for k, v in names.items())
        )
        arguments += ["--params-file", str(file.relative_to(tmp_path))]
    with pytest.raises(InputError, match=r"alpha_y.table '.*/0\.\d+/table.csv' does not exist"):
        start_node(*arguments)
    for folder in (tmp_path / "0.25", tmp_path / "0.5"):
        (folder / "table.csv").write_text("beta,alpha_y\n0,0.2\n180,0.1\n")
    rft = start_node(*arguments, as_shipped=True).wait_ready()
    folder = tmp_path / str(rft.get("medium.zeta").double_value)
    assert rft.get("alpha_y.table").string_value == str(folder / "table.csv")
    assert rft.get("mesh.file").string_value == str(folder / "tool.stl")


def test_a_corner_below_the_surface_without_force_is_not_in_the_grains(start_node):
    rft = start_node("-p", "mesh.file:=sphere", "-p", "integration:=centroid").wait_ready()
    height = -load_tool("sphere").lowest_point(np.eye(3), (0.0, 0.0)) - 1e-6
    assert not np.any(numbers(rft.ask(rft.moment(), z=height)))
    rft.until(lambda: rft.diagnostics)
    assert "deep in the grains" not in rft.said()


def test_the_node_says_that_it_begins_in_the_grains_and_that_the_cell_reads_a_force_in_the_air(
    start_node,
):
    rft = start_node("-p", "mesh.file:=plate").wait_ready()
    rft.ask(rft.moment(), z=-0.005)
    rft.until(lambda: "the first estimate is 6.6 mm deep in the grains" in rft.said())
    assert rft.set(surface_height=-1.0) == (True, "")
    rft.until(
        lambda: (
            rft.send(rft.moment(), z=0.5, force=(0.0, 0.0, 8.0))
            or "in the air: call ~/tare" in rft.said()
        )
    )
    level, message, _ = rft.diagnostic("inputs")
    assert level == DiagnosticStatus.WARN
    assert "the load cell reads a force in the air" in message


def test_a_node_with_nothing_set_answers_every_pose_also_at_rest_and_says_its_model(start_node):
    rft = start_node(as_shipped=True).wait_ready()
    first = rft.moment()
    heights = [
        0.03 - 0.0001 * min(k, 600) for k in range(800)
    ]  # from the air 30 mm deep, then rest
    predicted = rft.received["wrench_predicted"]
    for k, z in enumerate(heights):
        rft.send(first + k * 10_000_000, z=z, linear=(0.0, 0.0, -0.01 if k < 600 else 0.0))
        rft.until(lambda k=k: len(predicted) >= k - 5)  # so that no queue overflows
    rft.until(lambda: len(predicted) == len(heights))
    forces = [numbers(message)[2] for message in predicted]
    assert forces[599] > 1.0
    np.testing.assert_allclose(forces[650:], forces[640], rtol=0.01)
    rft._rft.announce("ready")  # as main does before the first pose
    in_words = (
        "integration refined, law treers2021, medium generic, alpha_y linear, zeta 1, memory 3 mm"
    )
    rft.until(lambda: in_words in rft.said())
