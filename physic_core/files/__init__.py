"""Files that are written completely or not at all, and npz files whose checksums are verified."""
