"""The object dictionary as a device's file states it: EDS and DCF, with the defects that real ones have."""
