"""Terms of the joint energy, one file each: settings, equation and weights."""
