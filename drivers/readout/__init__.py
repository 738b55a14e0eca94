"""Readouts that are asked for values one by one: no part of a SYNC's cycle."""
