"""How the kernels are compiled: once per machine, kept on disk, strict floating point.

Without fastmath and fused operations the compiled code gives the bits of the same source run as
plain Python (`NUMBA_DISABLE_JIT=1`). Division follows IEEE 754, as numpy's does, which leaves no
branch for an exception in the kernels.

numba keeps a kernel until its own file changes. It does not see that a kernel of another file,
which was compiled into it, has changed: the tests therefore discard kernels older than any source.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def _compiler(**options: Any) -> Callable[[Function], Function]:
    compile_with: Any = njit
    compiler: Callable[[Function], Function] = compile_with(
        cache=True, error_model="numpy", nogil=True, **options
    )
    return compiler


kernel = _compiler(_nrt=False)
"""Compiles a kernel that Python calls. It allocates nothing: its arrays are its caller's, and it
does not count references to them, which would cost more than a filter's step."""

inlined = _compiler(_nrt=False, forceinline=True)
"""Compiles a kernel into those that call it: passing its arrays would cost more than its work,
and the number of derivatives is a constant there."""

allocating = _compiler()
"""Compiles a kernel that makes arrays; only Python and its like may call it, not those above."""
