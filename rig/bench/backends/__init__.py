"""The only place where concrete rigs are put together; one module per kind of rig. Start with `registry.make_port`."""
