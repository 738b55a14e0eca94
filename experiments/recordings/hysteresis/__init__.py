"""Hysteresis loops."""
