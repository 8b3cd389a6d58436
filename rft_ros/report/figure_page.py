"""A page of one plotly figure, which needs nothing beside it."""

from html import escape
from typing import Any

__all__ = ["figure_page"]


def figure_page(figure: Any, *, title: str, name: str) -> str:
    """The page's HTML. `title`: what its tab shows. `name`: the figure's id, so that the same figure gives the same."""
    page: str = figure.to_html(
        include_plotlyjs=True, full_html=True, div_id=name, auto_play=False, config={"displaylogo": False}
    )
    head = f'<head><title>{escape(title)}</title><link rel="icon" href="data:,">'
    return page.replace("<html>", '<html lang="en">', 1).replace("<head>", head, 1)
