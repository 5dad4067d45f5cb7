"""The page ``report.html``: a result in the browser, in one file."""
