"""Tables of numbers: every dialect in which people write them means the same; what cannot be meant is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import assert_says, refusal

from rft_ros.ground import read_height_map
from rft_ros.parameters import read_alpha_y_table, read_stress_map
from rft_ros.states_file import read_states
from rft_ros.table_file import Column, columns_named, read_table

UNITS = {"": 1.0, "deg": 1.0, "rad": 180.0 / np.pi}
COLUMNS = (
    Column("beta", UNITS),
    Column("alpha_x", {"": 1.0, "n/cm3": 1.0, "pa/m": 1e-6}, gaps=True),
)
MORE = (Column("gamma", UNITS),)
SPELLINGS = {  # of each column, with the factor to the reader's unit
    "beta": [("beta", 1.0), ("beta_deg", 1.0), ("β [rad]", 180.0 / np.pi)],
    "alpha_x": [("alpha_x", 1.0), ("alpha x (N/cm³)", 1.0), ("α_x_Pa/m", 1e-6)],
    "gamma": [("Gamma", 1.0), ('"gamma"', 1.0)],
    "label": [("label", 1.0), ("alpha_x_std", 1.0)],
}
number = st.floats(-1e3, 1e3, allow_subnormal=False)


@st.composite
def tables(draw):
    """A text, and the columns that it means, in the reader's units, by name."""
    names = draw(
        st.permutations(
            ["beta", "alpha_x", *draw(st.sampled_from([[], ["gamma"], ["label", "gamma"]]))]
        )
    )
    separator = draw(st.sampled_from([",", ";", "\t"]))
    decimal_comma = separator == ";" and draw(st.booleans())
    spelled = {name: draw(st.sampled_from(SPELLINGS[name])) for name in names}
    rows = draw(st.lists(st.tuples(*[number] * len(names)), min_size=1, max_size=5))
    gaps = draw(st.lists(st.booleans(), min_size=len(rows), max_size=len(rows)))
    header = separator.join(spelled[name][0] for name in names)
    lines = ["# a plate of 3 cm", "", header]
    meant = {name: [] for name in names}
    for row, gap in zip(rows, gaps, strict=True):
        cells = []
        for name, value in zip(names, row, strict=True):
            missing = gap and name == "alpha_x"
            cells.append(draw(st.sampled_from(["", "NaN", "n/a"])) if missing else repr(value))
            meant[name].append(np.nan if missing else value * spelled[name][1])
        lines += [
            separator.join(cells).replace(".", "," if decimal_comma else "."),
            "",
            "# a remark",
        ]
    end = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    mark = draw(st.sampled_from(["", "\ufeff"]))
    return mark + end.join([*lines, ""]), meant


@given(table=tables())
def test_names_give_columns_units_and_order_in_every_dialect(tmp_path_factory, table):
    text, meant = table
    file = tmp_path_factory.getbasetemp() / "table.csv"
    file.write_bytes(text.encode())
    rows = read_table(file, "table", COLUMNS, MORE)
    names = ["beta", "alpha_x", *(["gamma"] if "gamma" in meant else [])]
    assert [*rows.columns] == names
    for name in names:
        np.testing.assert_allclose(rows.columns[name], meant[name], rtol=1e-14)


READERS = {
    "states": read_states,
    "ground": lambda file: read_height_map(file, 0.01),
    "map": read_stress_map,
    "alpha_y": lambda file: read_alpha_y_table(str(file)),
}
HEADERS = {
    "states": "t,px,py,pz,qx,qy,qz,qw",
    "ground": "x,y,h",
    "map": "beta,gamma,alpha_x,alpha_z",
    "alpha_y": "beta,alpha_y",
}


@pytest.mark.parametrize("reader", READERS)
def test_a_line_that_is_no_row_is_refused_by_its_number_and_not_quoted(tmp_path, reader):
    file = tmp_path / "table.csv"
    width = HEADERS[reader].count(",") + 1
    one = ["1"] * width
    for cells in (["root:hunter2:19000"], one[1:], [*one, "1"], ["up", *one[1:]]):
        file.write_text(f"{HEADERS[reader]}\n\n{','.join(cells)}\n")
        said = refusal(READERS[reader], file)
        assert_says(said, str(file), f"line 3 is not {width} numbers")
        assert "hunter2" not in said
    for text in ("root:hunter2:19000\n", "# nothing\n", "words\n"):
        file.write_text(text)
        said = refusal(READERS[reader], file)
        assert_says(
            said, str(file), f"has no column {HEADERS[reader].split(',')[0]}", HEADERS[reader]
        )
        assert "hunter2" not in said
    file.write_text(HEADERS[reader] + "\n")
    assert_says(refusal(READERS[reader], file), "no rows")
    first = HEADERS[reader].split(",")[0]
    file.write_text(f"{HEADERS[reader]},{first}\n1\n")
    assert_says(refusal(READERS[reader], file), f"several columns {first}")


def test_a_group_of_columns_is_there_in_full_or_not_at_all(tmp_path):
    file = tmp_path / "table.csv"
    file.write_text("t,vx,vy\n0,1,2\n")
    time, twist = columns_named(["t"]), columns_named(["vx", "vy", "vz"])
    assert_says(refusal(read_table, file, "table", time, twist), "no column vz", "vx,vy,vz")
    file.write_text("t,wx\n0,1\n")
    assert [*read_table(file, "table", time, twist).columns] == ["t"]
