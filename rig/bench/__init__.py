"""The physical rig: its description (`config`), the limits of motion, and the backends that put it together."""
