"""Analyses without a plan, for recordings of this rig and of others: what each declares, and its analysis."""
