"""Machine model of a hydraulic manipulator with booster modules; knows no ROS."""

from mhsb_model.kernel_cache import use_kernel_cache

use_kernel_cache()
