"""The layouts of Foxglove, PlotJuggler and RViz show topics and fields that the node publishes."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import yaml

from rft_ros.node.topics import message_class

ROOT = Path(__file__).resolve().parents[2]
FOXGLOVE = json.loads((ROOT / "config" / "foxglove.json").read_text(encoding="utf-8"))


def panels(layout: object) -> Iterator[str]:
    """The panels of a Foxglove layout: one, or two splits in a direction."""
    if isinstance(layout, str):
        yield layout
    else:
        assert layout["direction"] in ("row", "column")
        assert 0 < layout["splitPercentage"] < 100
        yield from panels(layout["first"])
        yield from panels(layout["second"])


def shown() -> Iterator[tuple[str, list[str]]]:
    """Each topic with the field, by names, that a layout shows; without a field where it shows the whole message."""
    for panel in FOXGLOVE["configById"].values():
        for topic in [*panel.get("topics", {}), *filter(None, [panel.get("topicToRender")])]:
            yield topic, []
        for path in panel.get("paths", []):
            topic, *fields = path["value"].split(".")
            yield topic, fields
    for curve in ElementTree.parse(ROOT / "config" / "plotjuggler.xml").iter():
        for name in (curve.get("name", ""), curve.text or ""):
            if match := re.fullmatch(r"(/rft/\w+)/(wrench/\w+/\w+|\w+/(?:position|effort))", name):
                topic, path = match.groups()
                yield topic, path.split("/")[-1 if topic.endswith("learned") else 0 :]
    view = yaml.safe_load((ROOT / "rviz" / "rft.rviz").read_text(encoding="utf-8"))
    for display in view["Visualization Manager"]["Displays"]:
        if "Topic" in display:
            yield display["Topic"]["Value"], []


def test_a_foxglove_layout_places_each_panel_once():
    assert {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"} == set(
        FOXGLOVE
    )
    placed = list(panels(FOXGLOVE["layout"]))
    assert sorted(placed) == sorted(FOXGLOVE["configById"])
    assert {panel.partition("!")[0] for panel in placed} <= {"3D", "Plot", "DiagnosticSummary"}


def test_a_layout_shows_what_the_node_publishes(rft):
    published = dict(
        rft.node.get_publisher_names_and_types_by_node("rft", rft.name.rpartition("/")[0])
    )
    found = list(shown())
    assert len(found) > 30
    for topic, fields in found:
        (kind,) = published[topic.replace("/rft", rft.name, 1)]
        message = message_class(kind)()
        for field in fields:
            name, indexed, _ = field.partition("[")
            message = getattr(message, name)
            assert not indexed or hasattr(message, "append")
