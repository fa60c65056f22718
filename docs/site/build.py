"""Builds the documentation as a site: `python -m docs.site.build FOLDER`, or `make docs-site`. A warning ends the build."""

from __future__ import annotations

import gc
import sys
import tempfile
from pathlib import Path

from sphinx.cmd.build import build_main

HERE = Path(__file__).parent
DOCS = HERE.parent


def build(out: Path) -> int:
    """Build the site into a folder; return 0, or another number where there was a warning, which stands on the screen."""
    with tempfile.TemporaryDirectory() as kept:
        options = ("--fail-on-warning", "--keep-going", "--nitpicky", "--quiet", "--fresh-env", "--doctree-dir", kept)
        gc.disable()  # the trees of all pages stay until the end: looking for what is over in them takes a third more
        try:
            return build_main([*options, "--conf-dir", str(HERE), "--builder", "html", str(DOCS), str(out)])
        finally:
            gc.enable()


def main() -> int:
    """Build into the folder that the command names."""
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        sys.stderr.write("usage: python -m docs.site.build FOLDER\n")
        return 2
    out = Path(sys.argv[1])
    if out.exists() and any(out.iterdir()) and not (out / "objects.inv").is_file():
        sys.stderr.write(f"{out}: is not empty, and not a site that was built before. Name another folder\n")
        return 2
    code = build(out)
    if code == 0:
        sys.stderr.write(f"{out / 'index.html'}\n")
    return code


if __name__ == "__main__":
    sys.exit(main())
