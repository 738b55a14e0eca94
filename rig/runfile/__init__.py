"""The run file: its layout, writing, reading, recovery, and files from other rigs. Start in `layout`."""
