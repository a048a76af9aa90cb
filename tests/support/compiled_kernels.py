"""Text for scripts that look for compilation after a warm-up."""

COUNT_COMPILED = """
import sys
from mhsb_model.kernels.kernel import Kernel

def compiled():
    return {
        f"{name}.{key}": len(value.signatures)
        for name, module in sys.modules.items()
        if name.startswith("mhsb_")
        for key, value in vars(module).items()
        if isinstance(value, Kernel)
    }
"""
"""Definition of a function that counts the compiled versions of each imported kernel."""
