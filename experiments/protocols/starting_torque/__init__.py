"""No-load starting torque: plan, moment of first motion, balance of the directions, analysis."""
