"""Read photos, and write and read reconstructions."""
