"""Mutants: the program changed at random places, one at a time, to see whether a test fails."""
