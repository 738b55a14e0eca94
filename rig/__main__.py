"""`python -m rig`: the command without its console script, as the window starts it."""

from rig.main import run

if __name__ == "__main__":
    run()
