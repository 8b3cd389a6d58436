"""What a refused call says."""

import pytest

from rft_ros.errors import InputError


def refusal(call, *arguments, **options) -> str:
    """The sentence, on one line, of the InputError that a call ends with."""
    with pytest.raises(InputError) as refused:
        call(*arguments, **options)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def assert_says(sentence: str, *words: str) -> None:
    """Check that a sentence has these words, such as field, value and remedy, in any order."""
    assert not [word for word in words if word not in sentence], sentence
