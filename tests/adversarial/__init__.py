"""Recordings of the rig, each broken by one stated act that its channels show: none may pass, none may mislead."""
