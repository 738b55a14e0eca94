"""The protocols: each a file with its parameters, its plan and its analysis, or a folder when it has parts.

Start reading in `friction.protocol`, or copy `home`, the shortest one.
"""
