"""Writing files completely or not at all; npz archives with verified checksums; numbers that JSON cannot write."""
