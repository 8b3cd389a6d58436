"""A finding on a cell: a sentence, the numbers that show it, and the values of parameters that mend it."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from rft_ros.parameters import Value


def in_words(value: Value) -> str:
    """A parameter's value as a parameter file takes it, numbers with four decimals where that is not 0."""
    if isinstance(value, str | bool):
        return str(value)
    if isinstance(value, Iterable):
        return "[" + ", ".join(f"{round(number, 4) + 0.0:g}" for number in value) + "]"
    rounded = round(value, 4) + 0.0
    return f"{rounded:g}" if rounded else f"{value:g}"  # a scale of 1e-6 is not 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One parameter of a cell, or another property of its set-up, and whether it is right.

    `said`: a sentence. `evidence`: by name the numbers that show it. `remedy`: by name the values of parameters that
    mend it; `alike`: the remedies of other explanations that leave as small a residual, {} for one that no parameter
    mends. `remap`: the rule of a replay that mends it, or "". `advice`: what to do beside or in place of them.
    `is_note`: for the reader only, neither right nor wrong. `spoils_calibration`: whether every fit would believe it.
    """

    name: str
    said: str
    ok: bool = False
    evidence: Mapping[str, float] = field(default_factory=dict)
    remedy: Mapping[str, Value] = field(default_factory=dict)
    alike: tuple[Mapping[str, Value], ...] = ()
    remap: str = ""
    advice: str = ""
    is_note: bool = False
    spoils_calibration: bool = False

    @property
    def text(self) -> str:
        """The sentence."""
        ways = [
            "set " + " and ".join(f"{name}: {in_words(value)}" for name, value in remedy.items())
            for remedy in (self.remedy, *self.alike)
            if remedy
        ]
        if self.advice:
            ways.append(self.advice)
        said = f"{self.name}: {self.said}"
        return "; ".join([said, ", or ".join(ways)]) if ways else said
