"""Results in the browser: the page ``report.html``."""
