"""One look for terminal, window, page and paper: figures, tables, previews and reports. Start in `page`."""
