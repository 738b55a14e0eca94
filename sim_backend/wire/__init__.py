"""The simulated rig on the wire: CANopen slaves and a serial readout in front of the same plant.

Full slaves by the standard (CiA 301, 401, 402, 406), so that the real drivers run byte for byte
with no hardware. They never see the drivers that talk to them. Start reading in `bench` (which
nodes stand in front of the plant), then `slave`.
"""
