"""A node that learns the medium: what it publishes, saves, forgets and reports."""

from itertools import pairwise

from harness import stamp_of
from sensor_msgs.msg import JointState

from rft_ros.parameters import read_parameter_file

STEP = 20_000_000  # at 1 cm/s: 0.2 mm of path


def press(rft, start, poses, stiffness, offset):
    """Push the tool down at 1 cm/s against a force that grows with depth [N/m]; the stamp after the last pose."""
    for k in range(poses):
        depth = 0.0002 * k
        rft.send(
            start + k * STEP,
            z=0.01 - depth,
            force=(0.0, 0.0, offset + stiffness * max(0.0, depth - 0.01)),
        )
        rft.until(lambda k=k: len(rft.received["wrench_sigma"]) >= k - 20)
    return start + poses * STEP


def test_a_node_that_learns_publishes_saves_and_forgets_what_it_learned(
    start_node, tmp_path, monkeypatch
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "home"))
    arguments = ("-p", "learning.mode:=apply", "-p", "mesh.file:=plate", "-p", "medium.zeta:=0.3")
    rft = start_node(*arguments)
    learned = []
    rft.node.create_subscription(JointState, f"{rft.name}/medium_learned", learned.append, 1000)
    rft.wait_ready()
    rft.until(lambda: rft.node.count_publishers(f"{rft.name}/medium_learned") > 0)
    assert rft.trigger("save_medium") == (False, "not saved: nothing was learned yet")
    rft.ask(rft.moment(), z=0.01)
    rft.diagnostics.clear()
    begin = rft.moment()
    end = press(rft, begin, 200, 1000.0, 5.0)  # not tared: over a tenth of the greatest force
    rft.until(lambda: any(stamp_of(m) == end - STEP for m in learned))
    assert learned[-1].name == [
        "vertical_strength",
        "horizontal_strength",
        "turn",
        "surface",
        "surprise",
    ]
    assert learned[-1].position[0] != 1.0
    assert 0.0 < learned[-1].effort[0] < learned[0].effort[0]
    stamps = [stamp_of(m) for m in learned]
    assert all(later - earlier >= STEP for earlier, later in pairwise(stamps))
    rft.until(lambda: any(s.name.endswith(": medium") for d in rft.diagnostics for s in d.status))
    successful, answer = rft.trigger("save_medium")
    assert successful
    assert "; doubtful" in answer
    assert "the load cell reads a force in the air: call ~/tare" in answer
    file = answer.partition("; ")[0]
    assert rft.trigger("save_medium")[1] != file  # also in the same second
    saved = read_parameter_file(tmp_path / file).values
    assert saved["medium.zeta"] != 0.3
    assert saved["medium.zeta_error"] > 0.0
    assert saved["mesh.file"] == "plate"
    assert rft.trigger("forget") == (True, "back to the calibration")
    assert rft.trigger("save_medium") == (False, "not saved: nothing was learned yet")


def test_learning_begins_and_ends_while_the_node_runs(rft):
    successful, why = off = rft.trigger("forget")
    assert not successful
    assert "set learning.mode to observe or apply" in why
    assert rft.trigger("save_medium") == off
    assert rft.set(learning__mode="observe") == (True, "")
    rft.until(lambda: rft.trigger("forget") == (True, "back to the calibration"))
    assert rft.set(learning__mode="off") == (True, "")
    assert rft.trigger("forget") == off
