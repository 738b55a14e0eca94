"""Turning until the running torque is steady."""
