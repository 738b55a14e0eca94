"""Fuzzing: what every decoder and every file reader accepts, mutated; nothing but our own errors may come out.

A small part runs with the suite (`test_fuzzing`), the large numbers by `python -m tests.benchmarks.fuzz_study`.
"""
