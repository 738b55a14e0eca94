"""No-load starting torque: `breakaway` is the moment of first motion, `balance` that of the directions."""
