"""Files of other programs, each kind read by one adapter that yields named columns of numbers."""
