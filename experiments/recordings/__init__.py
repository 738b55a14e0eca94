"""Analyses without a plan, for recordings of this rig and of others."""
