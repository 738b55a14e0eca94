"""Thousands of runs: fitted in parallel, kept as one table, simulated as a production.

May import what trial, run, analysis, gears, library, bench and runfile offer; a bench's run never imports it. Its
packages (dask, distributed, pyarrow, duckdb) are the extra `fleet`. Start reading at `results` (what a row is), then
`work` (what is to be done), `task` (what a worker does) and `engine` (who works).
"""
