"""From what the nodes of an unknown bus tell of themselves to a description of the rig."""
