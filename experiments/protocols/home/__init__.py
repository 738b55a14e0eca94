"""Index marks of both encoders."""
