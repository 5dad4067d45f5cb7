"""Terms of the energies, one file each: settings, equation and weights."""
