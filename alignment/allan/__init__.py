"""Allan analysis: noise terms of a unit at rest, each with its interval, or a refusal.

Readings -> `stretches` (those without gaps, of each rest) -> `deviation` ->
`fit` of the five `terms`, weighted by `covariance` -> `analysis`: what the record shows, and how
long it must be to show the rest.
"""

from alignment.allan.analysis import (
    Analysis,
    Channel,
    FoundTerm,
    MissingTerm,
    RestRecord,
    analyse,
    channel,
)
from alignment.allan.stretches import Interruption

__all__ = [
    "Analysis",
    "Channel",
    "FoundTerm",
    "Interruption",
    "MissingTerm",
    "RestRecord",
    "analyse",
    "channel",
]
