"""Swaps under traffic: no tick lost, and none answered by a mixture of two bundles."""

import itertools
import time

import numpy as np
from cell import numbers, parameter_value, predicted_by_the_core, stamp_of
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters

MESHES, ZETAS, MODELS = ("plate", "sphere"), (1.0, 0.5, 0.25), ("constant", "linear")
MOTION = {"z": -0.03, "linear": (0.006, 0.004, -0.01)}


def send_call(client, name, value):
    parameter = Parameter(name=name, value=parameter_value(value))
    return client.call_async(SetParameters.Request(parameters=[parameter]))


def test_every_tick_is_answered_by_one_whole_bundle(start_cell):
    cell = start_cell("-p", "mesh.file:=plate").wait_ready()
    client = cell.node.create_client(SetParameters, f"{cell.name}/set_parameters")
    assert client.wait_for_service(timeout_sec=30.0)
    bundles = {
        bundle: predicted_by_the_core(mesh=bundle[0], zeta=bundle[1], alpha_y=bundle[2], **MOTION)
        for bundle in itertools.product(MESHES, ZETAS, MODELS)
    }
    changes = itertools.cycle(
        (
            ("medium.zeta", 0.5),
            ("alpha_y.model", "linear"),
            ("medium.zeta", 0.25),
            ("medium.zeta", 1.0),
            ("alpha_y.model", "constant"),
        )
    )
    meshes = {300: "sphere", 1500: "plate"}  # 6 s for each to be prepared and used
    rate, count, pending = 200.0, 2400, []
    first = cell.moment()
    start = time.monotonic()
    for k in range(count):
        while time.monotonic() < start + k / rate:
            cell.spin()
        cell.send(first + k * 5_000_000, **MOTION)
        if k % 40 == 0:
            pending.append(send_call(client, *next(changes)))
        if k in meshes:
            pending.append(send_call(client, "mesh.file", meshes[k]))
    predicted = cell.received["wrench_predicted"]
    cell.until(lambda: len(predicted) == count, timeout=10.0)
    assert [stamp_of(m) for m in predicted] == [first + k * 5_000_000 for k in range(count)]
    assert all(f.result().results[0].successful for f in pending)
    used = set()
    for message in predicted:
        matching = [b for b, w in bundles.items() if np.allclose(numbers(message), w, rtol=1e-12, atol=1e-15)]
        assert len(matching) == 1, "an answer that is no bundle's"
        used.add(matching[0])
    assert len(used) >= 6
    assert {b[0] for b in used} == set(MESHES)
