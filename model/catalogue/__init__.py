"""What makers' tables say of gears, as facts with their sources, and complete parameter sets made of them."""
