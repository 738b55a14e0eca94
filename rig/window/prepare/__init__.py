"""The page on which a run is prepared: gear, protocol, plan, checklist. Start in `page`."""
