"""A servo amplifier by analog reference: its set-point is a voltage, all else contacts, on a CiA 401 coupler."""
