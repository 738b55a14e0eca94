"""What repeated points must show before their scatter is taken from them."""

FEWEST = 3
"""Repetitions below which the scatter is assumed and not estimated."""
SMALLEST, LARGEST = 3e-4, 0.2
"""Relative scatter that is looked for; one on the first is not seen beside the errors of the points."""
