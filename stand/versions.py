"""Our version, and those of all that has a say in the numbers."""

from functools import cache

VERSION = "0.2.0"
_PACKAGES = ("mujoco", "numpy", "scipy", "ruckig")


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    # imported here: `stand --help` needs neither
    import platform
    from importlib.metadata import version

    own = (("stand_version", VERSION), ("python_version", platform.python_version()))
    return (*own, *((f"{package}_version", version(package)) for package in _PACKAGES))


def versions() -> dict[str, str]:
    """Versions by `NAME_version`: of the stand, of Python, of what computes."""
    return dict(_versions())
