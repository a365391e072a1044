"""How large the numbers of files may be: in one place, each with its reason.

Not whether a value is good (a table, a lint or a plan say that), but what no machine or unit comes
near: within these bounds squares and products of all terms stay numbers, and nothing waits. A
number with narrower bounds of its own has them where its key is. `tests/test_bounded_numbers.py`
demands both ends of every number.
"""

from typing import Annotated

from pydantic import Field

DAY = 86400.0

# a month of turning, sampled, is 500 million samples at 200 Hz
LONGEST_S = 30 * DAY
# rate tables reach 3 000 deg/s and 1e5 deg/s^2, centrifuges and shakers some hundred times that
FASTEST_DEG_S = 1e5
HARDEST_DEG_S2 = 1e7
JERKIEST_DEG_S3 = 1e10
# 100 turns: cables and counters end before
FARTHEST_DEG = 36000.0
# what stands on a table's plate stands within it; the largest centrifuge's arm has 10 m
FARTHEST_M = 10.0
# the largest slewing drives have 1e6 N m, and stiffness of some 1e9 N m/rad
STRONGEST_NM = 1e7
STIFFEST_NM_RAD = 1e12
# data sheets state no number beyond 1e6, in any of the units that keys have
LARGEST_STATED = 1e9
# of temperatures: absolute zero, and where no electronics is any more
COLDEST_C, HOTTEST_C = -273.15, 1000.0

Rate = Annotated[float, Field(ge=1e-3, le=FASTEST_DEG_S)]
Acceleration = Annotated[float, Field(ge=1e-3, le=HARDEST_DEG_S2)]
PositiveAcceleration = Annotated[float, Field(gt=0, le=HARDEST_DEG_S2)]
Jerk = Annotated[float, Field(ge=1e-3, le=JERKIEST_DEG_S3)]
PositiveRate = Annotated[float, Field(gt=0, le=FASTEST_DEG_S)]
PositiveJerk = Annotated[float, Field(gt=0, le=JERKIEST_DEG_S3)]
Angle = Annotated[float, Field(ge=-FARTHEST_DEG, le=FARTHEST_DEG)]
Amplitude = Annotated[float, Field(gt=0, le=FARTHEST_DEG)]
Offset = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]
Duration = Annotated[float, Field(gt=0, le=LONGEST_S)]
Time = Annotated[float, Field(ge=-LONGEST_S, le=LONGEST_S)]
Torque = Annotated[float, Field(gt=0, le=STRONGEST_NM)]
Friction = Annotated[float, Field(ge=0, le=STRONGEST_NM)]
Stiffness = Annotated[float, Field(gt=0, le=STIFFEST_NM_RAD)]
StatedNumber = Annotated[float, Field(ge=0, le=LARGEST_STATED)]
StatedLimit = Annotated[float, Field(gt=0, le=LARGEST_STATED)]
Celsius = Annotated[float, Field(ge=COLDEST_C, le=HOTTEST_C)]
