"""What MkDocs does beside its own: links to files that are not on the site become their names."""

import re
from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links out of this folder lead somewhere in the repository alone."""
    return re.sub(r"\[([^\]]+)\]\(\.\./[^)]*\)", r"\1", markdown)


def on_page_content(html: str, **_: Any) -> str:
    """A bar in code within a table stands behind a backslash on GitHub alone."""
    return html.replace("\\|", "|")
