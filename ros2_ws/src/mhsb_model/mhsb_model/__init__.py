"""Machine model of a hydraulic manipulator with booster modules; knows no ROS."""

from typing import TYPE_CHECKING

from mhsb_model.lazy_exports import import_on_use

__version__ = "0.1.0"

if TYPE_CHECKING:
    from mhsb_model.errors import MhsbError as MhsbError
    from mhsb_model.files.config_files import find_config_file as find_config_file
    from mhsb_model.machine import Machine as Machine
    from mhsb_model.machine import load_machine as load_machine
    from mhsb_model.mode_schedule import ModeSchedule as ModeSchedule
    from mhsb_model.modes import Mode as Mode
    from mhsb_model.trajectory import MotionState as MotionState
    from mhsb_model.trajectory import Trajectory as Trajectory

__getattr__ = import_on_use(
    __name__,
    {
        "MhsbError": "mhsb_model.errors",
        "find_config_file": "mhsb_model.files.config_files",
        "Machine": "mhsb_model.machine",
        "load_machine": "mhsb_model.machine",
        "ModeSchedule": "mhsb_model.mode_schedule",
        "Mode": "mhsb_model.modes",
        "MotionState": "mhsb_model.trajectory",
        "Trajectory": "mhsb_model.trajectory",
    },
)
