"""Known faults: what an estimator says when it cannot stand behind a number."""


class Fault(Exception):
    """A known fault of what was given, told in one line; whatever else is raised is a bug."""


class AlignmentError(Fault, ValueError):
    """The readings or the site do not allow the estimate; the message says why."""


class NotAtRest(AlignmentError):
    """The unit moved during readings that must be at rest."""


class TooShort(AlignmentError):
    """The readings are shorter than the method needs."""


class PoleError(AlignmentError):
    """Heading is undefined: the horizontal Earth rate vanishes."""


class Saturated(AlignmentError):
    """A sensor was driven beyond its range, and its readings are not what it felt."""
