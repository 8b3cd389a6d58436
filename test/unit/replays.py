"""What tests of the replay share: parameters by keyword, and a replay's table."""

import csv

from rft_ros.parameters import checked, defaults


def values(**changes):
    return defaults() | {k.replace("__", "."): checked(k.replace("__", "."), v) for k, v in changes.items()}


def rows_of(folder):
    with (folder / "estimates.csv").open() as file:
        return list(csv.DictReader(file))
