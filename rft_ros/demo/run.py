"""Runs a virtual arm and a real node: moves the arm, tares, records, and shows a live table, as a user would."""

import math
import time
from pathlib import Path

from rich.box import SIMPLE
from rich.console import Console
from rich.live import Live
from rich.table import Table

from rft_ros.bags.writing import BagWriter, check_replaceable
from rft_ros.demo import virtual_arm
from rft_ros.demo.virtual_arm import PAUSE_S
from rft_ros.errors import InputError
from rft_ros.files import whole_folder
from rft_ros.node.recorded_node import WRENCHES, RecordedNode, ros_outlives_signals

_ELLIPSOID = "an ellipsoid on a virtual arm pitches into virtual grains; a real ROS 2 node predicts and learns."


def demo(bag: Path, parameters: Path, *, seconds: float) -> None:
    """Move and record a virtual arm for `seconds` [s]. Raises InputError if no estimates come."""
    if seconds <= PAUSE_S:
        raise InputError(
            f"--seconds is {seconds:g}; it must be over {PAUSE_S:g}, in which the arm rests in the air"
        )
    check_replaceable(bag)
    console = Console(highlight=False)
    console.print(f"[bold]rft demo[/bold]: {_ELLIPSOID}")
    with (
        whole_folder(bag.parent, [bag.name]) as part,
        BagWriter(part / bag.name) as writer,
        ros_outlives_signals(),
    ):
        node = RecordedNode(parameters, writer)
        try:
            console.print("waiting for the node, which may have to compile first ...")
            node.wait()
            start = time.monotonic()
            tare_at = PAUSE_S / 2.0
            with Live(
                console=console, refresh_per_second=8, get_renderable=lambda: _table(node)
            ) as live:
                for t, state, reading in virtual_arm.moments(seconds):
                    start = max(start, time.monotonic() - t)
                    node.spin(start + t)
                    node.send(t, state, reading)
                    if t > tare_at:
                        tared, said = node.call("tare")
                        live.console.print(f"t = {t:4.1f} s  tare: {said}", soft_wrap=True)
                        # try again: a busy machine may have delayed a twist
                        tare_at = math.inf if tared else t + 0.3
            node.spin(time.monotonic() + 0.5)  # the last answers
        finally:
            node.end()
    console.print(f"\n-> {bag} (rosbag2, MCAP)", soft_wrap=True)
    if node.wrench("residual") is None:
        raise InputError("no estimates came; see the node's messages above")


def _table(node: RecordedNode) -> Table:
    """A table of the newest wrenches."""
    title = f"t = {node.time:4.1f} s   (on the tool, sensor frame)"
    table = Table(title=title, box=SIMPLE, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("", min_width=11)
    for column in ("fx N", "fy N", "fz N", "tx N m", "ty N m", "tz N m"):
        table.add_column(column, justify="right", min_width=6)
    for name in WRENCHES:
        wrench = node.wrench(name)
        table.add_row(name, *([f"{v:.3f}" for v in wrench] if wrench else ["-"] * 6))
    return table
