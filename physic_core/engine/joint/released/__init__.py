"""Parts of the released code that differ from the printed equations; for preset "release"."""
