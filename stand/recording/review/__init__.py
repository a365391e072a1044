"""The review: an .rrd that opens in the rerun viewer as a finished screen.

With the viewer the one door to rerun, which takes 0.7 s: import it only where a review is made.
"""

from stand.recording.review.writer import ReviewWriter
from stand.recording.viewer import view

__all__ = ["ReviewWriter", "view"]
