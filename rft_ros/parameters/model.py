"""The model of tool and grains that forces are computed with."""

from dataclasses import dataclass

from rft_ros.ground import HeightMap
from rft_ros.rft import Law, described
from rft_ros.tool import Tool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """The model of tool and grains. It is immutable: a change of any part makes a new model.

    `law`: the traction law, with all parameters of the grains. `ground`: the map of the ground at the start; None: the
    ground is a level plane at ``surface_height``. `generation`: the node counts it up with each new model.
    """

    tool: Tool
    law: Law
    ground: HeightMap | None = None
    generation: int = 0

    @property
    def in_words(self) -> str:
        """Tool, rule and grains, such as "tool plate (672 plates), integration refined, law ..., memory 3 mm"."""
        plates = self.tool.reduction or f"{len(self.tool.plates):,} plates"
        rule = self.tool.plates.integration
        return f"tool {self.tool.name} ({plates}), integration {rule}, {described(self.law)}"
