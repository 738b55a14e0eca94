"""Speed, always as a ratio against a peer in the same run. Run with `pytest tests/benchmarks -s`
(extra `benchmark`).
"""
