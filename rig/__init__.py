"""The application: configuration, the run loop, recording, run files, commands and reports.

The only floor where concrete parts are put together (`rig.backends`). Start reading in `rig.main` (the commands) and
`rig.run.session` (the one loop in which a rig turns).
"""
