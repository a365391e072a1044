"""The inner state of something that goes on, as plain data: dictionaries, lists, numbers, text.

What changes as it goes is taken: random streams, filters' memories, sums. Constants (frozen
dataclasses: a preset, a unit's errors) are left out, for a new one has them too.
"""

from dataclasses import is_dataclass
from typing import Any

import numpy as np

from stand.errors import StandError

_CACHES = ("_band",)  # worked out anew where they are missing


def taken(part: Any) -> Any:
    """The state of a part; JSON brings every number of it back to the last bit."""
    if part is None or isinstance(part, (bool, int, float, str)):
        return part
    if isinstance(part, np.generic):
        return taken(part.item())
    if isinstance(part, complex):
        return [part.real, part.imag]
    if isinstance(part, np.ndarray):
        if np.iscomplexobj(part):
            part = np.stack([part.real, part.imag])
        return {"shape": list(part.shape), "values": part.ravel().tolist()}
    if isinstance(part, np.random.Generator):
        return dict(part.bit_generator.state)
    if isinstance(part, (list, tuple)):
        return [taken(one) for one in part]
    return {name: taken(one) for name, one in _changing(part).items()}


def put_back(part: Any, state: Any) -> Any:
    """A part made anew, with the state of another; what must be a new value is returned.

    Raises
    ------
    StandError
        The state is not of such a part.
    """
    if part is None or isinstance(part, (bool, int, float, str)):
        return state
    try:
        if isinstance(part, (complex, np.complexfloating)):
            return complex(*state)
        if isinstance(part, np.generic):
            return state
        if isinstance(part, np.ndarray):
            if np.iscomplexobj(part):
                real, imag = np.array(state["values"], float).reshape(state["shape"])
                return real + 1j * imag
            return np.array(state["values"], part.dtype).reshape(state["shape"])
        if isinstance(part, np.random.Generator):
            part.bit_generator.state = state
        elif isinstance(part, (list, tuple)):
            return type(part)(put_back(a, b) for a, b in zip(part, state, strict=True))
        else:
            for name, one in _changing(part).items():
                setattr(part, name, put_back(one, state[name]))
    except (KeyError, TypeError, ValueError) as error:
        raise StandError(f"state: not that of this unit: {error!r}") from error
    return part


def _changing(part: Any) -> dict[str, Any]:
    return {
        name: one
        for name, one in vars(part).items()
        if name not in _CACHES and not is_dataclass(one) and not callable(one)
    }
