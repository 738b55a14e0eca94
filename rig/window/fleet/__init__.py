"""The page Fleet: the results of many runs, filtered, drawn, and followed to the run."""
