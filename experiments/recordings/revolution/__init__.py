"""Fourier series per revolution."""
