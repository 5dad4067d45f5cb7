"""Terms of the joint energy by subject: settings, equation and weights of each."""
