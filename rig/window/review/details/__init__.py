"""One run in detail: header, facts, comparison, events, files. Start in `page`."""
