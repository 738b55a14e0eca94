"""The hardware of the rig: servo amplifier with its torque port, both encoders, their protocols and their timing.

This floor may import numpy, python-can, canopen and pyserial, and of ours nothing but `model.channel`, the one
description of what a count means. Everything that turns is behind one
seam, `drivers.port.RigPort`: set-points in, a block of counts out. Start reading there.
"""
