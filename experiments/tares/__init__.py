"""The motor by itself: its tares, what bears witness of them, and its own warmth."""
