"""The drive (CiA 402): its state machine, its tables of objects and codes, its units and limits."""
