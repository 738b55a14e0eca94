"""The certificate of a gear: one page that is enough alone, then its curves, its numbers, its charts and its runs."""
