"""What Sphinx makes the site with: `make docs-site`, or `python -m docs.site.build FOLDER`."""

from __future__ import annotations

from docs.site import diagrams
from station.version import version as own_version

project = "lostmotion"
release = own_version()
html_title = "lostmotion"
language = "en"

extensions = ["myst_parser"]
exclude_patterns = ["site", "**/__pycache__"]
nitpicky = True  # a link that leads nowhere is a warning, and a warning ends the build
myst_heading_anchors = 4  # #headings are linked as they are on a page of the repository
myst_fence_as_directive = ["mermaid"]
myst_links_external_new_tab = True
suppress_warnings: list[str] = []

html_theme = "furo"  # its letters are those of the reader's computer: nothing is fetched from elsewhere
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
html_permalinks_icon = "#"
pygments_style = "friendly"
highlight_language = "text"

setup = diagrams.setup
