"""The picture of a real plate that is pressed into sand and pulled out, predicted without and with memory.

python -m studies.abb_plate ../shared/data/abb_plate/abb_plate_3 docs/images/abb_plate_3.png
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.bags.options import read_replay_options
from rft_ros.parameters import read_parameter_file
from studies.pictures import estimates_of, legend_below
from studies.result import BLACK, BLUE, GREEN, ORANGE, VERMILION, new_figure, picture

__all__ = ["draw_abb_plate"]

_FILE = Path(__file__).resolve().parents[1] / "config" / "abb_plate.yaml"
_MODELS = {
    "Without memory (config/abb_plate.yaml)": {},
    "With memory: λ = 3 mm": {"medium.mobilization_length": 0.003, "alpha_y.model": "linear"},
}
_MEASURED = {"penetration": BLACK, "dwell": GREEN, "withdrawal": BLUE}


def draw_abb_plate(bag: Path, file: Path) -> None:
    """Draw the upward force over depth: measured by phase, and predicted with its standard deviation."""
    values, options = read_parameter_file(_FILE).values, read_replay_options(_FILE)
    figure = new_figure(9.0, 4.4)
    legend: dict[str, Any] = {}
    for axes, (title, changed) in zip(
        figure.subplots(1, 2, sharey=True), _MODELS.items(), strict=True
    ):
        table = estimates_of(bag, {**values, **changed}, options)
        table = table[table["depth"] > 0.0]
        depth, force = (
            1e3 * table["depth"],
            -table["predicted_fz"],
        )  # the cell's z axis points down
        for phase, colour in _MEASURED.items():
            of_phase = table["phase"] == phase
            if phase == "dwell":
                of_phase &= depth > 1.0
            measured = np.where(of_phase, -table["compensated_fz"], np.nan)
            style = {"marker": "o", "ms": 7, "ls": ""} if phase == "dwell" else {"lw": 1.8}
            legend[f"measured, {phase}"] = axes.plot(depth, measured, color=colour, **style)[0]
            predicted, sigma = np.where(of_phase, force, np.nan), table["sigma_fz"]
            name = "withdrawal" if phase == "withdrawal" else "penetration and dwell"
            colour = VERMILION if phase == "withdrawal" else ORANGE
            legend[f"predicted, {name}"] = axes.plot(depth, predicted, "--", color=colour, lw=1.6)[
                0
            ]
            band = axes.fill_between(
                depth, predicted - sigma, predicted + sigma, color=colour, alpha=0.15, lw=0
            )
            legend["± standard deviation"] = band
        axes.set_title(title, fontsize=10)
        axes.set_xlabel("Depth of the plate's lowest point [mm]")
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylim(-60.0, 110.0)  # the deviation at the turn is as wide as the force
    figure.axes[0].set_ylabel("Force on the plate, upwards [N]")
    legend_below(figure, legend, ncols=3, fontsize=9)
    figure.suptitle("Plate of 42.64 x 32.57 mm in sand, ABB trial 3, ζ = 1.11", fontsize=10)
    file.write_bytes(picture(figure))


if __name__ == "__main__":
    draw_abb_plate(Path(sys.argv[1]), Path(sys.argv[2]))
