"""The Python interface: what `import rig` offers. It is a caller like the command line, and says the same of errors.

`rig/__init__.py` lists the public names; the functions stand here by what they do: reading, fitting, executing,
simulating, gearing, reporting. `Run` and `Result` are views of a recording and of a fit; nothing is computed in here.
"""
