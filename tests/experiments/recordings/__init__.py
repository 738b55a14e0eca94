"""Analyses of recordings that need no plan."""
