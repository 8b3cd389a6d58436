"""One reader of YAML: what it takes means the same to ROS and to YAML 1.1; the rest is refused by its line."""

from contextlib import suppress

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from refusals import assert_says, refusal

from rft_ros.errors import InputError
from rft_ros.yaml_file import read_yaml, yaml_content, yaml_text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-4", 1e-4),
        ("off", False),
        ("true", True),
        ("-3", -3),
        (".5", 0.5),
        ("2.", 2.0),
        ("~", None),
        ("", None),
    ]
    + [
        (text, text)
        for text in ("1e", "1e-4x", "plate-1e5.stl", "package://a/b.stl", "3 mm", "/a b", "nano")
    ],
)
def test_what_has_one_meaning_is_read(text, value):
    read = yaml_content(f"a: {text}", "text")["a"]
    assert repr(read) == repr(value)
    if text != "1e-4":  # text to PyYAML; every other reader takes it for a number
        assert repr(yaml.safe_load(f"a: {text}")["a"]) == repr(value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        *((f"a: 1\nb: {text}\n", ("line 2", repr(text), "decimal number", "quotes")) for text in
          ("010", "0x1p3", "yes", "No", "on", "n", "0b1", "1_0", "12:30", "2001-01-01", "inf", ".inf", "1e400", "=")),
        ("a: &x 1.0\nb: *x\n", ("line 2", "alias", "write its values out")),
        ("a:\n  <<: {b: 1}\n", ("line 2", "merge key", "write its values out")),
        ("tools: 1\ntools: 2\n", ("line 2", "'tools' a second time", "remove one")),
        ("a: 1\n[1]: 2\n", ("line 2", "name")),
        ("a: 1\nb: !!str 2\n", ("line 2", "tag")),
        ("a: >\n  text\n", ("line 1", "block", "quotes")),
        ("a: 1\n---\nb: 1\n", ("line 2", "second document")),
        ("a: [1, 2\n", ("not YAML",)),
        ("[" * 5000, ("not YAML",)),
        ("a: " + "9" * 5000, ("line 1", "999...", "decimal number")),
    ],
)  # fmt: skip
def test_what_has_several_meanings_is_refused_by_its_line_with_what_to_write(
    tmp_path, text, words
):
    file = tmp_path / "study.yaml"
    file.write_text(text)
    said = refusal(read_yaml, file, "study")
    assert_says(said, "study", str(file), *words)
    assert len(said) < 500


_scalars = st.one_of(
    st.booleans(), st.integers(-(10**17), 10**17), st.floats(-1e9, 1e9).map(lambda x: round(x, 6))
)
_texts = st.text(st.characters(codec="utf-8", exclude_characters="\0"))
_words = st.sampled_from(
    ["010", "yes", "off", "~", "", "1e-4", "0x1p3", "12:30", "*a", "<<", "a: b", "# a", "é", "n"]
)
_values = st.one_of(
    _scalars, _texts, _words, st.lists(st.floats(-9, 9).map(lambda x: round(x, 3)), max_size=3)
)


@given(
    tree=st.dictionaries(
        st.text("abc_", min_size=1), st.one_of(_values, st.lists(_texts, max_size=3))
    )
)
def test_what_is_written_is_read_back_unchanged(tree):
    assert yaml_content(yaml_text(tree), "text") == (tree or {})


@given(text=st.text("01e.-+xpyYnN_:~'\"[]{}&*!|>#\n =<?", max_size=12))
def test_any_text_is_read_or_refused(text):
    with suppress(InputError):
        yaml_content(text, "text")
