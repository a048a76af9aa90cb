"""What MkDocs does beside its own: links to files that are not on the site become their names."""

import re
from typing import Any


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace links out of this folder, which lead somewhere in the repository alone."""
    return re.sub(r"\[([^\]]+)\]\(\.\./[^)]*\)", r"\1", markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Remove the backslash before a bar in a table's code, which only GitHub needs."""
    return html.replace("\\|", "|")
