"""Skew between two channels."""
