"""The bus and its devices: frames, transfers, mapping, profiles, and the rig of CANopen nodes."""
