"""The page on which runs are looked at: library, fits, difference, passport, signals. Start in `page`."""
