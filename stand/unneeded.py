"""Parts of libraries that others bring along and nobody here uses: run when they are, if ever.

SciPy's rotations look at every name of NumPy, and with that import its reader of Fortran and its
tools for tests, 20 ms of each command; pydantic looks through all that is installed for plugins,
10 ms. For programs, before the libraries are imported: a library leaves imports as they are.
"""

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

MODULES = ("numpy.f2py", "numpy.testing")
PLUGINS = "PYDANTIC_DISABLE_PLUGINS"


def put_off_the_unneeded() -> None:
    """Modules that are not needed are run when something is first asked of them."""
    os.environ.setdefault(PLUGINS, "__all__")
    if _Lazy not in sys.meta_path:
        sys.meta_path.insert(0, _Lazy)


class _Lazy(PathFinder):
    @classmethod
    def find_spec(
        cls,
        fullname: str,
        path: Sequence[str] | None = None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        if fullname not in MODULES:
            return None
        spec = super().find_spec(fullname, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec
