"""Torque scale: what the torque port shows per torque that accelerates a known inertia."""
