"""How the pages become a site: ``make docs``, or ``python -m sphinx -c docs . build/docs`` in the root of the repository.

The pages are read where they lie, so that links work on the code host and on the site. Nothing is fetched: formulas become MathML,
styles and search come with the theme. A link that leads nowhere is an error (``-W``).
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import unveil_core  # noqa: E402

BESIDE = tuple(
    str(path.relative_to(ROOT).with_suffix(""))
    for pattern in ("benchmarks/README.md", "sample_scenes/**/README.md")
    for path in sorted(ROOT.glob(pattern))
)
"""Pages that lie beside what they describe."""
project = "Unveil"
author = "The Unveil authors"
copyright = "The Unveil authors"
version = release = unveil_core.__version__
root_doc = "docs/index"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
include_patterns = [
    "docs/**.md",
    "docs/**.rst",
    "CHANGELOG.md",
    "SECURITY.md",
    "blender_addon/README.md",
    *(f"{b}.md" for b in BESIDE),
]
exclude_patterns = [".*", "build", "dist", "node_modules", "tests", "unveil_core", "requirements", "demo_workspace"]

NAVIGATION = {
    "Guides": ("docs/install", "docs/artist", "docs/engineer", "docs/farm", "blender_addon/README"),
    "What goes in": ("docs/video", "docs/shots", "docs/datasets", "docs/input", "docs/masks", "docs/plates"),
    "What comes out": ("docs/workspace", "docs/exports", "docs/report"),
    "Reference": ("docs/command", "docs/python", "docs/api", "docs/glossary"),
    "How and how well": ("docs/method", "docs/benchmarks", "docs/benchmarks_parts", "docs/limits"),
    "Project": ("docs/development", "CHANGELOG", "SECURITY", *BESIDE),
}
"""The pages of the site under their headings. One that is missing here is an error (``-W``)."""

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
html_theme = "furo"
html_title = f"Unveil {version}"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_extra_path = ["site/root"]
html_show_sphinx = False
html_copy_source = False
html_math_renderer = "mathml"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_use_rtype = False
napoleon_use_ivar = True
highlight_language = "none"
suppress_warnings = ["myst.xref_ambiguous"]


def _mathml(node: nodes.Element, *, block: bool) -> str:
    return tex2mathml(node.astext(), as_block=block)


def inline_formula(self: Any, node: nodes.Element) -> None:
    """A formula in a line."""
    self.body.append(_mathml(node, block=False))
    raise nodes.SkipNode


def block_formula(self: Any, node: nodes.Element) -> None:
    """A formula of its own."""
    self.body.append(f'<div class="formula">{_mathml(node, block=True)}</div>')
    raise nodes.SkipNode


def for_the_site(app: Any, name: str, source: list[str]) -> None:
    """A page as the site has it.

    A drawing in Mermaid, which would need a program from elsewhere, gives way to the table beside it. A link to a folder, which the
    code host shows and a site does not, becomes text. The first page gets the navigation.
    """
    text = re.sub(r"^```mermaid\n.*?^```\n", "", source[0], flags=re.MULTILINE | re.DOTALL)
    here = (ROOT / name).parent

    def kept(link: re.Match[str]) -> str:
        return link[1] if (here / link[2]).is_dir() else link[0]

    source[0] = re.sub(r"(?<!!)\[([^\]\[]*)\]\(([^)#\s:]+)\)", kept, text)
    if name == root_doc:
        source[0] += "".join(_toctree(title, pages) for title, pages in NAVIGATION.items())


def _toctree(title: str, pages: tuple[str, ...]) -> str:
    return "\n".join(
        ["", "```{toctree}", ":hidden:", f":caption: {title}", "", *(f"/{page}" for page in pages), "```", ""]
    )


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", (inline_formula, None), (block_formula, None))
    app.connect("source-read", for_the_site)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
