"""A row of the parameter table that nobody reads, and a quality flag that nobody sets, are found."""

import ast
from dataclasses import fields
from pathlib import Path

import rft_ros
from rft_ros.estimator.quality import QualityFlag
from rft_ros.parameters import PARAMETERS, LoadCell, Settings

PACKAGE = Path(rft_ros.__file__).parent
SOURCES = {f: ast.parse(f.read_text(encoding="utf-8")) for f in PACKAGE.rglob("*.py")}


def test_every_parameter_is_read_somewhere():
    texts = {
        node.value
        for file, tree in SOURCES.items()
        if file != PACKAGE / "parameters" / "table.py"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    taken = {f.name for f in fields(Settings)} | {f"sensor.{f.name}" for f in fields(LoadCell)}
    taken |= {f.name.replace("_", ".", 1) for f in fields(Settings)}
    parts = {text.partition(".")[2] for text in texts} | texts
    unread = [p.name for p in PARAMETERS if p.name not in texts | taken and p.name.partition(".")[2] not in parts]
    assert unread == []


def test_every_quality_flag_is_set_somewhere():
    named = {node.attr for tree in SOURCES.values() for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert {flag.name for flag in QualityFlag} - named == set()
