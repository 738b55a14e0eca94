"""Inertia and friction from motion."""
