"""Both charts as web pages that need no network: every point says what it is."""

from collections.abc import Mapping, Sequence
from typing import Any

from rft_ros.report.figure_page import figure_page
from rft_ros.studies.chart import BUDGETS, COLOURS, NAMES, in_scenes, shown_error
from rft_ros.studies.chart_points import CHOSEN, FULL, MERGED, NUMPY, Point, front
from rft_ros.studies.figure import BLACK, GREY
from rft_ros.studies.model_chart import averaged, colour_of, simulated_seconds
from rft_ros.studies.model_choice import GROUPS, PACKINGS, Judged

__all__ = ["chart_page", "models_page"]

_SYMBOLS = {FULL: "circle", MERGED: "square", CHOSEN: "triangle-up", NUMPY: "x"}


def chart_page(points: Sequence[Point]) -> str:
    """The first chart."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    by_scene = in_scenes(points)
    columns = (len(by_scene) + 1) // 2
    places = [(row, column) for row in (1, 2) for column in range(1, columns + 1)]
    figure = make_subplots(
        rows=2, cols=columns, subplot_titles=list(by_scene), shared_xaxes="all", shared_yaxes="all",
        horizontal_spacing=0.03, vertical_spacing=0.07,
    )  # fmt: skip
    named: set[str] = set()

    def add(row: int, column: int, chosen: Sequence[Point], name: str, **style: Any) -> None:
        x, y = [1e6 * p.time for p in chosen], [shown_error(p) for p in chosen]
        text = [f"{p.name}<br>{1e6 * p.time:.2f} µs, {100.0 * p.error:.3g} %" for p in chosen]
        figure.add_trace(
            go.Scatter(x=x, y=y, text=text, hoverinfo="text", name=name, legendgroup=name,
                       showlegend=name not in named, **style),
            row=row,
            col=column,
        )  # fmt: skip
        named.add(name)

    for (row, column), of_scene in zip(places, by_scene.values(), strict=False):
        best = front(of_scene)
        add(row, column, best, "Pareto front", mode="lines", line={"color": BLACK, "shape": "hv", "width": 2})
        groups = dict.fromkeys((p.integration, p.reduction, p.alpha_y) for p in of_scene)
        for rule, reduction, model in groups:
            chosen = [p for p in of_scene if (p.integration, p.reduction, p.alpha_y) == (rule, reduction, model)]
            symbol = _SYMBOLS[reduction] + ("-open" if model == "linear" else "")
            colour = GREY if reduction == NUMPY else COLOURS[rule]
            name = f"{NAMES[rule]}, {reduction}, α_y {model}"
            add(row, column, chosen, name, mode="markers", marker={"color": colour, "symbol": symbol, "size": 8})
        for budget in BUDGETS.values():
            figure.add_vline(x=budget, line={"color": GREY, "dash": "dash", "width": 1}, row=row, col=column)
    figure.update_xaxes(type="log", dtick=1, exponentformat="power")
    figure.update_yaxes(type="log", dtick=1, exponentformat="power")
    figure.update_xaxes(title_text="Time of one evaluation [µs]", row=2)
    figure.update_yaxes(title_text="Error against the converged force [%]", col=1)
    title = f"Accuracy against time, one core; dashed: what a tick leaves at {', '.join(BUDGETS)}"
    return _page(figure, "chart", title, 900)


def models_page(judged: Sequence[Judged], walls: Mapping[str, tuple[float, float]]) -> str:
    """The second chart."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, cols=2, subplot_titles=list(GROUPS), vertical_spacing=0.12)
    for k, group in enumerate(GROUPS):
        row, column = k // 2 + 1, k % 2 + 1
        for choice, (seconds, error) in averaged(judged, group).items():
            symbol = ("square" if choice.tolerance else "circle") + ("-open" if choice.alpha_y == "linear" else "")
            figure.add_trace(
                go.Scatter(x=[seconds], y=[100.0 * error], name=choice.name, legendgroup=choice.name, mode="markers",
                           showlegend=k == 0, hovertemplate="%{y:.1f} %, %{x:.2g} s",
                           marker={"color": colour_of(choice), "symbol": symbol, "size": 11}),
                row=row, col=column,
            )  # fmt: skip
        if span := simulated_seconds(walls, group):
            figure.add_trace(
                go.Scatter(x=list(span), y=[50.0 * sum(PACKINGS)] * 2, name="discrete elements (two packings)",
                           legendgroup="dem", showlegend=k == 0, mode="lines+markers",
                           line={"color": BLACK}, marker={"symbol": "diamond", "size": 10},
                           error_y={"array": [50.0 * (PACKINGS[1] - PACKINGS[0])] * 2}),
                row=row, col=column,
            )  # fmt: skip
        figure.update_yaxes(rangemode="tozero", row=row, col=column)
    figure.update_xaxes(type="log", title_text="Time for a run [s]", dtick=1, exponentformat="power")
    figure.update_yaxes(title_text="Median error of the force [%]")
    return _page(figure, "models", "Force against simulated grains: what each modelling choice buys, and takes", 850)


def _page(figure: Any, name: str, title: str, height: int) -> str:
    figure.update_layout(template="plotly_white", title=title, height=height)
    return figure_page(figure, title=title.partition(";")[0], name=name)
