"""Gauge repeatability and reproducibility: how well benches, mountings and repeats tell gears apart."""
