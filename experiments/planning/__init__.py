"""What plans are made of beside steps: shared parameters, shared parts, and the choice of speeds."""
