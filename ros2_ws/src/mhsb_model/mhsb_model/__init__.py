"""Machine model of a hydraulic manipulator with booster modules; knows no ROS.

Each public name of a package is imported at its first use. A package's `__init__` runs before each
of its modules. If it imported all public names at once, even a command's `--help` would load the
whole suite.
"""

import importlib
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from mhsb_model.errors import MhsbError as MhsbError
    from mhsb_model.files.config_files import find_config_file as find_config_file
    from mhsb_model.machine import Machine as Machine
    from mhsb_model.machine import load_machine as load_machine
    from mhsb_model.mode_schedule import ModeSchedule as ModeSchedule
    from mhsb_model.modes import Mode as Mode
    from mhsb_model.obstacles.zones import Zones as Zones
    from mhsb_model.trajectory import MotionState as MotionState
    from mhsb_model.trajectory import Trajectory as Trajectory


def import_on_use(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a package whose names are imported on their first use.

    Args:
        package: Name of the package.
        modules: Mapping from each exported name to the full name of the module that defines it.

    Returns:
        Two functions. The first takes an exported name, imports the module that defines it, and
        returns its object. It raises AttributeError for other names. The second returns a sorted
        list of all names of the package, imported or not.
    """

    def get_export(name: str) -> Any:
        """Import the module that defines an exported name, and return the object of that name.

        Raises:
            AttributeError: The package exports no such name.
        """
        if name not in modules:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(importlib.import_module(modules[name]), name)

    def list_names() -> list[str]:
        """List all names of the package, imported or not."""
        return sorted({*vars(sys.modules[package]), *modules})

    return get_export, list_names


__getattr__, __dir__ = import_on_use(
    __name__,
    {
        "MhsbError": "mhsb_model.errors",
        "find_config_file": "mhsb_model.files.config_files",
        "Machine": "mhsb_model.machine",
        "load_machine": "mhsb_model.machine",
        "ModeSchedule": "mhsb_model.mode_schedule",
        "Mode": "mhsb_model.modes",
        "Zones": "mhsb_model.obstacles.zones",
        "MotionState": "mhsb_model.trajectory",
        "Trajectory": "mhsb_model.trajectory",
    },
)
