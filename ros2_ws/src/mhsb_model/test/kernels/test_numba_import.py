"""Kernels load numba without SciPy's linear algebra, which kernels can use all the same."""

import subprocess
import sys

CALL_KERNELS = """
import sys
import numba
import numpy as np
from mhsb_model.kernels.copying import copy_row

target = np.zeros(3)
copy_row(target, np.ones(3))
assert target.all()
assert "scipy.linalg" not in sys.modules
assert numba.njit(lambda a, b: a @ b)(target, target) == 3.0
assert "scipy.linalg" in sys.modules
"""
"""Script that calls a kernel, and then compiles a product of vectors."""


def test_a_kernel_imports_linear_algebra_only_if_it_needs_it() -> None:
    subprocess.run([sys.executable, "-c", CALL_KERNELS], check=True)
