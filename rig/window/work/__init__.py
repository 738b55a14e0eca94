"""What goes on beside the window: work in threads, the run as a child process, the growing file."""
