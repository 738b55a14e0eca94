"""One execution of a protocol: plan to set-points, supervision, recording, and a safe end. Start in `session`."""
