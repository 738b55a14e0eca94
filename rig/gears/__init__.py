"""What is known of the gears: one card per gear, kept beside the runs. Start in `card`."""
