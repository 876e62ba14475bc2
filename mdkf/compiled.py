"""How the kernels are compiled: once per machine, kept on disk, strict floating point.

Without fastmath and fused operations the compiled code gives the bits of the same source run as
plain Python (`NUMBA_DISABLE_JIT=1`). Division follows IEEE 754, as numpy's does, which leaves no
branch for an exception in the kernels.

numba keeps a kernel until its own file changes. It does not see that a kernel of another file,
which was compiled into it, has changed: the tests therefore discard kernels older than any source.
"""

from numba import njit

kernel = njit(cache=True, error_model="numpy")
"""Compiles a kernel that Python calls."""

inlined = njit(cache=True, error_model="numpy", forceinline=True)
"""Compiles a kernel into those that call it: passing its arrays would cost more than its work,
and the number of derivatives is a constant there."""
