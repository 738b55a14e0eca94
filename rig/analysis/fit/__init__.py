"""From a run to its analysis: what belongs to it (`run`), the fit itself (`recorded`), what it says (`digest`)."""
