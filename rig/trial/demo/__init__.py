"""The whole chain on the simulated rig, in one command. Start in `chain`."""
