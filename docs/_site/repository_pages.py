"""mkdocs hook: the README as home page, the generated page of commands and table of parameters, and linked files.

GitHub resolves a page's links from the page's folder. On the site, the pages of ``docs/`` are at the top. This hook
copies files outside ``docs/`` that they link to into ``repository/`` and changes the links accordingly. Such a copy has
no place in the navigation: a reader comes to it by the link.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page
from reference_pages import commands_page, parameters_table

__all__ = ["on_files", "on_page_markdown", "with_links_from_the_site"]

ROOT = Path(__file__).resolve().parents[2]
_PARAMETERS = "<!-- parameters -->"  # of docs/parameters.md: where the table goes
_FENCED_OR_LINK = re.compile(
    r"^```.*?^```|(?<=\]\()(?![a-z]+:|#)[^)#\s]+", re.DOTALL | re.MULTILINE
)


def _on_the_site(target: str, folder: str) -> str:
    path = posixpath.normpath(posixpath.join(folder, target))
    if path == "README.md":
        return "index.md"
    return path.removeprefix("docs/") if path.startswith("docs/") else f"repository/{path}"


def with_links_from_the_site(text: str, folder: str) -> str:
    """Change the links of a page in `folder` of the repository ("" is its top) to their targets on the site."""
    return _FENCED_OR_LINK.sub(
        lambda m: m[0] if m[0].startswith("```") else _on_the_site(m[0], folder), text
    )


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the home page, the page of commands, and each file outside ``docs/`` that a page links to."""
    home = with_links_from_the_site((ROOT / "README.md").read_text(encoding="utf-8"), "")
    files.append(File.generated(config, "index.md", content=home))
    files.append(File.generated(config, "commands.md", content=commands_page()))
    pages = [
        home,
        *(with_links_from_the_site(f.content_string, "docs") for f in files.documentation_pages()),
    ]
    for path in sorted(
        {p for text in pages for p in re.findall(r"\]\((repository/[^)#\s]+)", text)}
    ):
        source = ROOT / path.removeprefix("repository/")
        if source.is_file():  # else mkdocs says which page has the dead link
            file = File.generated(
                config, path, abs_src_path=str(source), inclusion=InclusionLevel.NOT_IN_NAV
            )
            files.append(file)
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Put the table of parameters in, and change the links, which the home page already has changed."""
    with_table = markdown.replace(_PARAMETERS, parameters_table())
    return with_table if page.is_homepage else with_links_from_the_site(with_table, "docs")
