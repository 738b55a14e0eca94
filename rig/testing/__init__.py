"""What every protocol and every source must keep, as checks that any test suite can call.

Ours pass them in this program's own tests; those of other packages in theirs, by `harmonic_rig.testing`. A check raises
`AssertionError` with what is not kept.
"""
