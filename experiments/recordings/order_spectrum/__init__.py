"""Order spectrum."""
