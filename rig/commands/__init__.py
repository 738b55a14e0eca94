"""The commands of `rig`, one file per group; each imports its heavy parts when it is called."""
