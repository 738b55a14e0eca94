"""What makes a rig turn for a purpose of its own: the doctor looks it over, the drills break it, the demo shows it."""
