"""Diagrams of the pages, drawn in the reader's browser by files of the site alone: nothing comes from the network.

A page names a diagram by a fence `mermaid`. The site has the Mermaid that NiceGUI brings along. A page that is opened as a
file, not from a server, may not load it by the browser's rules; there the text of the diagram stays, which can be read too.
"""

from __future__ import annotations

import shutil
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx

LIBRARY = Path("elements", "mermaid", "dist")
"""Where NiceGUI keeps its Mermaid."""


class Mermaid(SphinxDirective):
    """A diagram by its text."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the text as an element that the browser draws."""
        text = escape("\n".join(self.content))
        self.env.metadata[self.env.docname]["diagram"] = True
        return [nodes.raw("", f'<pre class="mermaid">{text}</pre>', format="html")]


def add_script(app: Sphinx, page: str, template: str, context: dict[str, Any], tree: nodes.document | None) -> None:
    """Load the script on a page that has a diagram, and on no other."""
    del template, tree
    if (context.get("meta") or {}).get("diagram") or app.env.metadata.get(page, {}).get("diagram"):
        app.add_js_file("diagrams.js", type="module")


def copy_library(app: Sphinx, failed: Exception | None) -> None:
    """Copy Mermaid beside the pages."""
    spec = find_spec("nicegui")
    if failed is None and spec is not None and spec.origin is not None:
        there = Path(spec.origin).parent / LIBRARY
        shutil.copytree(there, Path(app.outdir) / "_static" / "mermaid", dirs_exist_ok=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx of the diagrams."""
    app.add_directive("mermaid", Mermaid)
    app.connect("html-page-context", add_script)
    app.connect("build-finished", copy_library)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
