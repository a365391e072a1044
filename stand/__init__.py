"""The virtual IMU test stand: procedures, motion, physics, sensors, recordings.

>>> import stand
>>> s = stand.settings("six-position", imu="stim300", rate_hz=20, seed=3)
>>> run = stand.simulate(s)

The public names are those of `__all__`; each is imported when it is first used.
"""

from importlib import import_module

from stand.versions import VERSION as __version__

TYPE_CHECKING = False  # as typing has it, which takes longer to import than all of this
if TYPE_CHECKING:
    from stand.api import (
        align,
        allan,
        apply,
        calibrate,
        campaign,
        catalogue,
        compare,
        drive,
        film,
        picture,
        propose,
        read,
        recover,
        rehearse,
        run,
        side_by_side,
        simulate,
        stretches,
        unit,
    )
    from stand.errors import StandError
    from stand.recording.log_form import LogForm
    from stand.simulation.settings import settings

__all__ = [
    "LogForm",
    "StandError",
    "__version__",
    "align",
    "allan",
    "apply",
    "calibrate",
    "campaign",
    "catalogue",
    "compare",
    "drive",
    "film",
    "picture",
    "propose",
    "read",
    "recover",
    "rehearse",
    "run",
    "settings",
    "side_by_side",
    "simulate",
    "stretches",
    "unit",
]
_ELSEWHERE = {
    "LogForm": "stand.recording.log_form",
    "StandError": "stand.errors",
    "settings": "stand.simulation.settings",
}


def __getattr__(name: str):
    if name not in __all__:
        raise AttributeError(f"module 'stand' has no attribute {name!r}")
    found = getattr(import_module(_ELSEWHERE.get(name, "stand.api")), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
