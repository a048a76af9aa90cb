"""Public names of a package, imported at their first use.

A package's `__init__` runs before each of its modules. If it imported what it exports, every
command would import the whole suite, even to print its help.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any


def import_on_use(package: str, modules: Mapping[str, str]) -> Callable[[str], Any]:
    """Make the function `__getattr__` of a package that exports names of its modules.

    Args:
        package: Name of the package.
        modules: Full name of the module that defines an exported name, by that name.

    Returns:
        Function from an exported name to its object. It raises AttributeError for other names.
    """

    def get_export(name: str) -> Any:
        """Import the module that defines a public name, and return the object of that name."""
        if name not in modules:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(importlib.import_module(modules[name]), name)

    return get_export
