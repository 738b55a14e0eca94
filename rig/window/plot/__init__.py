"""The plots that every page draws with, on pyqtgraph."""
