"""The recorded channels of a run over time: drawn, measured between two cursors, taken along. Start in `view`."""
