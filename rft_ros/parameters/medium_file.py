"""Reads and writes the files that define a user's medium: nine coefficients (YAML), or a measured stress map (CSV).

The coefficients of a stress map are fitted when it is read.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rft_ros.errors import InputError, shown
from rft_ros.files import read_yaml, whole
from rft_ros.parameters.stress_map import MediumFit, fit_medium
from rft_ros.parameters.stress_tables import GREATEST, LEAST, read_stress_map
from rft_ros.rft import MEDIA, Medium

__all__ = ["is_medium_file", "read_medium", "write_medium"]

_YAML = (".yaml", ".yml")
_MAX_COEFFICIENTS = 16 * 2**10  # bytes; YAML takes 12 s for 1 MB


def is_medium_file(text: str) -> bool:
    """Whether a medium is given by a file, rather than by a name of `MEDIA`."""
    return text not in MEDIA and (bool(Path(text).suffix) or "/" in text)


def read_medium(file: str) -> Medium:
    """The medium that a file defines, with the file's stem as its name unless the file gives one.

    A YAML file is a mapping with the nine coefficients [N/cm³], as `write_medium` writes it. Any other file is a stress
    map. Raises InputError for a file that cannot be used.
    """
    path = Path(file)
    if path.suffix.lower() in _YAML:
        return _of_yaml(path)
    measured = read_stress_map(path)
    try:
        return fit_medium(measured, name=path.stem).medium
    except ValueError as error:
        raise InputError(f"medium.file '{file}': {error}") from None


def _of_yaml(file: Path) -> Medium:
    what = f"medium.file '{file}'"
    content = read_yaml(file, "medium.file", limit=_MAX_COEFFICIENTS)
    if not isinstance(content, Mapping):
        raise InputError(f"{what} has no coefficients; it needs {', '.join(MEDIA['generic'].coefficients)}")
    given = content.get("coefficients", content)
    if not isinstance(given, Mapping):
        raise InputError(f"{what}: coefficients is {shown(given)}; it must have names and numbers [N/cm³]")
    given = {str(name).replace("-", "m"): value for name, value in given.items()}  # Li et al. write B-11
    found = {}
    for name in MEDIA["generic"].coefficients:
        value = given.get(name)
        if value is None:
            raise InputError(f"{what} has no coefficient {name}; give all nine, and 0.0 for one that is zero")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= GREATEST:
            raise InputError(f"{what}: {name} is {shown(value)}; it must be a number of at most {GREATEST:g} N/cm³")
        found[name] = float(value)
    medium = Medium.of(str(content.get("name", file.stem)), found)
    if max(map(abs, found.values())) < 0.1 * LEAST:
        raise InputError(f"{what}: its coefficients are below {0.1 * LEAST:g}; they must be in N/cm³")
    if medium.strength <= 0.0:
        raise InputError(f"{what}: with these coefficients the force points along the motion; check the signs")
    return medium


def write_medium(file: Path, fit: MediumFit, *, source: str) -> None:
    """Write a fitted medium for `read_medium`, with standard errors and misfit. `source`: the map of the fit."""

    def rounded(value: float) -> float | None:
        return None if np.isnan(value) else float(f"{value:.4g}")

    tree: dict[str, Any] = {"name": fit.medium.name}
    tree["coefficients"] = {name: round(value, 6) for name, value in fit.medium.coefficients.items()}
    tree["errors"] = {name: rounded(value) for name, value in fit.errors.items()}
    tree["misfit"] = {"measured": rounded(fit.size), "fitted": rounded(fit.misfit)}
    tree["misfit"] |= {"generic_scaled": rounded(fit.misfit_scaled), "zeta_of_generic": rounded(fit.zeta)}
    if fit.left_out is not None:
        tree["left_out"] = {"fitted": rounded(fit.left_out.fitted)}
        tree["left_out"]["generic_scaled"] = rounded(fit.left_out.scaled)
    head = [
        f"A medium for medium.file: Eq. (4) of docs/method.md, fitted by rft fit-medium to {source}.",
        "All in N/cm³. errors: standard errors of the coefficients; null: the map does not determine it.",
        "misfit: RMS of the stress (alpha_x, alpha_z), as measured, and of the residual of the fit or of the generic",
        "medium times zeta_of_generic. left_out: RMS of the residual on cells that were left out of the fit.",
        *fit.medium.doubts,
        *fit.remarks,
    ]
    with whole(file, "medium") as part:
        lines = "".join(f"# {' '.join(sentence.split())}\n" for sentence in head)
        part.write_text(lines + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True), encoding="utf-8")
