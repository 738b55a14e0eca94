"""What our laboratory adds to the rig: a protocol, a fit, a thermometer and a kind of file."""
