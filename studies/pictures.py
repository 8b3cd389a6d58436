"""Pictures by matplotlib: legends, a tool in the grains, and the README's picture of the demo.

python -m studies.pictures out/demo/bag docs/images/demo.png
"""

import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from numpy.typing import NDArray

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.playback import played_estimates, played_motion
from rft_ros.bags.replay import replay
from rft_ros.demo.virtual_arm import LAYER_DEPTH_M
from rft_ros.installation import share_directory
from rft_ros.parameters import Config, Values, read_parameter_file
from rft_ros.report import TRACTION, Animation, animate

__all__ = ["draw_demo", "draw_moment", "estimates_of", "legend_below"]

_SURFACE, _SURFACE_EDGE, _FORCE = "#C2A878", "#7a6640", "#0072B2"


def estimates_of(bag: Path, values: Values, options: ReplayOptions) -> Any:
    """The rows of `estimates.csv` of a replay, with its columns as fields."""
    with tempfile.TemporaryDirectory() as folder:
        replay(bag, Path(folder), values, options)
        return np.genfromtxt(
            Path(folder) / "estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
        )


def legend_below(figure: Figure, entries: Mapping[str, Any], **style: Any) -> None:
    """Put a legend below the panels of a figure with constrained layout. `entries`: handles by label."""
    place = "outside lower center"
    if mpl.__version_info__ < (3, 7):  # 3.6, in Ubuntu 24.04, reserves no space for the legend
        place = "lower center"
        figure.set_layout_engine("constrained", rect=(0.0, 0.06, 1.0, 0.94))
    figure.legend(entries.values(), entries.keys(), loc=place, frameon=False, **style)


def draw_moment(figure: Any, axes: Any, scene: Animation) -> None:
    """Draw the scene's first moment into matplotlib's 3D axes, with a colour bar and the force in numbers.

    The viewpoint is nearly level, to show both the surface and the loaded faces below it.
    """
    n, points, level = scene.first, scene.positions[scene.first], scene.surface_height
    kilopascals, force = scene.traction[n], scene.forces[n]
    size = float(np.linalg.norm(force))
    low, high = points.min(axis=0), points.max(axis=0)
    around = 0.45 * float((high - low).max())
    low, high = low - around, high + around
    low[2], high[2] = min(low[2] + 0.4 * around, level), max(high[2], level + around)
    arrow = 0.62 * float((high - low)[2]) * force / (size or 1.0)

    (x0, y0, z0), (x1, y1, _) = low, high
    walls = [
        [(x0, y1, z0), (x1, y1, z0), (x1, y1, level), (x0, y1, level)],
        [(x0, y0, z0), (x0, y1, z0), (x0, y1, level), (x0, y0, level)],
    ]
    surface = [[(x0, y0, level), (x1, y0, level), (x1, y1, level), (x0, y1, level)]]
    grains = {"facecolors": _SURFACE, "linewidths": 1.0}
    axes.add_collection3d(
        Poly3DCollection(walls, **grains, edgecolors="none", alpha=0.3, zorder=1)
    )
    axes.add_collection3d(
        Poly3DCollection(surface, **grains, edgecolors=_SURFACE_EDGE, alpha=0.35, zorder=3)
    )
    axes.text(
        x0 + 1.0,
        y0,
        level - 0.06 * (high - low)[2],
        "grains",
        color=_SURFACE_EDGE,
        fontsize=10,
        zorder=6,
    )

    triangles = points[scene.faces]
    colours = LinearSegmentedColormap.from_list("traction", TRACTION)
    scale = Normalize(0.0, float(kilopascals.max(initial=0.0)) or 1.0)
    above = triangles[:, :, 2].mean(axis=1) > level
    for shown, order in (
        (~above, 2),
        (above, 4),
    ):  # the surface is drawn between them and veils only what is below
        if shown.any():
            edges = {"edgecolors": (0.0, 0.0, 0.0, 0.12), "linewidths": 0.25}
            shades = colours(scale(kilopascals[shown]))
            axes.add_collection3d(
                Poly3DCollection(triangles[shown], facecolors=shades, **edges, zorder=order)
            )
    if size > 0.0:
        axes.quiver(
            *points.mean(axis=0), *arrow, color=_FORCE, lw=3.0, arrow_length_ratio=0.16, zorder=5
        )
    axes.set(
        xlim=(x0, x1),
        ylim=(y0, y1),
        zlim=(z0, high[2]),
        xlabel="x [mm]",
        ylabel="y [mm]",
        zlabel="z [mm]",
    )
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(4))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.grid(visible=False)
    axes.set_box_aspect(high - low, zoom=1.0)
    axes.view_init(elev=7.0, azim=-62.0)
    x, y, z = (f"{v:.2f}".replace("-0.00", "0.00") for v in force)
    text = f"net force on the tool (x, y, z) = ({x}, {y}, {z}) N"
    axes.text2D(
        0.5,
        0.98,
        text,
        transform=axes.transAxes,
        color=_FORCE,
        ha="center",
        va="top",
        size=11,
        weight="bold",
    )
    figure.colorbar(
        ScalarMappable(scale, colours),
        ax=axes,
        label="Traction [kPa]",
        shrink=0.6,
        pad=0.02,
        aspect=20,
    )


def draw_demo(bag: Path, file: Path) -> None:
    """Draw the demo: the tool with the fixed model's traction, force over depth with and without learning, surprise."""
    values = read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml").values
    fixed = {**values, "learning.mode": "off"}
    options, model = ReplayOptions(tare=2.0), Config.of(fixed).model()
    tables = [estimates_of(bag, given, options) for given in (values, fixed)]
    rows, estimator = played_estimates(bag, fixed, model, options)
    motion = played_motion(rows, estimator, begin=rows["stamp"][0])
    title = "Traction and force by the fixed model"
    height = Config.of(fixed).surface_height
    scene = animate(title, model, motion, surface_height=height)
    strength: NDArray[np.float64] = np.linalg.norm(scene.forces, axis=1)
    strength[scene.positions[:, :, 2].max(axis=1) < scene.surface_height + 3.0] = -1.0
    scene = replace(scene, first=int(strength.argmax()))

    figure: Any = Figure(figsize=(13.6, 6.7), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.25))
    draw_moment(left, left.add_subplot(projection="3d", computed_zorder=False), scene)
    left.suptitle(scene.title, fontsize=10)
    panels = right.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (1.2, 0.9, 0.7)})
    legend: dict[str, Any] = {}
    learned, plain = (
        table[(table["depth"] > -1e-3) & np.isfinite(table["predicted_fz"])] for table in tables
    )
    depth = 1e3 * learned["depth"]
    for axes, axis, name in zip(panels, ("fz", "fx"), ("z (down)", "x (sideways)"), strict=False):
        middle, sigma = learned[f"predicted_{axis}"], learned[f"sigma_{axis}"]
        lines = (
            (
                "virtual load cell, less bias and weight",
                "#333333",
                depth,
                learned[f"compensated_{axis}"],
            ),
            (
                "predicted by the fixed model",
                "#E69F00",
                1e3 * plain["depth"],
                plain[f"predicted_{axis}"],
            ),
            ("predicted by the node, which learns", "#D55E00", depth, middle),
        )
        for label, colour, x, y in lines:
            legend[label] = axes.plot(x, y, color=colour, lw=1.5)[0]
        band = axes.fill_between(
            depth, middle - sigma, middle + sigma, color="#D55E00", alpha=0.22, lw=0
        )
        legend["± standard deviation"] = band
        axes.set_ylabel(f"Force along\nsensor {name} [N]")
    legend["surprise"] = panels[2].plot(depth, learned["surprise"], color="#999999")[0]
    panels[2].set(
        ylabel="Surprise\n[std. deviations]", xlabel="Depth of the tool's lowest point [mm]"
    )
    for axes in panels:
        legend["hard layer begins"] = axes.axvline(1e3 * LAYER_DEPTH_M, color="#009E73", lw=1.5)
        axes.grid(alpha=0.3)
    legend_below(figure, legend, ncols=4)
    told = "an ellipsoid pitches ±9° on its way down at 5 mm/s into grains that the node does not know"
    figure.suptitle(f"rft demo: {told}")
    figure.savefig(file, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    draw_demo(Path(sys.argv[1]), Path(sys.argv[2]))
