"""Export a reconstruction to the formats of other programs; ``formats.FORMATS`` is the list."""
