"""mkdocs hook: equations as MathML, which browsers draw by themselves.

Like GitHub, it takes ``$...$`` and blocks of ```` ```math ````. A placeholder word that Markdown does not change stands
for each equation; after Markdown, MathML replaces it.
"""

import re
from html import escape

from latex2mathml.converter import convert
from mkdocs.structure.pages import Page

__all__ = ["on_page_content", "on_page_markdown"]

_BLOCK = re.compile(r"^```math\n(?P<block>.*?)\n```$", re.DOTALL | re.MULTILINE)
_CODE_OR_INLINE = re.compile(
    r"^```.*?^```|`[^`\n]+`|\$(?P<inline>[^\s$](?:[^$]*[^\s$])?)\$", re.DOTALL | re.MULTILINE
)
_TAG = re.compile(r"\\tag\{(\w+)\}")
_WORD = "EquationNumber{}Here"


def _block(latex: str) -> str:
    tag = _TAG.search(latex)
    number = f'<span class="equation-number">({escape(tag[1])})</span>' if tag else ""
    anchor = f' id="eq-{escape(tag[1])}"' if tag else ""
    return f'<div class="equation"{anchor}>{convert(_TAG.sub("", latex), display="block")}{number}</div>'


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Replace each equation by a placeholder word, and keep the equations with the page."""
    drawn: list[str] = []

    def word(html: str) -> str:
        drawn.append(html)
        return _WORD.format(len(drawn) - 1)

    def inline(match: re.Match[str]) -> str:
        return match[0] if match["inline"] is None else word(convert(match["inline"]))

    text = _BLOCK.sub(lambda match: "\n" + word(_block(match["block"])) + "\n", markdown)
    text = _CODE_OR_INLINE.sub(inline, text)
    page.meta["equations"] = drawn
    return text


def on_page_content(html: str, page: Page, **_: object) -> str:
    """Put the equations back; one that stood alone loses its paragraph."""
    for number, drawn in enumerate(page.meta["equations"]):
        word = _WORD.format(number)
        html = html.replace(f"<p>{word}</p>", drawn).replace(word, drawn)
    return html
