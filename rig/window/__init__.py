"""The window: what the technician sees. Prepare a run, watch it, review what came of it.

May import everything of `rig` and the floors below; only `rig.commands.window` imports it, and nothing that turns a rig
does: the window is the *parent* of `rig run`, speaks to it in lines, and reads samples from the growing run file. Start
with `main.open_window`; `child` is the run's parent, `running` the page of a run, `live_file` reads the growing file.
"""
