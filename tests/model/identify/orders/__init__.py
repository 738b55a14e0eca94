"""Orders of a channel over an angle."""
