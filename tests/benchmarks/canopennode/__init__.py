"""CANopenNode, a stack of other authors in C, behind the drivers: built from a checkout, none of it is kept here."""
