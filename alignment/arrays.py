"""Owned, checked, read-only arrays: what makes a frozen dataclass really immutable."""

from collections.abc import Callable, Sequence
from mmap import mmap
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alignment.parts import in_parts

Array = NDArray[np.floating[Any]]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SMALL = 4096  # values that are looked at in one go


def owned(
    values: ArrayLike,
    name: str,
    shape: Sequence[int | None],
    dtype: Any = np.float64,
    nan: bool = False,
) -> NDArray[Any]:
    """Copy `values` into a read-only array of the given shape.

    What is read-only already is not copied: who locks an array gives it away.

    Parameters
    ----------
    values : array_like
    name : str
        Used in the message of the error.
    shape : sequence of int or None
        None matches any length.
    dtype : numpy dtype
    nan : bool
        Whether NaN may stand where there is no number.

    Raises
    ------
    ValueError
        Wrong shape, or a value that is not finite.
    """
    array = np.asarray(values, dtype=dtype)
    if not (array is values and _immutable(array)):
        array = np.array(array, order="C")
    fits = len(shape) == array.ndim and all(
        want is None or want == have for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        wanted = tuple("any" if n is None else n for n in shape)
        raise ValueError(f"{name}: shape {array.shape}, must be {wanted}")
    good = np.isfinite if not nan else _finite_or_nan
    alike = array.ndim > 1 and array.strides[0] == 0  # one row that stands for all
    if array.dtype.kind == "f" and not _all(good, array[:1] if alike else array):
        row = np.argwhere(~good(array))[0]
        raise ValueError(f"{name}: not finite at index {tuple(int(i) for i in row)}")
    array.flags.writeable = False
    return array


def _all(good: Callable[..., NDArray[np.bool_]], array: NDArray[Any]) -> bool:
    if array.size <= SMALL:
        return bool(good(array).all())
    return all(good(part).all() for part in in_parts(np.atleast_1d(array)))


def _finite_or_nan(array: NDArray[Any]) -> NDArray[np.bool_]:
    return ~np.isinf(array)


def _immutable(array: NDArray[Any]) -> bool:
    """Whether nobody can write to the array, not through the array it is a view of either."""
    if array.flags.writeable:
        return False
    if array.flags.owndata:
        return True
    if isinstance(array.base, mmap):  # of a file that nobody else knows
        return True
    return isinstance(array.base, np.ndarray) and _immutable(array.base)


def set_owned(instance: object, **fields: tuple[ArrayLike, Sequence[int | None], Any]) -> None:
    """Replace fields of a frozen dataclass by owned copies; for use in ``__post_init__``.

    Each keyword is a field's name with its (values, shape, dtype).
    """
    for name, (values, shape, dtype) in fields.items():
        object.__setattr__(instance, name, owned(values, name, shape, dtype))
