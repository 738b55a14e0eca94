"""Parameters that more than one protocol has, each declared once."""

from __future__ import annotations

from typing import Annotated

from annotated_types import Ge, Gt, Le

from experiments.parameters import Help, Unit

ZeroTime = Annotated[
    float,
    Ge(0.5),
    Le(120.0),
    Unit("s"),
    Help("servo-off time before and after, for the torque zero"),
]
Acceleration = Annotated[
    float, Gt(0.0), Le(20000.0), Unit("rad/s2"), Help("input acceleration of ramps")
]
SyncRate = Annotated[
    float,
    Ge(50.0),
    Le(20000.0),
    Unit("Hz"),
    Help("SYNC rate that the speeds shall be incommensurate with"),
]
Repeats = Annotated[
    int, Ge(1), Le(100), Unit(""), Help("how often the whole measurement is repeated")
]
Mounted = Annotated[str, Help("circular-spline-fixed (ratio N) or flexspline-fixed (ratio N + 1)")]
SlowSpeed = Annotated[
    float,
    Gt(0.0),
    Le(120.0),
    Unit("r/min"),
    Help("input speed at which an angle is approached"),
]
OutputCounts = Annotated[
    int,
    Ge(1),
    Le(100_000_000),
    Unit("1/rev"),
    Help("counts per revolution of the output encoder"),
]
Approach = Annotated[
    float,
    Ge(1.0),
    Le(50.0),
    Unit("rev"),
    Help("input revolutions discarded after each reversal (wind-up)"),
]
HighestSpeed = Annotated[float, Gt(0.0), Le(10000.0), Unit("r/min"), Help("highest input speed")]
Points = Annotated[int, Ge(1), Le(300), Unit(""), Help("number of speeds, in equal ratios")]
Speeds = Annotated[
    tuple[float, ...],
    Gt(0.0),
    Le(10000.0),
    Unit("r/min"),
    Help("speeds to run instead of the list above"),
]
MeasureTime = Annotated[
    float, Gt(0.0), Le(600.0), Unit("s"), Help("least time that counts at each speed")
]
SettleTime = Annotated[
    float, Gt(0.0), Le(600.0), Unit("s"), Help("time (fast: window) before it counts")
]
