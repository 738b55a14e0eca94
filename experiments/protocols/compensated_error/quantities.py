"""What a compensated-error run finds: what the table leaves, what was predicted of it, and from where on it harms."""

from __future__ import annotations

from experiments.quantity import OF_SENT_ANGLES, Quantity

QUANTITIES = (
    Quantity(
        name="proof_ratio",
        title="remainder over prediction",
        unit="1",
        definition="seen remainder over its prediction at the speeds of the table, both directions",
        target_uncertainty=0.3,
        target_reason="a table that leaves 1.3 times what was predicted is a wrong one",
        is_key=True,
        is_above_zero=True,
        rests_on=OF_SENT_ANGLES,
    ),
    Quantity(
        name="remainder",
        title="remainder, as seen",
        unit="rad",
        shown="arcsec",
        definition="r.m.s. of what the table leaves of the output's deviation from the nominal angle over N",
        conditions=("part", "mounting", "speed"),
        target_share=0.2,
        target_reason="one table is told from the next",
        is_key=True,
        is_above_zero=True,
        rests_on=OF_SENT_ANGLES,
    ),
    Quantity(
        name="without_table",
        title="without the table, as seen",
        unit="rad",
        shown="arcsec",
        definition="r.m.s. of the same without the table",
        conditions=("part", "mounting", "speed"),
        is_above_zero=True,
        rests_on=OF_SENT_ANGLES,
    ),
    Quantity(
        name="predicted_seen",
        title="predicted, as seen",
        unit="rad",
        shown="arcsec",
        definition="by the motor's own deviation from the table, the table's covariance, the noise of this run",
    ),
    Quantity(
        name="predicted_true",
        title="predicted, true",
        unit="rad",
        shown="arcsec",
        definition="predicted as seen, with what the output encoder adds; this bench cannot prove the difference",
    ),
    Quantity(
        name="motor_part",
        title="of it the motor's own",
        unit="rad",
        shown="arcsec",
        definition="r.m.s. at the output of what the motor does otherwise than the table sends it: tracking, lag",
    ),
    Quantity(name="removed", title="taken out, as seen", unit="1", shown="%", is_signed=True),
    Quantity(
        name="helps_up_to",
        title="fastest speed at which the table helps",
        unit="rad/s",
        shown="r/min",
    ),
    Quantity(
        name="harms_from",
        title="slowest speed at which the table harms",
        unit="rad/s",
        shown="r/min",
    ),
    Quantity(
        name="remainder_{speed}_rpm",
        title="remainder at {speed} r/min",
        unit="rad",
        shown="arcsec",
    ),
    Quantity(
        name="without_table_{speed}_rpm",
        title="without the table at {speed} r/min",
        unit="rad",
        shown="arcsec",
    ),
    Quantity(
        name="predicted_{speed}_rpm",
        title="predicted at {speed} r/min",
        unit="rad",
        shown="arcsec",
    ),
    Quantity(name="index_gap", title="distance of the index marks", unit="1"),
)
