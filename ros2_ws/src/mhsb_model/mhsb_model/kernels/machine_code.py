"""A smaller file format of compiled kernels; the suite's only use of undocumented numba.

Numba stores a kernel's LLVM bitcode beside its machine code, so that the kernel can be linked into
other kernels. Every load reads both. Other kernels are linked with the inner version, so the
bitcode of the version that Python calls is never used. Without this bitcode, a planner's kernels
load in 1.5 s instead of 2.3 s of processor time. Numba has no option for that.

If a release of numba lacks the attributes that this module uses, numba's own, slower format is
used, and `test_machine_code.py` fails.
"""

from typing import Any

from llvmlite.binding import parse_assembly


def store_machine_code_alone(dispatcher: Any) -> None:
    """Make a dispatcher store empty functions in place of its compiled versions' LLVM bitcode.

    A version is the kernel compiled for one combination of argument types. Its machine code is
    stored as usual. The file is smaller and loads faster, but other kernels cannot be linked with
    the version. Nothing changes if numba lacks the necessary attributes.

    Args:
        dispatcher: Numba dispatcher that caches on disk, changed in place. Only Python may call its
            versions.
    """
    try:
        file_format = dispatcher._cache._impl
        reduce = file_format.reduce
    except AttributeError:
        return

    def reduce_without_bitcode(compiled: Any) -> tuple:
        """Return the data to store for a compiled version, with empty functions as bitcode.

        If the version does not have the expected form, its data are returned unchanged.

        Args:
            compiled: Numba's compile result.

        Returns:
            Tuple in the form of `CompileResult._reduce`.
        """
        reduced = reduce(compiled)
        try:
            (name, kind, (code, _)), *others = reduced
            names = compiled.fndesc.llvm_func_name, compiled.fndesc.llvm_cpython_wrapper_name
        except (AttributeError, TypeError, ValueError):
            return reduced
        empty = "".join(f'define void @"{each}"() {{ ret void }}\n' for each in names)
        return ((name, kind, (code, parse_assembly(empty).as_bitcode())), *others)

    file_format.reduce = reduce_without_bitcode
