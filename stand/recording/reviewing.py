"""A review where rerun is installed, and nothing where it is not: the recording needs none."""

from typing import Any, Self

MISSING = "no review: rerun is not installed (pip install 'rerun-sdk>=0.41,<0.42')"


class NoReview:
    """Takes all that a `ReviewWriter` takes, and keeps nothing."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *taken: None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def open_review(path: Any, **described: Any) -> Any:
    """A `ReviewWriter`, or a `NoReview` without rerun; all as the former takes it."""
    if not can_review():
        return NoReview()
    from stand.recording.review import ReviewWriter

    return ReviewWriter(path, **described)


def can_review() -> bool:
    """Whether rerun is installed; it is imported, which takes its time."""
    try:
        import stand.recording.review  # noqa: F401
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "rerun":
            raise
        return False
    return True
